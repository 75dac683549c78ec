//! From the water's parameters to what its audio path runs on. Nothing here is pitch or decay, so f32 is enough; a
//! microcontroller does this at every tick while a wave passes.

use core::f32::consts::LOG2_E;

use super::tuner::{Radii, UnitImpulse};
use super::{CLASS_MAX_PA, CLASSES, CROSSOVER, CROWD, Crowd};
use crate::fixed::{exp2_neg, neg_log2, pan, reciprocal};
use crate::frame::BLOCK;
use crate::kernel::{ALL_STILL, Flow, Stroke};
use crate::random::Random;
use crate::resonator::STRIKES_MAX;

const Q26: f32 = (1u64 << 26) as f32;
const Q27: f32 = (1u64 << 27) as f32;
const Q28: f32 = (1u64 << 28) as f32;
const Q30: f32 = (1u64 << 30) as f32;
const Q32: f32 = (1u64 << 32) as f32;
const Q42: f32 = (1u64 << 42) as f32;

/// What the audio path needs of the water's parameters. `C` is where crowds live: an array as large as a board's rate
/// asks for; everything works on it as a slice.
#[derive(Clone, Debug)]
pub struct Settings<C: ?Sized = [Crowd]> {
    /// Classes in use.
    pub(super) classes: usize,
    /// Whether there are births at all.
    pub(super) flows: bool,
    /// How each class is struck.
    pub(super) flow: [Flow; CLASSES],
    pub(super) law: Law,
    pub(super) ears: Ears,
    pub(super) crowds: C,
}

/// What every birth is drawn by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law {
    /// β of `D = rnd^β`, Q26.
    pub(super) exponent: u32,
    /// A bubble rises where its random number is above this, Q32; the others may be left to a crowd.
    pub(super) still: u32,
    /// Width of the stage, 256 is full.
    pub(super) width: i32,
}

/// How a crowd is spread over both ears: mean gain of an ear, and the Cholesky factor of the covariance between ears,
/// Q30.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ears {
    pub(super) mean: i32,
    pub(super) factor: [i32; 3],
}

/// The parameters of the water that are not its radii; see the parameter table for units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Births a second.
    pub rate: f32,
    /// Exponent of the fall of births with radius.
    pub gamma: f32,
    /// Each class's births beside that, any scale.
    pub weight: [f32; CLASSES],
    /// Exponent of the pressure's growth with radius.
    pub alpha: f32,
    /// Exponent of the depth factor.
    pub beta: f32,
    /// Largest depth factor.
    pub depth: f32,
    /// Bubbles whose depth factor is above this rise.
    pub rise_cutoff: f32,
    /// Whether any bubble rises.
    pub rises: bool,
    /// Pressure at 1 m of a bubble of 1 mm and depth factor 1, Pa.
    pub pressure: f32,
    /// From 0 to 1.
    pub width: f32,
}

impl<const N: usize> Settings<[Crowd; N]> {
    /// No water at all.
    pub const fn new() -> Self {
        Self {
            classes: 0,
            flows: false,
            flow: [Flow::NONE; CLASSES],
            law: Law::NONE,
            ears: Ears::MONO,
            crowds: [Crowd::NONE; N],
        }
    }
}

impl<const N: usize> Default for Settings<[Crowd; N]> {
    fn default() -> Self {
        Self::new()
    }
}

impl Settings {
    /// The crowd of a class, where it is one.
    #[inline(always)]
    pub(super) fn crowd(&self, k: usize) -> Option<&Crowd> {
        self.crowds
            .get((self.flow[k].crowd as usize).wrapping_sub(1))
    }

    /// Whether a class's births are gathered before its resonator runs.
    #[inline(always)]
    pub(super) fn is_dense(&self, k: usize) -> bool {
        let flow = &self.flow[k];
        flow.is_crowd() || CROSSOVER.is_some_and(|least| flow.scale <= 31 - least)
    }

    /// Strikes classes of `radii`, for whose bubbles `impulses` stand, as `drive` says. `sample_rate` in Hz.
    pub fn drive(
        &mut self,
        drive: &Drive,
        radii: &Radii,
        impulses: &[UnitImpulse; CLASSES],
        sample_rate: f32,
    ) {
        self.classes = radii.classes;
        // Powers of evenly spaced radii are geometric series.
        let (mut falling, fall) = radii.power(-drive.gamma);
        let mut weight = [0.0; CLASSES];
        let mut total = 0.0;
        for (weight, own) in weight[..radii.classes].iter_mut().zip(&drive.weight) {
            *weight = own * falling;
            total += *weight;
            falling *= fall;
        }
        let scale = if total > 0.0 {
            drive.rate * BLOCK as f32 / (sample_rate * total)
        } else {
            0.0
        };
        let risen = drive.risen();
        let width = libm::roundf(drive.width * 256.0) as i32;
        if width != self.law.width {
            self.ears = Ears::new(width);
        }
        self.law = Law::new(drive, risen, width);
        let still = Still::new(drive.beta, risen);
        let (mut growing, growth) = radii.power(drive.alpha);
        growing *= drive.depth * drive.pressure;
        let mut crowds = 0;
        self.flows = false;
        for (k, flow) in self.flow.iter_mut().enumerate() {
            if k >= radii.classes {
                *flow = Flow::NONE;
                continue;
            }
            let births = weight[k] * scale;
            let pressure = growing.min(CLASS_MAX_PA);
            growing *= growth;
            let crowd = births * (1.0 - risen);
            if crowd > CROWD * BLOCK as f32 && crowds < self.crowds.len() {
                *flow = Flow::new(births * risen, pressure, &impulses[k], &self.law);
                self.crowds[crowds] = Crowd::new(crowd, pressure, &still, &impulses[k]);
                crowds += 1;
                flow.crowd = crowds as u32;
            } else {
                *flow = Flow::new(births, pressure, &impulses[k], &self.law);
                if impulses[k].step != 0 {
                    flow.stroke.silent_below = self.law.silent_below(flow.inaudible);
                }
            }
            self.flows |= flow.stroke.per_block > 0 || flow.is_crowd();
        }
    }
}

impl Drive {
    /// No births.
    pub const NONE: Self = Self {
        rate: 0.0,
        gamma: 0.0,
        weight: [0.0; CLASSES],
        alpha: 0.0,
        beta: 0.0,
        depth: 0.0,
        rise_cutoff: 0.0,
        rises: false,
        pressure: 0.0,
        width: 0.0,
    };

    /// `rise_cutoff / depth`: a bubble of depth factor `depth·x` rises where x is above this.
    fn cutoff(&self) -> f32 {
        if self.depth > 0.0 {
            self.rise_cutoff / self.depth
        } else {
            1.0
        }
    }

    /// Which part of all bubbles rises: where rnd > cutoff^(1/β). Reckoned from the top, where f32 is coarse.
    fn risen(&self) -> f32 {
        let cutoff = self.cutoff();
        if !self.rises || cutoff >= 1.0 {
            0.0
        } else if self.beta == 0.0 || cutoff <= 0.0 {
            1.0
        } else {
            -libm::expm1f(libm::logf(cutoff) / self.beta)
        }
    }
}

impl Law {
    const NONE: Self = Self {
        exponent: 0,
        still: ALL_STILL,
        // As mono as `Ears::MONO`.
        width: 0,
    };

    fn new(drive: &Drive, risen: f32, width: i32) -> Self {
        Self {
            exponent: (drive.beta * Q26) as u32,
            // From the top, where f32 is coarse.
            still: ALL_STILL.saturating_sub((risen * Q32) as u32),
            width,
        }
    }

    /// Below which random numbers a bubble neither rises nor is heard, given the `-log2 D` (Q20) up to which it is.
    fn silent_below(&self, inaudible: u32) -> u32 {
        // Where -log2(rnd), Q20, times the exponent is more than that; and some units aside for what f32 rounds.
        let least = (inaudible + 1) as f32 * Q26 / self.exponent as f32;
        if least < (31 << 20) as f32 {
            (exp2_neg(least as u32 + 16) << 1).min(self.still)
        } else {
            0
        }
    }
}

impl Ears {
    /// Both hear the same: what width 0 is.
    const MONO: Self = Self {
        mean: 1 << 30,
        factor: [1 << 30, 1 << 30, 0],
    };

    /// Pan is uniform over the width: sums over the audio path's own table.
    fn new(width: i32) -> Self {
        const ONE: f32 = (1u64 << 30) as f32;
        let (mut mean, mut own, mut shared) = (0, 0, 0);
        for draw in 0..256 {
            let [left, right] = pan(draw, width, edge(width)).map(|gain| i64::from(gain >> 5));
            mean += left;
            own += left * left;
            shared += left * right;
        }
        // Q26 and Q52, 256 of them.
        let mean = mean as f32 / (1u64 << 34) as f32;
        let [own, shared] = [own, shared].map(|sum| sum as f32 / (1u64 << 60) as f32);
        let e0 = libm::sqrtf(own);
        let e1 = shared / e0;
        let e2 = libm::sqrtf((own - e1 * e1).max(0.0));
        Self {
            mean: (mean * ONE) as i32,
            factor: [e0, e1, e2].map(|e| (e * ONE) as i32),
        }
    }
}

/// Where the left edge of a stage of `width` is, Q8.
fn edge(width: i32) -> i32 {
    (128 << 8) - (width << 7)
}

impl Flow {
    /// `births` in a block, of `pressure` Pa.
    fn new(births: f32, pressure: f32, impulse: &UnitImpulse, law: &Law) -> Self {
        let wide = (births * LOG2_E * Q32 + 0.5) as u64;
        // So that a block is 2^31 units or more, unless years pass without a birth.
        let scale = wide.leading_zeros().min(57);
        let per_block = (wide << scale >> 32) as u32;
        let grown = (pressure * impulse.growth * Q30) as u32;
        Self {
            stroke: Stroke {
                per_block,
                gap: 1 << scale.saturating_sub(26),
                stretch: if per_block >> 31 == 0 {
                    u32::MAX
                } else {
                    // 2^32 is left out by itself.
                    reciprocal(per_block) << 1
                },
                silent_below: 0,
                still: law.still,
                exponent: law.exponent,
                decay: impulse.decay,
                step: impulse.step,
                width: law.width,
                edge: edge(law.width),
                pressure: grown,
                second: impulse.second,
                coarse: 26u32.saturating_sub(scale),
            },
            scale: scale as u8,
            crowd: 0,
            // Down to 2^-28 Pa.
            inaudible: if grown == 0 {
                0
            } else {
                (30_u32 << 20).saturating_sub(neg_log2(grown) >> 6)
            },
            voice_pressure: (pressure * Q28) as u32,
        }
    }
}

/// The still bubbles of a crowd: moments of D over the random numbers below `1 - risen`, per still birth; depth is in
/// the pressure.
struct Still {
    first: f32,
    second: f32,
}

impl Still {
    fn new(beta: f32, risen: f32) -> Self {
        let still = 1.0 - risen;
        Self {
            first: libm::powf(still, beta) / (beta + 1.0),
            second: libm::powf(still, 2.0 * beta) / (2.0 * beta + 1.0),
        }
    }
}

impl Crowd {
    /// `births` in a block, of `pressure` Pa.
    fn new(births: f32, pressure: f32, still: &Still, impulse: &UnitImpulse) -> Self {
        const ROUGH_DEVIATION: f32 = Random::ROUGH_DEVIATION as f32;
        let per_sample = births / BLOCK as f32;
        let deviation = pressure * libm::sqrtf(per_sample * still.second) / ROUGH_DEVIATION;
        let level = pressure * per_sample * still.first;
        // The rough normal number ends at 3.47 deviations; two of them make the second word.
        let most = BLOCK as f32 * 1.5 * (level + 2.0 * 3.47 * ROUGH_DEVIATION * deviation);
        // What the resonator cannot take is held down.
        let hold = (STRIKES_MAX as f32 / Q27 / most).min(1.0);
        Self {
            births: (births * Q32) as i64,
            births_spread: (libm::sqrtf(births) / ROUGH_DEVIATION * Q32) as u32,
            mean: impulse.mean.map(|m| (level * hold * m * Q28) as i32),
            spread: impulse
                .spread
                .map(|factor| (factor * hold * deviation * Q42) as i32),
            most: (hold * most * Q27) as u32,
        }
    }
}
