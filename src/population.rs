//! A population of bubbles (vdD §5): radius classes, each a Poisson process that strikes one stereo resonator.
//!
//! A class's clock holds the expected births until the next one; each block uses up what the class's rate gives, so a
//! change of rate needs no redraw. A bubble that does not rise is one impulse at its exact time between samples; a
//! rising one asks for a voice. Above one birth a sample a class is a *crowd*: its impulses are drawn by their moments.

use crate::fixed::{BUBBLE_MAX_PA, PAN, exp2_neg, neg_log2, sine_cosine, to_fixed, to_fixed_u64};
use crate::frame::{BLOCK, Block};
use crate::observer::{Birth, Crowd as CrowdSeen, Observer, Path};
use crate::random::{Random, Stream};
use crate::resonator::{Complex, Form, State, Tuning};
use crate::stats::Stats;
use crate::voices::{Pitch, Start, Voice, Voices};

/// Most radius classes.
pub const CLASSES: usize = 64;

/// ln 2, Q32.
const LN_2: u64 = 2_977_044_472;
/// Where births are denser than this a sample, a class is a crowd.
pub const CROWD: f64 = 1.0;
/// A retired bank rings out at least this fast, 1/s.
const RETIRED_DECAY: f64 = 60.0;

/// How a class is struck.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flow {
    /// Births in a block that the clock draws one by one, Q32.32.
    per_block: u64,
    /// 2^63 over the upper 32 bits of `per_block << shift`.
    inverse: u32,
    shift: u32,
    /// Pressure of a bubble of depth factor 1, one sample before it is due, Q27 of a pascal.
    pressure: i32,
    /// The same at its birth, Q28, for voices.
    voice_pressure: u32,
    crowd: Option<Crowd>,
}

/// The moments of a class with more than one birth a sample.
#[derive(Clone, Copy, Debug)]
struct Crowd {
    /// Births in a block.
    births: f32,
    /// Mean of both words in a sample, Q32.32 of bus units.
    mean: [i64; 2],
    /// Cholesky factor of both words' covariance, over the deviation of `rough_normal`, Q42 of a pascal.
    spread: [i32; 3],
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
    /// β of `D = rnd^β`, Q26.
    exponent: u32,
    /// A bubble rises where `-log2 D` (Q20) is below this.
    rise_below: u32,
    /// Random numbers below this are left to the crowd, Q32.
    crowd_below: u32,
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
            exponent: 0,
            rise_below: 0,
            crowd_below: 0,
            width: 256,
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
        self.exponent = to_fixed(drive.beta, 26) as u32;
        self.rise_below = if still >= 1.0 {
            0
        } else if ratio <= 0.0 {
            u32::MAX
        } else {
            // D = depth·2^-x: compare x alone. At β = 0 every x is 0.
            to_fixed(-libm::log2(ratio), 20) as u32
        };
        self.crowd_below = libm::round(still * 4_294_967_295.0) as u32;
        self.width = libm::round(drive.width * 256.0) as i32;
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
            let pressure = (drive.depth * pressure).min(f64::from(BUBBLE_MAX_PA));
            let still_births = births * still;
            if still_births > CROWD * BLOCK as f64 {
                *flow = Flow::new(births - still_births, pressure, tuning);
                let sound = [pressure, drive.beta, drive.width];
                flow.crowd = Some(Crowd::new(still_births, sound, still, tuning, sample_rate));
            } else {
                *flow = Flow::new(births, pressure, tuning);
            }
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::new()
    }
}

impl Flow {
    fn new(births: f64, pressure: f64, tuning: &Tuning) -> Self {
        let per_block = to_fixed_u64(births, 32);
        let shift = per_block.leading_zeros().min(63);
        let top = (per_block << shift >> 32) as u32;
        // Top is at least 2^31, or births are none.
        let inverse = if top == 0 {
            0
        } else {
            ((1u64 << 63) / u64::from(top)).min(u64::from(u32::MAX)) as u32
        };
        let grown = pressure * libm::exp2(f64::from(tuning.decay_over(1 << 27)) / 1_048_576.0);
        Self {
            per_block,
            inverse,
            shift,
            pressure: to_fixed(grown.min(f64::from(BUBBLE_MAX_PA)), 27),
            voice_pressure: to_fixed_u64(pressure, 28) as u32,
            crowd: None,
        }
    }

    /// Where in the block the clock stands: the sample's index in the upper 5 bits, then the fraction, Q27.
    #[inline(always)]
    fn position(&self, clock: u64) -> u32 {
        let top = (clock << self.shift >> 32) as u32;
        let ratio = (u64::from(top) * u64::from(self.inverse)) >> 31;
        ratio.min(u64::from(u32::MAX)) as u32
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
        let deviation =
            pressure * libm::sqrt(per_sample * second) / Random::ROUGH_DEVIATION;
        // Pan is uniform over the width; sums over the audio path's own table.
        let width = libm::round(width * 256.0) as i32;
        let (mut mean, mut own, mut shared) = (0.0, 0.0, 0.0);
        for draw in 0..256 {
            let [left, right] = pan(draw, width).map(|gain| f64::from(gain) / 1_073_741_824.0);
            mean += left / 256.0;
            own += left * left / 256.0;
            shared += left * right / 256.0;
        }
        let e0 = libm::sqrt(own);
        let e1 = shared / e0;
        let e2 = libm::sqrt((own - e1 * e1).max(0.0));
        let level = pressure * per_sample * first;
        Self {
            births: births as f32,
            // Far beyond what a resonator holds both are cut, so that the sums cannot overflow.
            mean: words_mean.map(|m| libm::scalbn((level * m).clamp(-4.0, 4.0), 58) as i64),
            spread: [a, b, c].map(|f| to_fixed(f * deviation, 42).clamp(-(1 << 28), 1 << 28)),
            ear_mean: to_fixed(mean, 30),
            ears: [e0, e1, e2].map(|e| to_fixed(e, 30)),
        }
    }

    /// One sample's impulses, for both ears.
    #[inline(always)]
    fn draw(&self, random: &mut Random) -> ([i64; 2], [i64; 2]) {
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
        let right = [
            (p[0] * e1 + q[0] * e2) >> 30,
            (p[1] * e1 + q[1] * e2) >> 30,
        ];
        (ear(mean, left), ear(mean, right))
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
        let log = Complex { re: -log.re, im: -log.im };
        let exp = |c: Complex| Complex {
            re: libm::exp(c.re) * libm::cos(c.im),
            im: libm::exp(c.re) * libm::sin(c.im),
        };
        let minus_one = |c: Complex| Complex { re: c.re - 1.0, im: c.im };
        let double = Complex { re: 2.0 * log.re, im: 2.0 * log.im };
        let mean = minus_one(exp(log)).div(log);
        let square = minus_one(exp(double)).div(double);
        let energy = libm::expm1(double.re) / double.re;
        let one = Complex { re: 1.0, im: 0.0 };
        let product = |a: Complex, b: Complex| {
            let conj = Complex { re: b.re, im: -b.im };
            0.5 * (a.mul(conj).re * energy - a.mul(b).mul(square).re)
        };
        (
            [mean.im, factor.mul(mean).im],
            [product(one, one), product(one, factor), product(factor, factor)],
        )
    }
}

/// Gains of both ears, Q30, from 8 random bits and the width (256: full).
#[inline(always)]
fn pan(draw: u32, width: i32) -> [i32; 2] {
    let at = (128 + ((2 * draw as i32 - 255) * width + 256 >> 9)).clamp(0, 256) as usize;
    [PAN[256 - at], PAN[at]]
}

/// One set of resonators.
#[derive(Clone, Debug)]
struct Bank {
    tuning: [Tuning; CLASSES],
    state: [State; CLASSES],
    /// Which of them ring, a bit each.
    ringing: u64,
}

impl Bank {
    fn new() -> Self {
        Self {
            tuning: [Tuning::SILENT; CLASSES],
            state: [State::SILENT; CLASSES],
            ringing: 0,
        }
    }

    fn settle(&mut self, k: usize) {
        if self.state[k].settle(&self.tuning[k]) {
            self.ringing &= !(1 << k);
        }
    }

    /// Rings on with no births.
    fn ring_out(&mut self, out: &mut Block) {
        let mut left = self.ringing;
        while left != 0 {
            let k = left.trailing_zeros() as usize;
            left &= left - 1;
            self.state[k].run(&self.tuning[k], out);
            self.settle(k);
        }
    }
}

/// The population's state.
#[derive(Clone, Debug)]
pub struct Population {
    settings: Settings,
    /// Births expected until the next one of a class, Q32.32.
    clock: [u64; CLASSES],
    random: Random,
    /// Births go to `banks[live]`; the other holds what rings on from before the last retuning.
    banks: [Bank; 2],
    live: usize,
    /// Births left that a block may have.
    births_per_block: u32,
}

impl Population {
    /// A silent population; `births_per_block` bounds the work of a block.
    pub fn new(seed: u64, births_per_block: u32) -> Self {
        let mut random = Random::new(seed, Stream::Population);
        Self {
            settings: Settings::new(),
            clock: [(); CLASSES].map(|()| gap(random.bits())),
            random,
            banks: [Bank::new(), Bank::new()],
            live: 0,
            births_per_block,
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
        self.settings.clone_from(settings);
    }

    /// Whether nothing rings.
    pub fn is_silent(&self) -> bool {
        self.banks.iter().all(|bank| bank.ringing == 0)
    }

    /// Adds one block that begins at `frame`; rising bubbles go to `voices`.
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
        self.banks[self.live ^ 1].ring_out(out);
        let mut births_left = self.births_per_block;
        for k in 0..self.settings.classes {
            let mut class = Class {
                k,
                frame,
                settings: &self.settings,
                bank: &mut self.banks[self.live],
                random: &mut self.random,
                clock: &mut self.clock[k],
                births_left: &mut births_left,
                voices,
                stats,
                observer,
            };
            class.render(out);
        }
    }
}

/// Births expected until the next one, from 32 random bits: −ln(rnd), Q32.32.
#[inline(always)]
fn gap(bits: u32) -> u64 {
    (u64::from(neg_log2(bits)) * LN_2) >> 26
}

/// One class for the time of one block.
struct Class<'a, S, O> {
    k: usize,
    frame: u64,
    settings: &'a Settings,
    bank: &'a mut Bank,
    random: &'a mut Random,
    clock: &'a mut u64,
    births_left: &'a mut u32,
    voices: &'a mut Voices<S>,
    stats: &'a mut Stats,
    observer: &'a mut O,
}

impl<S, O> Class<'_, S, O>
where
    S: AsRef<[Voice]> + AsMut<[Voice]>,
    O: Observer,
{
    #[inline(always)]
    fn render(&mut self, out: &mut Block) {
        let flow = &self.settings.flow[self.k];
        let mut done = 0;
        if let Some(crowd) = &flow.crowd {
            self.crowd(crowd, &mut done, out);
        }
        let mut clock = *self.clock;
        while clock < flow.per_block {
            if *self.births_left == 0 {
                // The block is full: the rest are born at the start of the next.
                self.stats.late = self.stats.late.wrapping_add(1);
                clock = flow.per_block;
                break;
            }
            *self.births_left -= 1;
            let position = flow.position(clock);
            self.birth(&mut done, position, out);
            clock += gap(self.random.bits());
        }
        *self.clock = clock - flow.per_block;
        self.ring(&mut done, BLOCK, out);
        if self.bank.ringing & (1 << self.k) != 0 {
            self.bank.settle(self.k);
        }
    }

    /// Lets the class ring up to frame `until`.
    #[inline(always)]
    fn ring(&mut self, done: &mut usize, until: usize, out: &mut Block) {
        if self.bank.ringing & (1 << self.k) != 0 {
            let tuning = &self.bank.tuning[self.k];
            self.bank.state[self.k].run(tuning, &mut out[*done..until]);
        }
        *done = until;
    }

    /// One bubble: a voice if it rises and finds one, else an impulse into its class.
    #[inline(always)]
    fn birth(&mut self, done: &mut usize, position: u32, out: &mut Block) {
        let Settings { exponent, rise_below, crowd_below, width, .. } = *self.settings;
        let flow = &self.settings.flow[self.k];
        // What a crowd's class is struck with beside the crowd waits for the end of the block.
        let sample = ((position >> 27) as usize).max(done.saturating_sub(1));
        let fraction = position & 0x07ff_ffff;
        let bits = self.random.bits();
        let mut draw = bits;
        if flow.crowd.is_some() {
            // The crowd has the softer ones.
            let span = u64::from(u32::MAX - crowd_below);
            draw = crowd_below + ((u64::from(bits) * span) >> 32) as u32;
        }
        // -log2 D, Q20.
        let soft = ((u64::from(neg_log2(draw)) * u64::from(exponent)) >> 32) as u32;
        // The lowest bits are the generator's weakest: pan takes eight above them.
        let [left, right] = pan(bits >> 4 & 0xff, width);
        let at = |gain: i32, pressure: i32| {
            ((i64::from(pressure) * i64::from(gain)) >> 30).min(i64::from(i32::MAX)) as i32
        };
        self.stats.births = self.stats.births.wrapping_add(1);
        let mut birth = Birth {
            frame: self.frame.wrapping_add(sample as u64),
            fraction,
            radius: self.bank.tuning[self.k].radius,
            rise_factor: 0.0,
            gain: [0; 2],
            class: self.k as u8,
            path: Path::Class,
        };
        let tuning = &self.bank.tuning[self.k];
        if tuning.form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(1);
            birth.path = Path::TooHigh;
            self.observer.birth(&birth);
            return;
        }
        if soft < rise_below {
            let pitch = &self.settings.pitch[self.k];
            let pressure = ((u64::from(flow.voice_pressure) * u64::from(exp2_neg(soft))) >> 31)
                .min(i32::MAX as u64) as i32;
            let gain = [at(left, pressure), at(right, pressure)];
            let age = (1 << 27) - fraction;
            let start = self.voices.start(pitch.start(age, sample as u32 + 1, gain));
            self.stats.rising = self.stats.rising.wrapping_add(1);
            if start != Start::Refused {
                if start == Start::Stole {
                    self.stats.stolen = self.stats.stolen.wrapping_add(1);
                }
                birth.rise_factor = pitch.rise_factor;
                birth.gain = gain;
                birth.path = Path::Voice;
                self.observer.birth(&birth);
                return;
            }
            self.stats.unvoiced = self.stats.unvoiced.wrapping_add(1);
        }
        let decayed = soft + tuning.decay_over((1 << 27) - fraction);
        let pressure =
            ((i64::from(flow.pressure) * i64::from(exp2_neg(decayed))) >> 31) as i32;
        let (left, right) = (at(left, pressure), at(right, pressure));
        birth.gain = [left, right];
        self.observer.birth(&birth);
        if left | right == 0 {
            return;
        }
        let words = tuning.words(sine_cosine(tuning.phase_over(fraction).wrapping_neg()));
        self.ring(done, sample + 1, out);
        let state = &mut self.bank.state[self.k];
        if state.strike(&self.bank.tuning[self.k], left, right, words) {
            self.stats.overloads = self.stats.overloads.wrapping_add(1);
        }
        self.bank.ringing |= 1 << self.k;
    }

    /// A block of a class with more than one birth a sample.
    #[inline(never)]
    fn crowd(&mut self, crowd: &Crowd, done: &mut usize, out: &mut Block) {
        let k = self.k;
        // Poisson by its first three moments; 32 births or more make that exact enough to count with.
        let normal = f64::from(self.random.rough_normal()) / Random::ROUGH_DEVIATION;
        let mean = f64::from(crowd.births);
        let drawn = mean + libm::sqrt(mean) * normal + (normal * normal - 1.0) / 6.0;
        let births = libm::round(drawn).max(0.0) as u64;
        self.stats.births = self.stats.births.wrapping_add(births);
        if self.bank.tuning[k].form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(births);
            return;
        }
        self.bank.ringing |= 1 << k;
        for i in *done..BLOCK {
            let (left, right) = crowd.draw(self.random);
            self.observer.crowd(&CrowdSeen {
                frame: self.frame.wrapping_add(i as u64),
                radius: self.bank.tuning[k].radius,
                class: k as u8,
                left,
                right,
                births: births * (i as u64 + 1) / BLOCK as u64 - births * i as u64 / BLOCK as u64,
            });
            self.ring(done, i + 1, out);
            if self.bank.state[k].add(&self.bank.tuning[k], left, right) {
                self.stats.overloads = self.stats.overloads.wrapping_add(1);
            }
        }
    }
}
