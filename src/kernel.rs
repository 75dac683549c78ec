//! The inner loops: births are drawn, and a class of bubbles rings for a block while they strike it.
//!
//! Twice the same, sample for sample: in plain Rust, and in assembly where the processor has the multiplications of a
//! Cortex-M4 (`build.rs` says so).

pub mod cloud;
#[cfg(dsp)]
mod cortex_m;
#[cfg(not(dsp))]
mod portable;
pub mod voice;

#[cfg(dsp)]
pub use cortex_m::{Hits, ring, walk};
#[cfg(not(dsp))]
pub use portable::{Hits, ring, walk};

use crate::fixed::{exp2_neg, high, neg_log2, pan, sine_cosine};
use crate::random::Random;
use crate::resonator::{Impulse, Tuning};

/// Most births that are drawn at a time.
pub const DRAWN: usize = 48;

/// As [`Stroke::still`]: nothing rises. Above every random number but one, which marks the end of a list.
pub const ALL_STILL: u32 = u32::MAX - 1;

/// What the births of one class are drawn by. The assembly knows where its words are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Stroke {
    /// Births in a block, over ln 2, in units of the class's clock.
    pub per_block: u32,
    /// Those units in one of a gap's `-log2(rnd)` (Q26, shifted down by `coarse`).
    pub gap: u32,
    /// What is missing from 2^32 over `per_block` to 1, Q32.
    pub stretch: u32,
    /// Random numbers below this are surely inaudible and do not rise, Q32.
    pub silent_below: u32,
    /// A bubble rises where its random number is above this, Q32; the others may be left to a crowd.
    pub still: u32,
    /// β of `D = rnd^β`, Q26.
    pub exponent: u32,
    /// Decay in powers of two a sample, Q31.
    pub decay: u32,
    /// Turns a sample, Q32.
    pub step: u32,
    /// Width of the stage, 256 is full, and where its left edge is, Q8.
    pub width: i32,
    /// See `width`.
    pub edge: i32,
    /// Pressure of a bubble of depth factor 1, one sample before it is due, Q30 of a pascal.
    pub pressure: u32,
    /// The second state word of a bubble of phase φ is `second[0]·sin φ + second[1]·cos φ`, Q30.
    pub second: [i32; 2],
    /// 0, unless there are more than 44 births a block.
    pub coarse: u32,
}

/// What all classes draw their births from. The assembly knows where its words are.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Source {
    /// Where chance comes from.
    pub random: Random,
    /// Births that this block still takes.
    pub left: u32,
    /// Pressure that the population still takes in this block, Q27 of a pascal.
    pub room: u32,
    /// The births drawn last: positions in the block, with 32 random bits each; one place is for an end mark.
    pub drawn: [[u32; 2]; DRAWN + 1],
}

/// How a class is struck. The assembly knows where its words are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Flow {
    /// What the clock draws births one by one by.
    pub stroke: Stroke,
    /// Which of the crowds draws the others, from 1 on; 0 for none.
    pub crowd: u32,
    /// `-log2 D` (Q20) above which less than half a unit is left of a bubble one sample before it is due.
    pub inaudible: u32,
    /// The pressure at its birth, Q28, for voices.
    pub voice_pressure: u32,
    /// The clock counts births over ln 2 in units of 2^-`scale`.
    pub scale: u8,
}

/// Where a walk through the classes stopped.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// The class that is left to the caller; where it is the end, all are done.
    pub class: usize,
    /// How far those before it may swing from here, bus units.
    pub swing: u64,
    /// Its births, where they are drawn.
    pub drawn: Option<Drawn>,
}

/// So many births that may be heard are listed.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// How many.
    pub count: usize,
    /// Whether there may be more in this block.
    pub more: bool,
}

impl Source {
    /// Without a seed.
    pub const OFF: Self = Self {
        random: Random::OFF,
        left: 0,
        room: 0,
        drawn: [[0; 2]; DRAWN + 1],
    };

    /// Draws the next births of a class in this block and sets its clock for the one after them. Those whose random
    /// number is below `silent_below` are not listed.
    pub fn draw(&mut self, stroke: &Stroke, clock: &mut u64, silent_below: u32) -> Drawn {
        let mut random = self.random.clone();
        let mut at = *clock;
        let limit = self.left.min(DRAWN as u32);
        let per_block = u64::from(stroke.per_block);
        let mut births = 0;
        let mut count = 0;
        while at < per_block && births < limit {
            births += 1;
            let [gap, bits] = random.pair();
            if bits >= silent_below {
                self.drawn[count] = [stroke.position(at as u32), bits];
                count += 1;
            }
            at += stroke.gap(gap);
        }
        let more = at < per_block;
        *clock = if more { at } else { at - per_block };
        self.left -= births;
        self.random = random;
        Drawn { count, more }
    }
}

impl Flow {
    /// No births.
    pub const NONE: Self = Self {
        stroke: Stroke::NONE,
        crowd: 0,
        inaudible: 0,
        voice_pressure: 0,
        scale: 57,
    };

    /// Whether a crowd draws most of its births.
    #[inline(always)]
    pub fn is_crowd(&self) -> bool {
        self.crowd != 0
    }
}

impl Stroke {
    /// No births.
    pub const NONE: Self = Self {
        per_block: 0,
        gap: 1 << 31,
        stretch: u32::MAX,
        silent_below: 0,
        still: ALL_STILL,
        exponent: 0,
        decay: 0,
        step: 0,
        width: 256,
        edge: 0,
        pressure: 0,
        second: [0; 2],
        coarse: 0,
    };

    /// What the clock gains until the next birth, from 32 random bits.
    #[inline(always)]
    pub fn gap(&self, bits: u32) -> u64 {
        u64::from(neg_log2(bits) >> self.coarse) * u64::from(self.gap)
    }

    /// Where in the block the clock stands: the sample's index in the upper 5 bits, then the fraction, Q27.
    #[inline(always)]
    fn position(&self, clock: u32) -> u32 {
        clock + high(clock, self.stretch)
    }

    /// `-log2 D` of the random number `draw`, Q20.
    #[inline(always)]
    pub fn softness(&self, draw: u32) -> u32 {
        high(neg_log2(draw), self.exponent)
    }

    /// Gains of both ears, Q31.
    #[inline(always)]
    pub fn pan(&self, bits: u32) -> [u32; 2] {
        // The lowest bits are the generator's weakest.
        pan(bits >> 4, self.width, self.edge)
    }

    /// What a bubble strikes its class with, and its pressure, Q29 of a pascal.
    #[inline(always)]
    pub fn impulse(
        &self,
        tuning: &Tuning,
        position: u32,
        soft: u32,
        pan: [u32; 2],
    ) -> (Impulse, u32) {
        // From the birth to the next sample, Q32; a bubble is struck as it would have been a sample before that.
        let rest = !(position << 5);
        let decayed = soft + (high(self.decay, rest) >> 11);
        let pressure = high(self.pressure, exp2_neg(decayed));
        let [left, right] = pan.map(|gain| high(pressure, gain) as i32);
        let phase = high(self.step, rest).wrapping_sub(self.step);
        let (first, second) = tuning.words(sine_cosine(phase));
        let impulse = Impulse {
            right,
            left,
            first,
            second,
        };
        (impulse, pressure)
    }
}
