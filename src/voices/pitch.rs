//! What a voice is started with.

use super::voice::{ENVELOPE_FLOOR, Voice};
use crate::bubble::Ringing;
use crate::fixed::{high, to_fixed, to_fixed_u64};
use crate::frame::BLOCK;
use crate::kernel::voice::Tone;
use crate::resonator::PITCH_LIMIT;

/// A rising pitch stops at this multiple of where it began. From deep water to the surface the geometry of HF (6)
/// gives 1.6 to 4.3.
pub const RISE_CAP: f64 = 4.0;

/// Pitch and decay of a kind of bubble, ready for the audio path. Made in f64.
#[derive(Clone, Copy, Debug)]
pub struct Pitch {
    /// Radius, m.
    pub radius: f32,
    /// Rise factor ξ: σ = ξ·β.
    pub rise_factor: f32,
    /// Turns a sample at birth, Q64. Zero: too high to be sounded.
    begin: u64,
    /// Turns a sample at the cap, Q64.
    limit: u64,
    /// Growth of turns a sample, a sample, Q64.
    slope: u64,
    /// Samples until the cap, Q32.32.
    ramp: u64,
    /// Part of the envelope kept over a block, Q32.
    keep: u32,
    /// What the envelope gains in a sample, below 0, Q32.
    decay: i32,
    /// Decay a sample, β over the sample rate, Q32.
    beta: u32,
}

impl Pitch {
    /// A pitch that is not sounded.
    pub const SILENT: Self = Self {
        radius: 0.0,
        rise_factor: 0.0,
        begin: 0,
        limit: 0,
        slope: 0,
        ramp: 0,
        keep: 0,
        decay: 0,
        beta: 0,
    };

    /// The pitch of a bubble of `radius` metres and rise factor `rise_factor` at `rate` Hz.
    pub fn new(radius: f32, rise_factor: f32, rate: f64) -> Self {
        Self::of(&Ringing::new(radius, rate), rise_factor)
    }

    /// The pitch of a bubble of rise factor `rise_factor`.
    pub fn of(ringing: &Ringing, rise_factor: f32) -> Self {
        let Ringing {
            radius,
            turns,
            decay: beta,
            loss,
            ..
        } = *ringing;
        if turns > PITCH_LIMIT {
            return Self {
                radius,
                rise_factor,
                ..Self::SILENT
            };
        }
        let cap = (turns * RISE_CAP).min(PITCH_LIMIT);
        // Half a turn a sample each sample reaches any cap within one sample: faster is the same.
        let slope = (turns * f64::from(rise_factor) * beta).min(0.5);
        let (slope, ramp) = if slope > 0.0 {
            // A ramp of weeks is none.
            let ramp = ((cap - turns) / slope).min(2_147_483_647.0);
            (to_fixed_u64(slope, 64), to_fixed_u64(ramp, 32))
        } else {
            (0, 0)
        };
        let begin = to_fixed_u64(turns, 64);
        // Kept over a block, by squaring.
        let keep = (0..BLOCK.ilog2()).fold(1.0 - loss, |keep, _| keep * keep);
        // The cap as the fixed-point ramp reaches it, so that the pitch has no step there.
        let limit = begin + ((u128::from(slope) * u128::from(ramp)) >> 32) as u64;
        let q32 = |x: f64| to_fixed_u64(x, 32).min(u64::from(u32::MAX)) as u32;
        Self {
            radius,
            rise_factor,
            begin,
            limit,
            slope,
            ramp,
            keep: q32(keep),
            decay: to_fixed(-loss, 32).min(-1),
            beta: q32(beta),
        }
    }

    /// Whether the pitch is below [`PITCH_LIMIT`].
    pub fn sounds(&self) -> bool {
        self.begin != 0
    }

    /// Makes `voice` a bubble born `age` (Q27) of a sample before its first sample, due in `delay` frames; `gain` is its
    /// pressure in the two ears, Q28 of a pascal, and `loudest` the larger of them.
    #[inline(always)]
    pub(super) fn start(
        &self,
        voice: &mut Voice,
        delay: u32,
        age: u32,
        gain: [i32; 2],
        loudest: u32,
    ) {
        // Q32; a whole sample is as good as one.
        let age = age.min((1 << 27) - 1) << 5;
        let ramped = u64::from(age).min(self.ramp) as u32;
        let upper = |x: u64| (x >> 32) as u32;
        let slope = upper(self.slope);
        // ∫ f dt, with the corner at the cap if it comes before the first sample.
        let phase = high(upper(self.begin), ramped)
            .wrapping_add(high(high(slope, ramped), ramped) >> 1)
            .wrapping_add(high(upper(self.limit), age - ramped));
        let grown =
            u64::from(slope) * u64::from(ramped) + u64::from(high(self.slope as u32, ramped));
        // Two bus units, as a part of the gain; Q28 to Q31.
        let audible = u32::MAX / (loudest >> 2).max(1);
        voice.tone = Tone {
            calm: 0,
            envelope: exp_neg(high(self.beta, age)) >> 1,
            floor: ENVELOPE_FLOOR.max(audible),
            keep: self.keep,
            gain,
            decay: self.decay,
            loudest,
            phase: u64::from(phase) << 27,
            pitch: self.begin + grown,
            growth: 0,
        };
        voice.slope = self.slope;
        voice.limit = self.limit;
        voice.ramp = self.ramp - u64::from(ramped);
        voice.delay = delay;
        voice.fade = 0;
    }
}

/// A single bubble that is to sound.
#[derive(Clone, Copy, Debug)]
pub struct Strike {
    /// Its pitch and decay.
    pub pitch: Pitch,
    /// Frames until its first sample, at least 1.
    pub delay: u32,
    /// Its age at the first sample, in samples, Q27.
    pub age: u32,
    /// Its pressure in the two ears, Q28 of a pascal.
    pub gain: [i32; 2],
}

impl Strike {
    /// A bubble born `at` frames from now, with `gain` in the two ears, Q28 of a pascal.
    pub fn new(pitch: Pitch, at: f64, gain: [i32; 2]) -> Self {
        let whole = libm::floor(at.max(0.0));
        Self {
            pitch,
            delay: (whole as u32).saturating_add(1),
            age: to_fixed_u64(1.0 - (at.max(0.0) - whole), 27) as u32,
            gain,
        }
    }
}

/// `e^-x` for `x` from 0 to 0.2, both Q32, within 3e-6; the attack is steep, and an error here is ten there.
#[inline(always)]
fn exp_neg(x: u32) -> u32 {
    const THIRD: u32 = u32::MAX / 3;
    let square = !high(high(x, !(x >> 2)), THIRD);
    let line = !(high(x, square) >> 1);
    !high(x, line)
}
