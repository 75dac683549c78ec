//! In plain Rust.

use core::ops::Range;

use super::Run;
use crate::fixed::{mul_high, sine, soft_attack};
use crate::frame::{BLOCK, Block};
use crate::voices::Voice;

/// What voices add to: a block of one ear, then of the other. Apart, a desktop's compiler keeps the two sums in general
/// registers, which is twice as fast.
#[derive(Clone, Debug)]
pub struct Ears([[i32; BLOCK]; 2]);

impl Ears {
    /// Silence.
    pub fn new() -> Self {
        Self([[0; BLOCK]; 2])
    }

    /// Adds what `swing` gives for each frame of `span`.
    #[inline(always)]
    pub fn add(&mut self, span: Range<usize>, mut swing: impl FnMut() -> [i32; 2]) {
        let [left, right] = &mut self.0;
        for (left, right) in left[span.clone()].iter_mut().zip(&mut right[span]) {
            let swing = swing();
            *left = left.wrapping_add(swing[0]);
            *right = right.wrapping_add(swing[1]);
        }
    }

    /// Adds all of it to `block`, as far as an i32 goes.
    #[inline(always)]
    pub fn add_to(&self, block: &mut Block) {
        let [left, right] = &self.0;
        for (frame, (left, right)) in block.iter_mut().zip(left.iter().zip(right)) {
            frame.left = frame.left.saturating_add(*left);
            frame.right = frame.right.saturating_add(*right);
        }
    }
}

/// Plays a block of each of `voices`, from the first on, and adds what is left of their levels to `loudness`, up to one
/// that is over or asks for more than that. Returns how many come before it.
#[inline(always)]
pub fn play(voices: &mut [Voice], ears: &mut Ears, loudness: &mut u64) -> usize {
    for (i, voice) in voices.iter_mut().enumerate() {
        let tone = &mut voice.tone;
        if tone.calm == 0 {
            return i;
        }
        let slope = (tone.growth >> 32) as u32 >> 5;
        let run = Run {
            phase: (tone.phase >> 27) as u32,
            step: (tone.pitch >> 32) as u32 - slope * (BLOCK as u32 - 1) / 2,
            slope,
            gain: tone.gain,
            decay: tone.decay,
            envelope: tone.envelope as i32,
        };
        sing(run, ears, 0..BLOCK);
        tone.calm -= 1;
        tone.envelope = tone.faded(BLOCK);
        tone.phase = tone.phase.wrapping_add(tone.pitch);
        tone.pitch += tone.growth;
        *loudness += tone.level();
        if tone.is_over() {
            return i;
        }
    }
    voices.len()
}

/// Adds the frames of `span`.
#[inline(always)]
pub fn sing(mut run: Run, ears: &mut Ears, span: Range<usize>) {
    let plain = span.start + run.attack(span.len());
    ears.add(span.start..plain, || run.next(soft_attack(run.envelope)));
    let [left, right] = &mut ears.0;
    if plain == 0 && span.end == BLOCK {
        // The length known, a compiler unrolls.
        go_on(run, left, right);
    } else {
        go_on(run, &mut left[plain..span.end], &mut right[plain..span.end]);
    }
}

/// Past the soft attack.
#[inline(always)]
fn go_on(mut run: Run, left: &mut [i32], right: &mut [i32]) {
    // Q30 of a pascal.
    let [mut one, mut other] = run.gain.map(|gain| mul_high(run.envelope, gain) << 3);
    for (left, right) in left.iter_mut().zip(right) {
        let swing = sine(run.phase);
        *left = left.wrapping_add(mul_high(swing, one));
        *right = right.wrapping_add(mul_high(swing, other));
        run.turn();
        one += mul_high(one, run.decay);
        other += mul_high(other, run.decay);
    }
}
