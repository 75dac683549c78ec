//! The control path: parameters with their ramps become settings for the audio path, once a tick.
//!
//! Nothing here is called from the audio path. It may use f64, where pitch and decay want it, but a tick has to be done
//! before the next one on a processor that has none: whatever takes longer is spread over a fixed number of ticks.

use heapless::{Deque, Vec};

use crate::bubble::ENTRAINMENT;
use crate::cloud::{self, Keep};
use crate::drops::{self, Drops};
use crate::fixed::to_fixed;
use crate::frame::{BLOCK, TICK};
use crate::mix;
use crate::param::{self, COUNT, TABLE};
use crate::population::{Drive, Radii, Slice, Tuner};
use crate::profile::{Limits, Most, limits};
use crate::scene::{CURVES, IntensityCurve, Scene};
use crate::swell::{self, Swell};
use crate::update::Update;
use crate::voices::{Pitch, Strike};

/// Ticks between two steps of the swell: it moves slowly, and all that is struck follows it.
const SWELL_STEP: u32 = 4;
/// Time a change of scene takes, s.
const SCENE_RAMP: f32 = 0.5;
/// Longest ramp, s.
pub const RAMP_MAX: f32 = 3600.0;
/// Time that [`Control::mute`] takes, s.
const MUTE_RAMP: f32 = 0.05;
/// Bubbles asked for that may wait, and how many of them sound in a tick: their pitch wants f64.
const TRIGGERS: usize = 16;
const TRIGGERS_A_TICK: usize = 2;

/// A value that the table does not allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange;

/// One parameter on its way.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    now: f32,
    from: f32,
    target: f32,
    /// Ticks before it starts.
    wait: u32,
    /// Ticks left, of so many.
    left: u32,
    ticks: u32,
}

impl Ramp {
    /// Arrived.
    const fn at(value: f32) -> Self {
        Self {
            now: value,
            from: value,
            target: value,
            wait: 0,
            left: 0,
            ticks: 0,
        }
    }

    /// After `wait` ticks it goes to `target` in `ticks`.
    fn aim(&mut self, target: f32, ticks: u32, wait: u32) {
        if ticks == 0 && wait == 0 {
            *self = Self::at(target);
            return;
        }
        let ticks = ticks.max(1);
        *self = Self {
            now: self.now,
            from: self.now,
            target,
            wait,
            left: ticks,
            ticks,
        };
    }

    /// One tick on. True where the value changed.
    fn step(&mut self, param: &param::Param) -> bool {
        if self.left == 0 {
            return false;
        }
        if self.wait > 0 {
            self.wait -= 1;
            return false;
        }
        self.left -= 1;
        let x = 1.0 - self.left as f32 / self.ticks as f32;
        let before = self.now;
        self.now = param.between(self.from, self.target, x);
        self.now != before
    }
}

/// The control path's state.
#[derive(Clone, Debug)]
pub struct Control {
    sample_rate: f32,
    limits: Limits,
    ramps: [Ramp; COUNT],
    curves: Vec<IntensityCurve, CURVES>,
    swell: Swell,
    /// How high the water stands, from 0 to 1, and ticks until that is looked at again.
    height: f32,
    settled: u32,
    /// Part of the births that the swell leaves.
    flow: f32,
    drops: Drops,
    tuner: Tuner,
    /// What the water is driven by, and a number for it that differs from the one before.
    drive: Drive,
    version: u32,
    mixed: Mixed,
    triggers: Deque<Trigger, TRIGGERS>,
    muted: bool,
    paused: bool,
    /// From 1 to 0 where it is muted or pauses.
    gain: f32,
}

/// A bubble asked for: m, Pa, ξ.
type Trigger = [f32; 3];
/// What the mix is driven by: the parameters of [`MIXING`], and the gain.
type Mixed = ([f32; 3], f32);

const TUNING: [usize; 4] = [
    param::RADIUS_MIN,
    param::RADIUS_MAX,
    param::CLASSES,
    param::RISE_FACTOR,
];
const MIXING: [usize; 3] = [param::LEVEL, param::TONE, param::LIMITER];

impl Control {
    /// As it is before it starts. All of it is zero, so that a board need not keep it in flash.
    pub const OFF: Self = Self {
        sample_rate: 0.0,
        limits: limits([0.0; 2], [0; 2], 0),
        ramps: [Ramp::at(0.0); COUNT],
        curves: Vec::new(),
        swell: Swell::OFF,
        height: 0.0,
        settled: 0,
        flow: 0.0,
        drops: Drops::OFF,
        tuner: Tuner::OFF,
        drive: Drive::NONE,
        version: 0,
        mixed: ([0.0; 3], 0.0),
        triggers: Deque::new(),
        muted: false,
        paused: false,
        gain: 0.0,
    };

    /// Playing `scene` at `sample_rate` Hz within `limits`.
    pub fn new(scene: &Scene, sample_rate: u32, limits: Limits, seed: u64) -> Self {
        let mut control = Self::OFF;
        control.start(scene, sample_rate, limits, seed);
        control
    }

    /// The same in place: on a board no stack would hold it on the way.
    pub fn start(&mut self, scene: &Scene, sample_rate: u32, limits: Limits, seed: u64) {
        let rate = f64::from(sample_rate);
        self.sample_rate = rate as f32;
        self.limits = limits;
        self.swell = Swell::new(seed);
        self.drops = Drops::new(seed, rate);
        self.ramps = self.take(scene).map(Ramp::at);
        let (radii, rise_factor) = (self.radii(), self.at(param::RISE_FACTOR));
        self.tuner.start(radii, rise_factor, rate);
        self.version = 1;
        self.gain = 1.0;
        self.mixed = self.mixing();
    }

    /// The value a parameter is at now.
    pub fn get(&self, index: usize) -> f32 {
        self.ramps[index].now
    }

    /// The value a parameter is heading for.
    pub fn target(&self, index: usize) -> f32 {
        let ramp = &self.ramps[index];
        if ramp.left > 0 { ramp.target } else { ramp.now }
    }

    /// Whether the intensity moves a parameter.
    pub fn follows_intensity(&self, index: usize) -> bool {
        self.curves.iter().any(|curve| curve.param == index)
    }

    /// Fades everything out, or in again; no parameter moves by that.
    pub fn mute(&mut self, on: bool) {
        self.muted = on;
    }

    /// The same for the device itself, whatever a person asked for: everything sounds that neither mutes.
    pub fn pause(&mut self, on: bool) {
        self.paused = on;
    }

    /// Whether everything is faded out.
    pub fn is_muted(&self) -> bool {
        (self.muted || self.paused) && self.gain == 0.0
    }

    /// Sounds a bubble of `radius` metres, `pressure` Pa at 1 m, and `rise_factor`, in the middle. Returns by how many
    /// ticks it is later than other things asked for now; none where too many wait already.
    pub fn trigger(&mut self, radius: f32, pressure: f32, rise_factor: f32) -> Option<u32> {
        let ticks = self.triggers.len() / TRIGGERS_A_TICK;
        let trigger = [radius, pressure, rise_factor];
        self.triggers.push_back(trigger).ok()?;
        Some(ticks as u32)
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

    /// Changes to another scene, with no click: to its radii as soon as they are worked out, and from then on to all
    /// else along a ramp.
    pub fn load(&mut self, scene: &Scene) {
        let values = self.take(scene);
        for i in TUNING {
            self.ramps[i].aim(values[i], 0, 0);
        }
        // The ramps' first step is in the tick in which the radii change.
        let wait = self.tuner.due(&self.radii()).saturating_sub(1);
        let ramp = self.ticks(SCENE_RAMP);
        for (i, param) in TABLE.iter().enumerate() {
            let smooth = matches!(param.kind, param::Kind::Real);
            match i {
                _ if TUNING.contains(&i) => {}
                // The scene's own intensity is there at once; what it moves follows.
                param::INTENSITY => self.ramps[i].aim(values[i], 0, 0),
                _ => self.ramps[i].aim(values[i], if smooth { ramp } else { 0 }, wait),
            }
        }
    }

    /// The values of all parameters in `scene`, whose curves are the intensity's from now on.
    fn take(&mut self, scene: &Scene) -> [f32; COUNT] {
        self.curves.clone_from(&scene.curves);
        let mut values = TABLE.each_ref().map(|param| param.default);
        let intensity = (scene.values.iter())
            .find(|(index, _)| *index == param::INTENSITY)
            .map_or(values[param::INTENSITY], |(_, value)| *value);
        for curve in &self.curves {
            values[curve.param] = curve.at(intensity);
        }
        // What the scene says itself comes first; a curve takes over when the intensity moves.
        for &(index, value) in &scene.values {
            values[index] = value;
        }
        values
    }

    fn aim(&mut self, index: usize, value: f32, ramp: f32) {
        let ticks = self.ticks(ramp);
        self.ramps[index].aim(value, ticks, 0);
        if ticks == 0 && index == param::INTENSITY {
            self.follow();
        }
    }

    fn ticks(&self, seconds: f32) -> u32 {
        libm::roundf(seconds * self.sample_rate / TICK as f32) as u32
    }

    /// Moves what the intensity moves.
    fn follow(&mut self) {
        let intensity = self.at(param::INTENSITY);
        for curve in &self.curves {
            self.ramps[curve.param] = Ramp::at(curve.at(intensity));
        }
    }

    /// One tick on: fills in what the audio path is to do in the next one.
    pub fn tick(&mut self, update: &mut Update) {
        for (i, param) in TABLE.iter().enumerate() {
            if self.ramps[i].step(param) && i == param::INTENSITY {
                self.follow();
            }
        }
        update.slice = (self.tuner).tick(self.radii(), self.at(param::RISE_FACTOR));
        let retuned = update.slice.as_ref().is_some_and(Slice::switches);
        let drive = self.drive();
        if retuned || drive != self.drive {
            self.drive = drive;
            self.version = self.version.wrapping_add(1);
        }
        // Two updates go back and forth: each learns of a change when it comes by.
        if update.version != self.version {
            update.version = self.version;
            let (radii, impulses) = self.tuner.live();
            (update.water).drive(&self.drive, radii, impulses, self.sample_rate);
        }
        let step = TICK as f32 / (MUTE_RAMP * self.sample_rate);
        self.gain = if self.muted || self.paused {
            (self.gain - step).max(0.0)
        } else {
            (self.gain + step).min(1.0)
        };
        let mixed = self.mixing();
        update.mix = (mixed != self.mixed).then(|| mix_settings(mixed));
        self.mixed = mixed;
        let drops = drops::Settings {
            rate: self.at(param::DROPS_RATE),
            regularity: self.at(param::DROPS_REGULARITY),
            radius: self.at(param::DROPS_RADIUS) * 1e-3,
            spread: self.at(param::DROPS_SPREAD),
            bubbles: self.at(param::DROPS_BUBBLES),
            pressure: self.at(param::DROPS_PRESSURE),
            rise_factor: self.at(param::DROPS_RISE),
            width: self.at(param::WIDTH),
        };
        update.strikes.clear();
        for block in 0..TRIGGERS_A_TICK {
            if let Some([radius, pressure, rise_factor]) = self.triggers.pop_front() {
                let pitch = Pitch::new(radius, rise_factor, f64::from(self.sample_rate));
                let gain = [to_fixed(f64::from(pressure), 28); 2];
                // As the audio path takes them, one in a block; there is room.
                let strike = Strike::new(pitch, (block * BLOCK) as f64, gain);
                let _ = update.strikes.push(strike);
            }
        }
        self.drops.tick(&drops, &mut update.strikes);
    }

    /// The same tick for the cloud, whose size is a profile's; after [`Control::tick`].
    pub fn tick_cloud(&self, keeper: &mut impl Keep, update: &mut Update) {
        let [a, b] = [param::CLOUD_RADIUS_MIN, param::CLOUD_RADIUS_MAX].map(|i| self.at(i) * 1e-3);
        let settings = cloud::Settings {
            bubbles: self.at(param::CLOUD_BUBBLES) as usize,
            rate: self.at(param::CLOUD_RATE) * self.flow,
            split: self.at(param::CLOUD_SPLIT),
            pushes: self.at(param::CLOUD_PUSHES) * self.flow,
            radius_min: a.min(b),
            radius_max: a.max(b),
            gamma: self.at(param::CLOUD_GAMMA),
            spacing: self.at(param::CLOUD_SPACING),
            depth: self.at(param::CLOUD_DEPTH) * 1e-3,
            coupling: self.at(param::CLOUD_COUPLING),
            pressure: self.at(param::CLOUD_PRESSURE),
            drift: self.at(param::CLOUD_DRIFT),
            width: self.at(param::WIDTH),
        };
        keeper.tick(&settings, &mut update.cloud);
    }

    /// The mix's settings, for an audio path that begins now.
    pub fn mix(&self) -> mix::Settings {
        mix_settings(self.mixed)
    }

    /// The population's classes, for an audio path that begins now.
    pub fn slices(&self) -> impl Iterator<Item = Slice> {
        self.tuner.slices()
    }

    fn at(&self, index: usize) -> f32 {
        self.ramps[index].now
    }

    /// What the board has time for now.
    fn most(&self) -> Most {
        if self.at(param::CLOUD_RATE) > 0.0 {
            self.limits.beside_cloud
        } else {
            self.limits.alone
        }
    }

    fn radii(&self) -> Radii {
        let [a, b] = [self.at(param::RADIUS_MIN), self.at(param::RADIUS_MAX)];
        Radii {
            min: a.min(b),
            max: a.max(b),
            classes: (self.at(param::CLASSES) as usize).min(self.most().classes),
        }
    }

    /// The swell goes on, and with it what the water is driven by.
    fn drive(&mut self) -> Drive {
        if self.settled == 0 {
            self.settled = SWELL_STEP;
            let swell = swell::Settings {
                period: self.at(param::SWELL_PERIOD),
                irregularity: self.at(param::SWELL_IRREGULARITY),
                attack: self.at(param::SWELL_ATTACK),
            };
            let seconds = (SWELL_STEP * TICK as u32) as f32 / self.sample_rate;
            self.height = self.swell.advance(seconds, &swell);
        }
        self.settled -= 1;
        // What falls away between waves.
        let ebb = match self.at(param::SWELL_DEPTH) {
            0.0 => 0.0,
            depth => depth * (1.0 - self.height),
        };
        self.flow = (1.0 - ebb) * (1.0 - ebb);
        let law = self.at(param::LAW) as usize;
        let gamma = if law == 1 { self.at(param::GAMMA) } else { 0.0 };
        let weight = |k| match law {
            2 => self.at(param::WEIGHT + k),
            _ => 1.0,
        };
        let entrained = self.at(param::EXCITATION) == 1.0;
        let impact = |value: f32, other: f32| if entrained { other } else { value };
        Drive {
            rate: self.at(param::RATE).min(self.most().rate) * self.flow,
            gamma: gamma + ebb * self.at(param::SWELL_FIZZ),
            weight: core::array::from_fn(weight),
            alpha: impact(self.at(param::ALPHA), 0.0),
            beta: self.at(param::BETA),
            depth: self.at(param::DEPTH),
            rise_cutoff: self.at(param::RISE_CUTOFF),
            rises: self.at(param::RISE_FACTOR) > 0.0,
            pressure: impact(self.at(param::PRESSURE), ENTRAINMENT as f32),
            width: self.at(param::WIDTH),
        }
    }

    fn mixing(&self) -> Mixed {
        (MIXING.map(|i| self.at(i)), self.gain)
    }
}

fn mix_settings(([level, tone, limiter], gain): Mixed) -> mix::Settings {
    mix::Settings::new(f64::from(level), f64::from(tone), limiter == 1.0).attenuated(gain)
}
