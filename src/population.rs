//! A population of bubbles (vdD §5): radius classes, each a Poisson process that strikes one stereo resonator.
//!
//! A class's clock holds the expected births until the next one; each block uses up what the class's rate gives, so a
//! change of rate needs no redraw. A bubble that does not rise is one impulse at its exact time between samples; a
//! rising one asks for a voice. Above one birth a sample a class is a *crowd*: its impulses are drawn by their moments.

use crate::fixed::{PASCAL, exp2_neg, high, pan, to_fixed, to_fixed_u64};
use crate::frame::{BLOCK, Block};
use crate::kernel::{Drawn, Hits, Outcome, Source, Stroke, play, ring};
use crate::observer::{Birth, Crowd as CrowdSeen, Observer, Path};
use crate::random::{Random, Stream};
use crate::resonator::{
    Complex, Form, Impulse, STRIKES_MAX, SWING_MAX, State, StrikeWords, Strikes, Tuning,
    run_struck, run_two_struck,
};
use crate::stats::Stats;
use crate::voices::{Pitch, Start, Voice, Voices};

/// Most radius classes.
pub const CLASSES: usize = 64;

/// Where births are denser than this a sample, a class is a crowd.
pub const CROWD: f64 = 1.0;
/// No bubble of a class is louder than this, Pa: twice full scale.
pub const CLASS_MAX_PA: f64 = 2.0;
/// From 2^this births a block (over ln 2) on they are gathered before the resonator runs: worth it on a desktop, where
/// two resonators in step are faster than one. A Cortex-M gathers only crowds.
const CROSSOVER: Option<u32> = if cfg!(dsp) { None } else { Some(3) };
/// Nothing rises: above every random number but one, which marks the end of a list.
const ALL_STILL: u32 = u32::MAX - 1;
/// A retired bank rings out at least this fast, 1/s.
const RETIRED_DECAY: f64 = 60.0;

/// How a class is struck.
#[derive(Clone, Copy, Debug)]
pub struct Flow {
    /// What the clock draws births one by one by.
    stroke: Stroke,
    /// The clock counts births over ln 2 in units of 2^-`scale`.
    scale: u32,
    /// `-log2 D` (Q20) above which less than half a unit is left of a bubble one sample before it is due.
    inaudible: u32,
    /// The pressure at its birth, Q28, for voices.
    voice_pressure: u32,
    crowd: Option<Crowd>,
}

/// The moments of a class with more than one birth a sample.
#[derive(Clone, Copy, Debug)]
struct Crowd {
    /// Mean of the births in a block, Q32.
    births: i64,
    /// Its root, over the deviation of `rough_normal`, Q32.
    births_spread: i64,
    /// Mean of both words in a sample, Q32.32 of bus units.
    mean: [i64; 2],
    /// Cholesky factor of both words' covariance, over the deviation of `rough_normal`, Q42 of a pascal.
    spread: [i32; 3],
    /// What a block's impulses may come to at most, Q27 of a pascal.
    most: u32,
    /// Mean gain of an ear, and the factor of the covariance between ears, Q30.
    ear_mean: i32,
    ears: [i32; 3],
}

/// What the audio path needs of the water's parameters.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Classes in use.
    pub classes: usize,
    /// Grows with each change of radii, and so of `tuning`.
    pub generation: u32,
    /// The resonators.
    pub tuning: [Tuning; CLASSES],
    /// The same when retired: ringing out faster.
    pub retired: [Tuning; CLASSES],
    /// The pitch of a class's rising bubbles.
    pub pitch: [Pitch; CLASSES],
    /// How each class is struck.
    pub flow: [Flow; CLASSES],
    law: Law,
}

/// What every birth is drawn by.
#[derive(Clone, Copy, Debug)]
struct Law {
    /// β of `D = rnd^β`, Q26.
    exponent: u32,
    /// A bubble rises where its random number is above this, Q32.
    still: u32,
    /// Width of the stage, 256 is full.
    width: i32,
}

/// The parameters of the water that are not its radii; see the parameter table for units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Births a second.
    pub rate: f64,
    /// Exponent of the pressure's growth with radius.
    pub alpha: f64,
    /// Exponent of the depth factor.
    pub beta: f64,
    /// Largest depth factor.
    pub depth: f64,
    /// Bubbles whose depth factor is above this rise.
    pub rise_cutoff: f64,
    /// Rise factor ξ; 0: nothing rises.
    pub rise_factor: f64,
    /// Pressure at 1 m of a bubble of 1 mm and depth factor 1, Pa.
    pub pressure: f64,
    /// From 0 to 1.
    pub width: f64,
}

impl Settings {
    /// No water at all.
    pub fn new() -> Self {
        Self {
            classes: 0,
            generation: 0,
            tuning: [Tuning::SILENT; CLASSES],
            retired: [Tuning::SILENT; CLASSES],
            pitch: [Pitch::SILENT; CLASSES],
            flow: [Flow::default(); CLASSES],
            law: Law::NONE,
        }
    }

    /// Retunes to `classes` radii from `min` to `max` metres, evenly spaced by ratio. `sample_rate` in Hz.
    pub fn tune(&mut self, min: f64, max: f64, classes: usize, rise_factor: f32, sample_rate: f64) {
        self.classes = classes.clamp(1, CLASSES);
        self.generation = self.generation.wrapping_add(1);
        let intervals = (self.classes - 1).max(1) as f64;
        let ratio = libm::exp(libm::log(max / min) / intervals);
        let mut radius = min;
        for k in 0..self.classes {
            self.tuning[k] = Tuning::new(radius as f32, sample_rate);
            self.retired[k] = self.tuning[k].hurried(RETIRED_DECAY / sample_rate);
            self.pitch[k] = Pitch::new(radius as f32, rise_factor, sample_rate);
            radius *= ratio;
        }
    }

    /// Whether a class's births are gathered before its resonator runs.
    fn is_dense(&self, k: usize) -> bool {
        let flow = &self.flow[k];
        flow.crowd.is_some() || CROSSOVER.is_some_and(|least| flow.scale <= 31 - least)
    }

    /// Gives every class's rising bubbles another rise factor.
    pub fn set_rise(&mut self, rise_factor: f32, sample_rate: f64) {
        for k in 0..self.classes {
            self.pitch[k] = Pitch::new(self.tuning[k].radius, rise_factor, sample_rate);
        }
    }

    /// Spreads the births over the classes by `weight` (any scale) and sets their strength.
    pub fn drive(&mut self, drive: &Drive, weight: &[f64], sample_rate: f64) {
        let total: f64 = weight[..self.classes].iter().sum();
        let rises = drive.rise_factor > 0.0;
        // D > cutoff where rnd > (cutoff / depth)^(1/β).
        let ratio = if drive.depth > 0.0 {
            drive.rise_cutoff / drive.depth
        } else {
            1.0
        };
        let still = if !rises || ratio >= 1.0 {
            1.0
        } else if drive.beta == 0.0 || ratio <= 0.0 {
            0.0
        } else {
            libm::pow(ratio, 1.0 / drive.beta)
        };
        self.law.exponent = to_fixed(drive.beta, 26) as u32;
        self.law.still = libm::round(still * f64::from(ALL_STILL)) as u32;
        self.law.width = libm::round(drive.width * 256.0) as i32;
        let scale = if total > 0.0 {
            drive.rate * BLOCK as f64 / (sample_rate * total)
        } else {
            0.0
        };
        for (k, flow) in self.flow.iter_mut().enumerate() {
            if k >= self.classes {
                *flow = Flow::default();
                continue;
            }
            let tuning = &self.tuning[k];
            let births = weight[k] * scale;
            let pressure = drive.pressure * libm::pow(f64::from(tuning.radius) * 1e3, drive.alpha);
            let pressure = (drive.depth * pressure).min(CLASS_MAX_PA);
            let still_births = births * still;
            if still_births > CROWD * BLOCK as f64 {
                *flow = Flow::new(births - still_births, pressure, tuning, &self.law);
                let sound = [pressure, drive.beta, drive.width];
                flow.crowd = Some(Crowd::new(still_births, sound, still, tuning, sample_rate));
            } else {
                *flow = Flow::new(births, pressure, tuning, &self.law);
                if tuning.form != Form::Silent {
                    flow.stroke.silent_below = self.law.silent_below(flow.inaudible);
                }
            }
        }
    }
}

impl Law {
    const NONE: Self = Self {
        exponent: 0,
        still: ALL_STILL,
        width: 256,
    };

    /// Below which random numbers a bubble neither rises nor is heard, given the `-log2 D` (Q20) up to which it is.
    fn silent_below(&self, inaudible: u32) -> u32 {
        if self.exponent == 0 {
            return 0;
        }
        // Where -log2(rnd), Q26, times the exponent is more than that; one unit of Q20 aside.
        let least = ((u64::from(inaudible) + 1) << 32) / u64::from(self.exponent);
        match u32::try_from((least >> 6) + 2) {
            Ok(least) if least < 32 << 20 => (exp2_neg(least) << 1).min(self.still),
            _ => 0,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::new()
    }
}

impl Default for Flow {
    fn default() -> Self {
        Self::new(0.0, 0.0, &Tuning::SILENT, &Law::NONE)
    }
}

impl Flow {
    fn new(births: f64, pressure: f64, tuning: &Tuning, law: &Law) -> Self {
        let wide = to_fixed_u64(births * core::f64::consts::LOG2_E, 32);
        // So that a block is 2^31 units or more, unless years pass without a birth.
        let scale = wide.leading_zeros().min(57);
        let per_block = (wide << scale >> 32) as u32;
        let inverse = u64::MAX / u64::from(per_block.max(1));
        let grown = pressure * libm::exp2(f64::from(tuning.decay_over(u32::MAX)) / 1_048_576.0);
        let (decay, step) = tuning.pace();
        Self {
            stroke: Stroke {
                per_block,
                gap: 1 << scale.saturating_sub(26),
                stretch: (inverse - (1 << 32)).min(u64::from(u32::MAX)) as u32,
                silent_below: 0,
                still: law.still,
                exponent: law.exponent,
                decay,
                step,
                width: law.width,
                edge: (128 << 8) - (law.width << 7),
                pressure: to_fixed_u64(grown, 30) as u32,
                second: tuning.second(),
                coarse: 26u32.saturating_sub(scale),
            },
            scale,
            inaudible: to_fixed_u64(libm::log2(grown).max(-28.0) + 28.0, 20) as u32,
            voice_pressure: to_fixed_u64(pressure, 28) as u32,
            crowd: None,
        }
    }
}

impl Crowd {
    /// `births` in a block, of `[pressure in Pa, β, width]`, whose random numbers are below `still`.
    fn new(
        births: f64,
        [pressure, beta, width]: [f64; 3],
        still: f64,
        tuning: &Tuning,
        sample_rate: f64,
    ) -> Self {
        let per_sample = births / BLOCK as f64;
        // Moments of D over rnd < still, per still birth; depth is in `pressure`.
        let first = libm::pow(still, beta) / (beta + 1.0);
        let second = libm::pow(still, 2.0 * beta) / (2.0 * beta + 1.0);
        let (words_mean, [aa, ab, bb]) = tuning.moments(sample_rate);
        let a = libm::sqrt(aa);
        let b = ab / a;
        let c = libm::sqrt((bb - b * b).max(0.0));
        let deviation = pressure * libm::sqrt(per_sample * second) / Random::ROUGH_DEVIATION;
        // Pan is uniform over the width; sums over the audio path's own table.
        let width = libm::round(width * 256.0) as i32;
        let (mut mean, mut own, mut shared) = (0.0, 0.0, 0.0);
        for draw in 0..256 {
            let gains = pan(draw, width, (128 << 8) - (width << 7));
            let [left, right] = gains.map(|gain| f64::from(gain) / 2_147_483_648.0);
            mean += left / 256.0;
            own += left * left / 256.0;
            shared += left * right / 256.0;
        }
        let e0 = libm::sqrt(own);
        let e1 = shared / e0;
        let e2 = libm::sqrt((own - e1 * e1).max(0.0));
        let level = pressure * per_sample * first;
        // The rough normal number ends at 3.47 deviations; two of them make the second word.
        let most = BLOCK as f64 * 1.5 * (level + 2.0 * 3.47 * Random::ROUGH_DEVIATION * deviation);
        // What the resonator cannot take is held down.
        let hold = (f64::from(STRIKES_MAX) / 134_217_728.0 / most).min(1.0);
        Self {
            births: to_fixed_u64(births, 32) as i64,
            births_spread: to_fixed_u64(libm::sqrt(births) / Random::ROUGH_DEVIATION, 32) as i64,
            mean: words_mean.map(|m| libm::round(libm::scalbn(level * hold * m, 58)) as i64),
            spread: [a, b, c].map(|f| to_fixed(f * hold * deviation, 42)),
            most: to_fixed_u64(hold * most, 27) as u32,
            ear_mean: to_fixed(mean, 30),
            ears: [e0, e1, e2].map(|e| to_fixed(e, 30)),
        }
    }

    /// How many are born in a block: Poisson by its first three moments, which 32 births or more make exact enough to
    /// count with.
    #[inline(always)]
    fn count(&self, random: &mut Random) -> u64 {
        // (z² − 1)/6, Q32; 2^48 over 6 squares of the rough normal's deviation is 32 768.
        let normal = i64::from(random.rough_normal());
        let skew = ((normal * normal) >> 1) - (1 << 32) / 6;
        let drawn = self.births + normal * self.births_spread + skew;
        ((drawn + (1 << 31)) >> 32).max(0) as u64
    }

    /// One sample's impulses, for both ears.
    #[inline(always)]
    fn draw(&self, random: &mut Random) -> StrikeWords {
        let normals = [(); 2].map(|()| [(); 2].map(|()| i64::from(random.rough_normal())));
        let ear = |words: [i64; 2], part: [i64; 2]| {
            let [a, b, c] = self.spread.map(i64::from);
            let (x, y) = (part[0], part[1]);
            [
                words[0].wrapping_add((x * a) << 16),
                words[1].wrapping_add((x * b + y * c) << 16),
            ]
        };
        let mean = self.mean.map(|m| (m >> 30) * i64::from(self.ear_mean));
        let [e0, e1, e2] = self.ears.map(i64::from);
        let [p, q] = normals;
        let left = [(p[0] * e0) >> 30, (p[1] * e0) >> 30];
        let right = [(p[0] * e1 + q[0] * e2) >> 30, (p[1] * e1 + q[1] * e2) >> 30];
        StrikeWords {
            left: ear(mean, left),
            right: ear(mean, right),
        }
    }
}

impl Tuning {
    /// Mean and second moments of both words of a bubble of amplitude 1, over a birth at any time in the sample.
    fn moments(&self, sample_rate: f64) -> ([f64; 2], [f64; 3]) {
        if self.form == Form::Silent {
            return ([0.0; 2], [1.0, 0.0, 0.0]);
        }
        let (log, factor) = self.pole(sample_rate);
        // A bubble is struck as it would have been at the sample before: w^f with w = 1/z.
        let log = Complex {
            re: -log.re,
            im: -log.im,
        };
        let exp = |c: Complex| Complex {
            re: libm::exp(c.re) * libm::cos(c.im),
            im: libm::exp(c.re) * libm::sin(c.im),
        };
        let minus_one = |c: Complex| Complex {
            re: c.re - 1.0,
            im: c.im,
        };
        let double = Complex {
            re: 2.0 * log.re,
            im: 2.0 * log.im,
        };
        let mean = minus_one(exp(log)).div(log);
        let square = minus_one(exp(double)).div(double);
        let energy = libm::expm1(double.re) / double.re;
        let one = Complex { re: 1.0, im: 0.0 };
        let product = |a: Complex, b: Complex| {
            let conj = Complex {
                re: b.re,
                im: -b.im,
            };
            0.5 * (a.mul(conj).re * energy - a.mul(b).mul(square).re)
        };
        (
            [mean.im, factor.mul(mean).im],
            [
                product(one, one),
                product(one, factor),
                product(factor, factor),
            ],
        )
    }
}

/// Takes pressure from what there is room for. False where that is not enough.
#[inline(always)]
fn take(room: &mut u32, pressure: u32) -> bool {
    let fits = pressure <= *room;
    if fits {
        *room -= pressure;
    }
    fits
}

/// One set of resonators.
#[derive(Clone, Debug)]
struct Bank {
    tuning: [Tuning; CLASSES],
    state: [State; CLASSES],
    /// Which of them ring, and how many.
    ringing: [bool; CLASSES],
    count: usize,
}

impl Bank {
    fn new() -> Self {
        Self {
            tuning: [Tuning::SILENT; CLASSES],
            state: [State::SILENT; CLASSES],
            ringing: [false; CLASSES],
            count: 0,
        }
    }

    /// Ends class `k`'s block, whose words are so far out: how far it may swing from here, bus units.
    #[inline(always)]
    fn settle(&mut self, k: usize, extent: u32) -> u64 {
        let rings = !self.tuning[k].is_inaudible(extent);
        let rang = core::mem::replace(&mut self.ringing[k], rings);
        if rings != rang {
            self.count = self.count + usize::from(rings) - usize::from(rang);
        }
        if rings {
            self.tuning[k].swing(extent)
        } else {
            self.state[k] = State::SILENT;
            0
        }
    }

    /// How far all classes may swing from here at most, bus units.
    fn swing(&self) -> u64 {
        (self.state.iter().zip(&self.tuning))
            .map(|(state, tuning)| tuning.swing(state.loudest() + 7))
            .sum()
    }

    /// Everything half as loud.
    #[inline(never)]
    fn halve(&mut self) {
        self.state.iter_mut().for_each(State::halve);
    }

    /// Rings on with no births. Returns how far it may swing from here, bus units.
    fn ring_out(&mut self, hits: &mut Hits, out: &mut Block) -> u64 {
        let mut swing = 0;
        if self.count > 0 {
            for k in 0..CLASSES {
                swing += self.ring_on(k, hits, out);
            }
        }
        swing
    }

    /// Class `k` for a block without births.
    #[inline(always)]
    fn ring_on(&mut self, k: usize, hits: &mut Hits, out: &mut Block) -> u64 {
        if !self.ringing[k] {
            return 0;
        }
        hits.begin(self.tuning[k].form);
        self.ring(k, hits, out)
    }

    /// Rings for a block, struck by `hits`.
    #[inline(always)]
    fn ring(&mut self, k: usize, hits: &mut Hits, out: &mut Block) -> u64 {
        let extent = ring(&self.tuning[k], &mut self.state[k], hits, true, out);
        self.settle(k, extent)
    }

    /// Class `k` for a block with few births: the resonator runs from one to the next.
    #[inline(never)]
    fn ring_with<S, O>(
        &mut self,
        k: usize,
        births: &mut Births<'_, S, O>,
        hits: &mut Hits,
        out: &mut Block,
    ) -> u64
    where
        S: AsRef<[Voice]> + AsMut<[Voice]>,
        O: Observer,
    {
        let (tuning, state) = (&self.tuning[k], &mut self.state[k]);
        let mut drawn = match births.play(k, tuning, state, out) {
            Outcome::Rung(extent) => return self.settle(k, extent),
            Outcome::Drawn(drawn) => drawn,
        };
        let mut struck = self.ringing[k];
        let mut room = births.source.room.min(STRIKES_MAX);
        hits.begin(tuning.form);
        loop {
            births.strike(k, drawn.count, &mut room, |sample, impulse| {
                hits.push(sample, impulse);
            });
            struck |= !hits.is_empty();
            if !births.goes_on(k, drawn) {
                break;
            }
            ring(tuning, state, hits, false, out);
            drawn = births.draw(k);
        }
        births.source.room -= births.source.room.min(STRIKES_MAX) - room;
        if struck { self.ring(k, hits, out) } else { 0 }
    }

    /// Many births, gathered before.
    #[inline(always)]
    fn ring_struck(&mut self, k: usize, strikes: &Strikes, out: &mut Block) -> u64 {
        run_struck(&self.tuning[k], &mut self.state[k], strikes, out);
        self.settle(k, self.state[k].extent())
    }

    /// The same for class `k` and the next one, of the same form.
    #[inline(always)]
    fn ring_struck_pair(&mut self, k: usize, strikes: &[Strikes; 2], out: &mut Block) -> u64 {
        let (one, two) = self.state.split_at_mut(k + 1);
        let tuning = [&self.tuning[k], &self.tuning[k + 1]];
        run_two_struck(tuning, [&mut one[k], &mut two[0]], strikes, out);
        self.settle(k, self.state[k].extent()) + self.settle(k + 1, self.state[k + 1].extent())
    }
}

/// The population's state.
#[derive(Clone, Debug)]
pub struct Population {
    settings: Settings,
    /// Births expected until the next one of a class, over ln 2, in its flow's units.
    clock: [u64; CLASSES],
    source: Source,
    /// Births go to `banks[live]`; the other holds what rings on from before the last retuning.
    banks: [Bank; 2],
    live: usize,
    /// Births that a block may have.
    births_per_block: u32,
    /// How far all classes may swing from here, bus units.
    swing: u32,
    /// Whether there are births at all.
    flows: bool,
    hits: Hits,
}

impl Population {
    /// A silent population; `births_per_block` bounds the work of a block.
    pub fn new(seed: u64, births_per_block: u32) -> Self {
        let mut random = Random::new(seed, Stream::Population);
        let settings = Settings::new();
        Self {
            clock: [(); CLASSES].map(|()| settings.flow[0].stroke.gap(random.bits())),
            settings,
            source: Source::new(random),
            banks: [Bank::new(), Bank::new()],
            live: 0,
            births_per_block,
            swing: 0,
            flows: false,
            hits: Hits::new(),
        }
    }

    /// Takes new settings. New radii are a new bank: what rings in the old one rings out there.
    pub fn apply(&mut self, settings: &Settings) {
        if settings.generation != self.settings.generation {
            let old = &mut self.banks[self.live];
            old.tuning = self.settings.retired;
            self.live ^= 1;
            let new = &mut self.banks[self.live];
            *new = Bank::new();
            new.tuning = settings.tuning;
        }
        for (clock, (old, new)) in
            (self.clock.iter_mut()).zip(self.settings.flow.iter().zip(&settings.flow))
        {
            *clock = *clock << new.scale.saturating_sub(old.scale)
                >> old.scale.saturating_sub(new.scale);
        }
        self.settings.clone_from(settings);
        self.flows =
            (settings.flow.iter()).any(|flow| flow.stroke.per_block > 0 || flow.crowd.is_some());
    }

    /// Whether nothing rings.
    pub fn is_silent(&self) -> bool {
        self.banks.iter().all(|bank| bank.count == 0)
    }

    /// Renders one block that begins at `frame` into a silent `out`; rising bubbles go to `voices`.
    #[inline]
    pub fn render<S, O>(
        &mut self,
        frame: u64,
        voices: &mut Voices<S>,
        stats: &mut Stats,
        observer: &mut O,
        out: &mut Block,
    ) where
        S: AsRef<[Voice]> + AsMut<[Voice]>,
        O: Observer,
    {
        self.source.room = self.room();
        self.source.left = self.births_per_block;
        let hits = &mut self.hits;
        let mut swing = self.banks[self.live ^ 1].ring_out(hits, out);
        let bank = &mut self.banks[self.live];
        if self.flows {
            let settings = &self.settings;
            let mut births = Births {
                frame,
                settings,
                source: &mut self.source,
                clock: &mut self.clock,
                voices,
                stats,
                observer,
            };
            let mut k = 0;
            while k < settings.classes {
                let pair = k + 1 < settings.classes
                    && settings.is_dense(k)
                    && settings.is_dense(k + 1)
                    && settings.tuning[k].form == settings.tuning[k + 1].form;
                if pair {
                    let strikes = [births.gather(k), births.gather(k + 1)];
                    swing += bank.ring_struck_pair(k, &strikes, out);
                    k += 2;
                } else if settings.is_dense(k) {
                    swing += bank.ring_struck(k, &births.gather(k), out);
                    k += 1;
                } else if births.wait(k) {
                    swing += bank.ring_on(k, hits, out);
                    k += 1;
                } else {
                    swing += bank.ring_with(k, &mut births, hits, out);
                    k += 1;
                }
            }
            let births = u64::from(self.births_per_block - self.source.left);
            stats.births = stats.births.wrapping_add(births);
        } else {
            swing += bank.ring_out(hits, out);
        }
        if swing > SWING_MAX / 2 {
            swing = self.hold(stats);
        }
        self.swing = swing as u32;
    }

    /// Keeps the swing of all classes inside its limit.
    #[inline(never)]
    fn hold(&mut self, stats: &mut Stats) -> u64 {
        let mut swing: u64 = self.banks.iter().map(Bank::swing).sum();
        while swing > SWING_MAX {
            // Far beyond full scale: everything gives way at once, rather than wrap.
            self.banks.iter_mut().for_each(Bank::halve);
            swing /= 2;
            stats.overloads = stats.overloads.wrapping_add(1);
        }
        swing
    }

    /// Pressure that this block's births may come to, Q27 of a pascal: what with pan (√2) and growth before the birth
    /// (1.13) keeps the sum of all classes inside an i32.
    fn room(&self) -> u32 {
        let left = 30 * PASCAL as u32 - self.swing;
        // 5/8 < 1/(1.13·√2), and Q26 to Q27.
        left / 8 * 10
    }
}

/// Where the bubbles of one block come from and go to.
struct Births<'a, S, O> {
    frame: u64,
    settings: &'a Settings,
    source: &'a mut Source,
    clock: &'a mut [u64; CLASSES],
    voices: &'a mut Voices<S>,
    stats: &'a mut Stats,
    observer: &'a mut O,
}

impl<'a, S, O> Births<'a, S, O>
where
    S: AsRef<[Voice]> + AsMut<[Voice]>,
    O: Observer,
{
    /// All births of class `k` in this block.
    #[inline(always)]
    fn gather(&mut self, k: usize) -> Strikes {
        let mut strikes: Strikes = [StrikeWords::default(); BLOCK];
        let settings = self.settings;
        let form = settings.tuning[k].form;
        let mut room = self.source.room.min(STRIKES_MAX);
        if let Some(crowd) = &settings.flow[k].crowd {
            self.crowd(k, crowd, &mut room, &mut strikes);
        }
        loop {
            let drawn = self.draw(k);
            self.strike(k, drawn.count, &mut room, |sample, impulse| {
                strikes[sample].add(form.strike(impulse));
            });
            if !self.goes_on(k, drawn) {
                break;
            }
        }
        self.source.room -= self.source.room.min(STRIKES_MAX) - room;
        strikes
    }

    /// Whether class `k` has no birth in this block; then its clock is set for the next one.
    #[inline(always)]
    fn wait(&mut self, k: usize) -> bool {
        let clock = &mut self.clock[k];
        let per_block = u64::from(self.settings.flow[k].stroke.per_block);
        let waits = *clock >= per_block;
        if waits {
            *clock -= per_block;
        }
        waits
    }

    /// Draws class `k`'s births in this block; where they are nothing out of the ordinary, the class rings with them too.
    #[inline(always)]
    fn play(&mut self, k: usize, tuning: &Tuning, state: &mut State, out: &mut Block) -> Outcome {
        if self.observer.watches_births() {
            return Outcome::Drawn(self.draw(k));
        }
        let stroke = &self.settings.flow[k].stroke;
        play(tuning, state, stroke, &mut self.clock[k], self.source, out)
    }

    /// Draws births of class `k` in this block.
    #[inline(always)]
    fn draw(&mut self, k: usize) -> Drawn {
        let stroke = &self.settings.flow[k].stroke;
        let watched = self.observer.watches_births();
        let silent_below = if watched { 0 } else { stroke.silent_below };
        self.source.draw(stroke, &mut self.clock[k], silent_below)
    }

    /// Whether there may be more births of class `k` in this block than those drawn. Where the block is full, the next
    /// one begins with a birth.
    #[inline(always)]
    fn goes_on(&mut self, k: usize, drawn: Drawn) -> bool {
        let full = drawn.more && self.source.left == 0;
        if full {
            self.stats.late = self.stats.late.wrapping_add(1);
            self.clock[k] = 0;
        }
        drawn.more && !full
    }

    /// What becomes of the bubbles drawn last: each a voice if it rises and finds one; else `hit` is told what the class
    /// is struck with, and after which sample.
    #[inline(always)]
    fn strike(
        &mut self,
        k: usize,
        count: usize,
        room: &mut u32,
        mut hit: impl FnMut(usize, Impulse),
    ) {
        let (flow, tuning) = (&self.settings.flow[k], &self.settings.tuning[k]);
        let stroke = &flow.stroke;
        for i in 0..count {
            let [position, bits] = self.source.drawn[i];
            let mut draw = bits;
            if flow.crowd.is_some() {
                // The crowd has the softer ones.
                draw = stroke.still + high(bits, u32::MAX - stroke.still);
            }
            if tuning.form == Form::Silent {
                self.stats.too_high = self.stats.too_high.wrapping_add(1);
                self.report(k, position, [0; 2], Path::TooHigh);
                continue;
            }
            let soft = stroke.softness(draw);
            let pan = stroke.pan(bits);
            let rises = stroke.still < ALL_STILL && draw > stroke.still;
            if rises && self.voice(k, position, soft, pan) {
                continue;
            }
            if draw < stroke.silent_below || (rises && soft > flow.inaudible) {
                self.report(k, position, [0; 2], Path::Class);
                continue;
            }
            let (impulse, pressure) = stroke.impulse(tuning, position, soft, pan);
            if !take(room, pressure >> 2) {
                self.stats.overloads = self.stats.overloads.wrapping_add(1);
                self.report(k, position, [0; 2], Path::Dropped);
                continue;
            }
            let gain = [impulse.left, impulse.right].map(|gain| gain >> 1);
            self.report(k, position, gain, Path::Class);
            hit((position >> 27) as usize, impulse);
        }
    }

    /// Tells the observer of a birth.
    #[inline(always)]
    fn report(&mut self, k: usize, position: u32, gain: [i32; 2], path: Path) {
        let rises = path == Path::Voice;
        self.observer.birth(&Birth {
            frame: self.frame.wrapping_add(u64::from(position >> 27)),
            fraction: position & 0x07ff_ffff,
            radius: self.settings.tuning[k].radius,
            rise_factor: if rises {
                self.settings.pitch[k].rise_factor
            } else {
                0.0
            },
            gain,
            class: k as u8,
            path,
        });
    }

    /// Gives a rising bubble a voice. False where none was to be had.
    #[inline(never)]
    fn voice(&mut self, k: usize, position: u32, soft: u32, pan: [u32; 2]) -> bool {
        let flow = &self.settings.flow[k];
        let pressure = (u64::from(flow.voice_pressure) * u64::from(exp2_neg(soft))) >> 31;
        let gain = pan.map(|gain| (pressure * u64::from(gain)) >> 31);
        let gain = gain.map(|gain| gain.min(i32::MAX as u64) as i32);
        let age = (1 << 27) - (position & 0x07ff_ffff);
        let delay = (position >> 27) + 1;
        let voice = self.settings.pitch[k].start(age, delay, gain);
        let start = self.voices.start(voice);
        let stats = &mut *self.stats;
        stats.rising = stats.rising.wrapping_add(1);
        stats.stolen = stats.stolen.wrapping_add(u64::from(start == Start::Stole));
        stats.unvoiced = stats
            .unvoiced
            .wrapping_add(u64::from(start == Start::Refused));
        if start == Start::Refused {
            return false;
        }
        self.report(k, position, gain, Path::Voice);
        true
    }

    /// A block of a class with more than one birth a sample.
    #[inline(never)]
    fn crowd(&mut self, k: usize, crowd: &Crowd, room: &mut u32, strikes: &mut Strikes) {
        let tuning = &self.settings.tuning[k];
        let births = crowd.count(&mut self.source.random);
        self.stats.births = self.stats.births.wrapping_add(births);
        let mut seen = CrowdSeen {
            frame: self.frame,
            radius: tuning.radius,
            class: k as u8,
            words: StrikeWords::default(),
            births,
            path: Path::Class,
        };
        if tuning.form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(births);
            seen.path = Path::TooHigh;
        } else if !take(room, crowd.most) {
            self.stats.overloads = self.stats.overloads.wrapping_add(births);
            seen.path = Path::Dropped;
        }
        if seen.path != Path::Class {
            self.observer.crowd(&seen);
            return;
        }
        for (i, strike) in strikes.iter_mut().enumerate() {
            *strike = crowd.draw(&mut self.source.random);
            let i = i as u64;
            self.observer.crowd(&CrowdSeen {
                frame: self.frame.wrapping_add(i),
                words: *strike,
                births: births * (i + 1) / BLOCK as u64 - births * i / BLOCK as u64,
                ..seen
            });
        }
    }
}
