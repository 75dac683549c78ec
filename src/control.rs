//! The control path: parameters with their ramps become settings for the audio path, once a tick.
//!
//! Everything here may use f64; nothing here is called from the audio path.

use heapless::Vec;

use crate::bubble::ENTRAINMENT;
use crate::drops::{self, Drops};
use crate::frame::TICK;
use crate::mix;
use crate::param::{self, COUNT, TABLE};
use crate::population::{self, CLASSES, Drive};
use crate::scene::{CURVES, IntensityCurve, Scene};
use crate::swell::{self, Swell};
use crate::voices::Strike;

/// Time between two changes of radii, s: what an old bank has to ring out.
const RETUNE: f64 = 0.213;
/// Time a change of scene takes, s.
const SCENE_RAMP: f32 = 0.5;

/// A value that the table does not allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange;

/// One parameter on its way.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    now: f32,
    from: f32,
    target: f32,
    /// Ticks left, of so many.
    left: u32,
    ticks: u32,
}

impl Ramp {
    /// One tick on. True where the value changed.
    fn step(&mut self, param: &param::Param) -> bool {
        if self.left == 0 {
            return false;
        }
        self.left -= 1;
        let x = 1.0 - self.left as f32 / self.ticks as f32;
        let before = self.now;
        self.now = param.between(self.from, self.target, x);
        self.now != before
    }
}

/// What a tick changes.
#[derive(Clone, Copy, Debug)]
pub struct Update<'a> {
    /// The population's settings, where they changed.
    pub water: Option<&'a population::Settings>,
    /// The mix's, where they changed.
    pub mix: Option<&'a mix::Settings>,
    /// Single bubbles that begin in this tick.
    pub strikes: &'a [Strike],
}

/// The control path's state.
#[derive(Clone, Debug)]
pub struct Control {
    sample_rate: f64,
    max_rate: f64,
    ramps: [Ramp; COUNT],
    curves: Vec<IntensityCurve, CURVES>,
    swell: Swell,
    drops: Drops,
    water: population::Settings,
    mix: mix::Settings,
    /// Radii, classes and rise factor that `water` is tuned to.
    tuned: [f32; 4],
    drive: Option<(Drive, [f64; CLASSES])>,
    mixed: [f32; 3],
    since_retune: u32,
    /// What the last tick changed.
    water_changed: bool,
    mix_changed: bool,
    strikes: Vec<Strike, { drops::STRIKES }>,
}

const TUNING: [usize; 4] = [
    param::RADIUS_MIN,
    param::RADIUS_MAX,
    param::CLASSES,
    param::RISE_FACTOR,
];
const MIXING: [usize; 3] = [param::LEVEL, param::TONE, param::LIMITER];

impl Control {
    /// Playing `scene` at `sample_rate` Hz with at most `max_rate` births a second.
    pub fn new(scene: &Scene, sample_rate: u32, max_rate: f32, seed: u64) -> Self {
        let mut control = Self {
            sample_rate: f64::from(sample_rate),
            max_rate: f64::from(max_rate),
            ramps: core::array::from_fn(|i| Ramp {
                now: TABLE[i].default,
                from: TABLE[i].default,
                target: TABLE[i].default,
                left: 0,
                ticks: 0,
            }),
            curves: Vec::new(),
            swell: Swell::new(seed),
            drops: Drops::new(seed),
            water: population::Settings::new(),
            mix: mix::Settings::new(0.0, 0.0, true),
            tuned: [0.0; 4],
            drive: None,
            mixed: [0.0; 3],
            since_retune: u32::MAX,
            water_changed: false,
            mix_changed: false,
            strikes: Vec::new(),
        };
        control.take(scene, 0.0);
        control.tick();
        control
    }

    /// The value a parameter is at now.
    pub fn get(&self, index: usize) -> f32 {
        self.ramps[index].now
    }

    /// Moves a parameter to `value` in `ramp` seconds, or in the time the table gives.
    pub fn set(&mut self, index: usize, value: f32, ramp: Option<f32>) -> Result<(), OutOfRange> {
        let param = &TABLE[index];
        if !param.accepts(value) {
            return Err(OutOfRange);
        }
        self.aim(index, value, ramp.unwrap_or(param.ramp));
        Ok(())
    }

    /// Changes to another scene, with no click.
    pub fn load(&mut self, scene: &Scene) {
        self.take(scene, SCENE_RAMP);
    }

    fn take(&mut self, scene: &Scene, ramp: f32) {
        self.curves.clone_from(&scene.curves);
        for (i, param) in TABLE.iter().enumerate() {
            let value = scene
                .values
                .iter()
                .find(|v| v.0 == i)
                .map_or(param.default, |v| v.1);
            let smooth = matches!(param.kind, param::Kind::Real) && !TUNING.contains(&i);
            self.aim(i, value, if smooth { ramp } else { 0.0 });
        }
        // The scene's own intensity is there at once; what it moves ramps.
        let intensity = self.ramps[param::INTENSITY].target;
        self.aim(param::INTENSITY, intensity, 0.0);
        self.follow(intensity, ramp);
    }

    fn aim(&mut self, index: usize, value: f32, ramp: f32) {
        let ticks = libm::roundf(ramp * self.sample_rate as f32 / TICK as f32) as u32;
        let slot = &mut self.ramps[index];
        slot.from = slot.now;
        slot.target = value;
        slot.ticks = ticks;
        slot.left = ticks;
        if ticks == 0 {
            slot.now = value;
            if index == param::INTENSITY {
                self.follow(value, 0.0);
            }
        }
    }

    /// Moves what the intensity moves.
    fn follow(&mut self, intensity: f32, ramp: f32) {
        for i in 0..self.curves.len() {
            let (index, value) = (self.curves[i].param, self.curves[i].at(intensity));
            self.aim(index, value, ramp);
        }
    }

    /// One tick on.
    pub fn tick(&mut self) {
        for (i, param) in TABLE.iter().enumerate() {
            if self.ramps[i].step(param) && i == param::INTENSITY {
                self.follow(self.ramps[i].now, 0.0);
            }
        }
        self.water_changed = self.water();
        self.mix_changed = self.mix();
        let drops = drops::Settings {
            rate: self.value(param::DROPS_RATE),
            regularity: self.value(param::DROPS_REGULARITY),
            radius: self.value(param::DROPS_RADIUS) * 1e-3,
            spread: self.value(param::DROPS_SPREAD),
            bubbles: self.value(param::DROPS_BUBBLES),
            pressure: self.value(param::DROPS_PRESSURE),
            rise_factor: self.value(param::DROPS_RISE),
            width: self.value(param::WIDTH),
        };
        self.strikes = self.drops.tick(&drops, self.sample_rate);
    }

    /// What the audio path has to know of the last tick.
    pub fn update(&self) -> Update<'_> {
        Update {
            water: self.water_changed.then_some(&self.water),
            mix: self.mix_changed.then_some(&self.mix),
            strikes: &self.strikes,
        }
    }

    /// All settings, for an audio path that begins now.
    pub fn settings(&self) -> (&population::Settings, &mix::Settings) {
        (&self.water, &self.mix)
    }

    fn value(&self, index: usize) -> f64 {
        f64::from(self.ramps[index].now)
    }

    /// Brings the population's settings up to date. True where they changed.
    fn water(&mut self) -> bool {
        let mut changed = false;
        self.since_retune = self.since_retune.saturating_add(1);
        let tuning = TUNING.map(|i| self.ramps[i].now);
        let waited = f64::from(self.since_retune) * TICK as f64 / self.sample_rate;
        let retune = tuning[..3] != self.tuned[..3] && waited >= RETUNE;
        if retune {
            let [a, b] = [tuning[0], tuning[1]].map(|mm| f64::from(mm) * 1e-3);
            let classes = tuning[2] as usize;
            self.water
                .tune(a.min(b), a.max(b), classes, tuning[3], self.sample_rate);
            self.tuned = tuning;
            self.since_retune = 0;
            changed = true;
        } else if tuning[3] != self.tuned[3] {
            self.water.set_rise(tuning[3], self.sample_rate);
            self.tuned[3] = tuning[3];
            changed = true;
        }
        let swell = swell::Settings {
            period: self.value(param::SWELL_PERIOD),
            irregularity: self.value(param::SWELL_IRREGULARITY),
            attack: self.value(param::SWELL_ATTACK),
        };
        let depth = self.value(param::SWELL_DEPTH);
        let height = self.swell.advance(TICK as f64 / self.sample_rate, &swell);
        // What falls away between waves.
        let ebb = if depth > 0.0 {
            depth * (1.0 - height)
        } else {
            0.0
        };
        let entrained = self.ramps[param::EXCITATION].now == 1.0;
        let drive = Drive {
            rate: self.value(param::RATE).min(self.max_rate) * (1.0 - ebb) * (1.0 - ebb),
            alpha: if entrained {
                0.0
            } else {
                self.value(param::ALPHA)
            },
            beta: self.value(param::BETA),
            depth: self.value(param::DEPTH),
            rise_cutoff: self.value(param::RISE_CUTOFF),
            rise_factor: f64::from(tuning[3]),
            pressure: if entrained {
                ENTRAINMENT
            } else {
                self.value(param::PRESSURE)
            },
            width: self.value(param::WIDTH),
        };
        let law = self.ramps[param::LAW].now as usize;
        let gamma = if law == 1 {
            self.value(param::GAMMA)
        } else {
            0.0
        } + ebb * self.value(param::SWELL_FIZZ);
        let mut weight = [0.0; CLASSES];
        for (k, weight) in weight[..self.water.classes].iter_mut().enumerate() {
            let custom = if law == 2 {
                self.value(param::WEIGHT + k)
            } else {
                1.0
            };
            let radius = f64::from(self.water.tuning[k].radius) * 1e3;
            *weight = custom * libm::pow(radius, -gamma);
        }
        if changed || self.drive != Some((drive, weight)) {
            self.water.drive(&drive, &weight, self.sample_rate);
            self.drive = Some((drive, weight));
            changed = true;
        }
        changed
    }

    fn mix(&mut self) -> bool {
        let mixed = MIXING.map(|i| self.ramps[i].now);
        if mixed == self.mixed {
            return false;
        }
        self.mixed = mixed;
        let [level, tone] = [mixed[0], mixed[1]].map(f64::from);
        self.mix = mix::Settings::new(level, tone, mixed[2] == 1.0);
        true
    }
}
