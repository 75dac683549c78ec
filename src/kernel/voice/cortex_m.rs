//! In assembly, for processors with the DSP instructions of a Cortex-M4.
//!
//! Two frames are fetched and stored at once, and all registers are in use; the loops are written out for a block, and
//! entered where as many frames are left as there are to play.
#![allow(unsafe_code)]

use core::arch::{asm, global_asm};
use core::ops::Range;

use super::{ATTACK_END, Run, Tone};
use crate::fixed::{ATTACK, ATTACK_FIRST, SINE};
use crate::frame::{BLOCK, Block, Frame};
use crate::voices::Voice;

global_asm!(
    include_str!("voice.s"),
    voice = const size_of::<Voice>(),
    attack_end = const ATTACK_END,
    attack_first = const 8 * ATTACK_FIRST,
    sine = sym SINE,
    attack = sym ATTACK,
);

// What the assembly takes for granted.
const _: () = {
    assert!(BLOCK == 32 && size_of::<Frame>() == 8);
    assert!(size_of::<Tone>() == 56 && size_of::<Run>() == 28);
    assert!(core::mem::offset_of!(Voice, tone) == 0);
};

unsafe extern "C" {
    fn freshet_voices(
        first: *mut Voice,
        end: *const Voice,
        out: *mut Frame,
        loudness: *mut u64,
    ) -> *const Voice;
    fn freshet_voice(run: *const Run, out: *mut Frame, frames: usize);
}

/// What voices add to.
#[derive(Clone, Debug)]
pub struct Ears(Block);

impl Ears {
    /// Silence.
    pub fn new() -> Self {
        Self([Frame::ZERO; BLOCK])
    }

    /// Adds what `swing` gives for each frame of `span`.
    #[inline(always)]
    pub fn add(&mut self, span: Range<usize>, mut swing: impl FnMut() -> [i32; 2]) {
        for frame in &mut self.0[span] {
            let [left, right] = swing();
            frame.left = frame.left.wrapping_add(left);
            frame.right = frame.right.wrapping_add(right);
        }
    }

    /// Adds all of it to `block`, as far as an i32 goes.
    #[inline(always)]
    pub fn add_to(&self, block: &mut Block) {
        for (frame, ears) in block.iter_mut().zip(&self.0) {
            frame.left = frame.left.saturating_add(ears.left);
            frame.right = frame.right.saturating_add(ears.right);
        }
    }
}

/// As [`mul_high`](crate::fixed::mul_high). Left to itself the compiler extends a constant factor to 64 bits before a
/// loop, and then finds no instruction for the product.
#[inline(always)]
pub fn scale(a: i32, b: i32) -> i32 {
    let product;
    // SAFETY: the instruction reads and writes these registers and nothing else.
    unsafe {
        asm!(
            "smmulr {product}, {a}, {b}",
            product = lateout(reg) product,
            a = in(reg) a,
            b = in(reg) b,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    product
}

/// Plays a block of each of `voices`, from the first on, and adds what is left of their levels to `loudness`, up to one
/// that is over or asks for more than that. Returns how many come before it.
#[inline(always)]
pub fn play(voices: &mut [Voice], ears: &mut Ears, loudness: &mut u64) -> usize {
    if voices.is_empty() {
        return 0;
    }
    let Range { start, end } = voices.as_mut_ptr_range();
    // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It reads and writes the voices, of
    // which there is one, the 32 frames and the loudness, and returns a pointer to one of the voices or their end.
    unsafe {
        let next = freshet_voices(start, end, ears.0.as_mut_ptr(), loudness);
        next.offset_from_unsigned(start)
    }
}

/// Adds the frames of `span`.
#[inline(always)]
pub fn sing(run: Run, ears: &mut Ears, span: Range<usize>) {
    let out = &mut ears.0[span];
    // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It reads the run, and reads and writes
    // as many frames as there are, 32 at most.
    unsafe { freshet_voice(&run, out.as_mut_ptr(), out.len()) }
}
