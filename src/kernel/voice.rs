//! The inner loops of a voice: a sine that rises steadily, under a decaying envelope, added to both ears.
//!
//! Twice the same, sample for sample, as the rest of [`kernel`](super). Past the soft attack the envelope is kept as
//! what it makes of either ear's gain: two factors decay, and one multiplication a sample and ear is all there is.

#[cfg(dsp)]
mod cortex_m;
#[cfg(not(dsp))]
mod portable;

#[cfg(dsp)]
use cortex_m::scale;
#[cfg(dsp)]
pub use cortex_m::{Ears, play, sing};
#[cfg(not(dsp))]
pub use portable::{Ears, play, sing};

#[cfg(not(dsp))]
use crate::fixed::mul_high as scale;
use crate::fixed::{high, mul_high_down, sine};
use crate::frame::BLOCK;

/// An envelope (Q31) below this is past the soft attack, which HF (39) ends at 0.85: 217/256, which fits in an
/// instruction.
pub const ATTACK_END: i32 = 217 << 23;
/// Envelope times the louder gain (Q59 of a pascal) has to be below this: the 2 Pa that a factor holds, less rounding.
pub const PLAIN_MAX: u64 = (2 << 59) - (1 << 32);

/// What sounds of a bubble. The assembly knows where its words are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Tone {
    /// So many blocks to come need nothing but these words; 0: see to it.
    pub calm: u32,
    /// At the next block, or at the first sample if that is still to come; Q31.
    pub envelope: u32,
    /// The envelope at which the bubble is over, Q31.
    pub floor: u32,
    /// Part of the envelope kept over a block, Q32.
    pub keep: u32,
    /// Q28 of a pascal.
    pub gain: [i32; 2],
    /// What the envelope gains in a sample, below 0, Q32.
    pub decay: i32,
    /// The louder of the two gains.
    pub loudest: u32,
    /// Turns, Q59: 32 pitches of Q64 are one of it.
    pub phase: u64,
    /// Turns a sample in the middle of the next block, Q64.
    pub pitch: u64,
    /// What that gains in a block, Q64.
    pub growth: u64,
}

impl Tone {
    /// Nothing.
    pub const OVER: Self = Self {
        calm: 0,
        envelope: 0,
        floor: 0,
        keep: 0,
        gain: [0; 2],
        decay: 0,
        loudest: 0,
        phase: 0,
        pitch: 0,
        growth: 0,
    };

    /// Amplitude of the louder ear now, Q59 of a pascal.
    #[inline(always)]
    pub fn level(&self) -> u64 {
        u64::from(self.envelope) * u64::from(self.loudest)
    }

    /// Whether there is nothing more to hear.
    #[inline(always)]
    pub fn is_over(&self) -> bool {
        self.envelope <= self.floor
    }

    /// The envelope after `frames` of a block.
    #[inline(always)]
    pub fn faded(&self, frames: usize) -> u32 {
        if frames == BLOCK {
            return high(self.envelope, self.keep);
        }
        let (mut envelope, mut factor) = (self.envelope, self.decay as u32);
        for bit in 0..BLOCK.ilog2() {
            if frames >> bit & 1 != 0 {
                envelope = high(envelope, factor);
            }
            factor = high(factor, factor);
        }
        envelope
    }
}

/// Some frames of a voice. The assembly knows where its words are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Run {
    /// Turns, Q32.
    pub phase: u32,
    /// Turns to the next sample, Q32.
    pub step: u32,
    /// What that gains in a sample.
    pub slope: u32,
    /// See [`Tone`].
    pub gain: [i32; 2],
    /// See [`Tone`].
    pub decay: i32,
    /// Q31.
    pub envelope: i32,
}

impl Run {
    /// How many of `frames` to play under the soft attack: at least until it ends, and until 0.82 at most.
    #[cfg_attr(dsp, expect(dead_code, reason = "the assembly has its own"))]
    #[inline(always)]
    pub fn attack(&self, frames: usize) -> usize {
        let over = self.envelope - ATTACK_END;
        if over < 0 {
            return 0;
        }
        // At the attack's end the envelope falls slowest.
        let last = -mul_high_down(ATTACK_END, self.decay);
        frames.min((over / last) as usize + 1)
    }

    /// On to the next sample's phase.
    #[inline(always)]
    pub fn turn(&mut self) {
        self.phase = self.phase.wrapping_add(self.step);
        self.step = self.step.wrapping_add(self.slope);
    }

    /// A sample of both ears with the envelope as `shape`, Q26; then on to the next sample.
    #[inline(always)]
    pub fn next(&mut self, shape: i32) -> [i32; 2] {
        let swing = scale(sine(self.phase), shape) << 8;
        self.turn();
        self.envelope += scale(self.envelope, self.decay);
        self.gain.map(|gain| scale(swing, gain))
    }
}
