//! From the water's parameters to what its audio path runs on.

use super::{CLASS_MAX_PA, CLASSES, CROSSOVER, CROWD, Crowd, Flow, RETIRED_DECAY, pan};
use crate::fixed::{to_fixed, to_fixed_u64};
use crate::frame::BLOCK;
use crate::random::Random;
use crate::resonator::{Complex, Form, STRIKES_MAX, Tuning};
use crate::voices::Pitch;

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
    pub(super) law: Law,
}

/// What every birth is drawn by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law {
    /// β of `D = rnd^β`, Q26.
    pub(super) exponent: u32,
    /// A bubble rises where `-log2 D` (Q20) is below this.
    pub(super) rise_below: u32,
    /// Random numbers below this are left to the crowd, Q32.
    pub(super) crowd_below: u32,
    /// Width of the stage, 256 is full.
    pub(super) width: i32,
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
            law: Law {
                exponent: 0,
                rise_below: 0,
                crowd_below: 0,
                width: 256,
            },
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
    pub(super) fn is_dense(&self, k: usize) -> bool {
        let flow = &self.flow[k];
        flow.crowd.is_some() || flow.per_block >= CROSSOVER
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
        self.law.rise_below = if still >= 1.0 {
            0
        } else if ratio <= 0.0 {
            u32::MAX
        } else {
            // D = depth·2^-x: compare x alone. At β = 0 every x is 0.
            to_fixed(-libm::log2(ratio), 20) as u32
        };
        self.law.crowd_below = libm::round(still * 4_294_967_295.0) as u32;
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
        let per_block = to_fixed_u64(births * core::f64::consts::LOG2_E, 32);
        let shift = per_block.leading_zeros().min(63);
        let top = (per_block << shift >> 32) as u32;
        // Top is at least 2^31, or births are none.
        let inverse = if top == 0 {
            0
        } else {
            (i64::MAX as u64 / u64::from(top)) as u32
        };
        let grown = pressure * libm::exp2(f64::from(tuning.decay_over(1 << 27)) / 1_048_576.0);
        Self {
            per_block,
            inverse,
            shift,
            pressure: to_fixed_u64(grown, 27) as u32,
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
            let [left, right] = pan(draw, width).map(|gain| f64::from(gain) / 1_073_741_824.0);
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
