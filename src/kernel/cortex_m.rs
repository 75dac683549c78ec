//! In assembly, for processors with the DSP instructions of a Cortex-M4. `unsafe` is here and in the voices' assembly.
//!
//! A resonator's word is a pair of registers and a multiplication adds to it in one instruction (SMLAL), the upper
//! register being the next factor as it is. Both ears' words, the coefficients, a frame and its address just fill the
//! register file, so the loop is written out for a block, and entered where as many frames are left as there are to the
//! next hit. What strikes is a stream of words on the stack, taken off it as it is used: where to enter, then what to
//! strike with after those frames. An interrupt's frame below the stack pointer covers only what has been used.
#![allow(unsafe_code)]

use core::arch::global_asm;

use super::{DRAWN, Drawn, Outcome, Source, Stroke};
use crate::fixed::{EXP2_NEG, NEG_LOG2, PAN, SINE_COSINE};
use crate::frame::{BLOCK, Block, Frame};
use crate::resonator::{Form, Impulse, STRIKES_MAX, State, Tuning};

global_asm!(
    include_str!("cortex_m.s"),
    drawn = const DRAWN,
    // Six words a birth, four for the end mark, two of the function's own.
    stream = const (DRAWN + 1) * 24 + 8,
    strikes_max = const STRIKES_MAX,
    neg_log2 = sym NEG_LOG2,
    exp2_neg = sym EXP2_NEG,
    pan = sym PAN,
    sine_cosine = sym SINE_COSINE,
);

// What the assembly takes for granted.
const _: () = {
    assert!(BLOCK == 32 && size_of::<Frame>() == 8);
    assert!(size_of::<State>() == 32 && size_of::<Hit>() == 20);
    assert!(core::mem::offset_of!(Stroke, coarse) == 52);
    assert!(core::mem::offset_of!(Source, drawn) == 16);
};

unsafe extern "C" {
    fn freshet_ring_circle(
        state: *mut State,
        coefficients: *const [i32; 2],
        out: *mut Frame,
        hits: *const Hit,
    ) -> u32;
    fn freshet_ring_direct(
        state: *mut State,
        coefficients: *const [i32; 2],
        out: *mut Frame,
        hits: *const Hit,
    ) -> u32;
    fn freshet_play_circle(
        state: *mut State,
        coefficients: *const [i32; 2],
        out: *mut Frame,
        stroke: *const Stroke,
        clock: *mut u64,
        source: *mut Source,
    ) -> u64;
    fn freshet_play_direct(
        state: *mut State,
        coefficients: *const [i32; 2],
        out: *mut Frame,
        stroke: *const Stroke,
        clock: *mut u64,
        source: *mut Source,
    ) -> u64;
}

/// After how many frames, in the upper 6 bits, and what; a `first` of `i32::MIN` is the end.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct Hit {
    frames: u32,
    impulse: Impulse,
}

/// What strikes a class in a block, in order.
#[derive(Clone, Debug)]
pub struct Hits {
    list: [Hit; DRAWN + 1],
    count: usize,
    /// Samples that have been run, and those that the listed hits ask for.
    done: usize,
    asked: usize,
    direct: bool,
}

impl Hits {
    /// None.
    pub fn new() -> Self {
        Self {
            list: [Hit::default(); DRAWN + 1],
            count: 0,
            done: 0,
            asked: 0,
            direct: false,
        }
    }

    /// Begins another class's block.
    #[inline(always)]
    pub fn begin(&mut self, form: Form) {
        self.count = 0;
        self.done = 0;
        self.asked = 0;
        self.direct = form == Form::Direct;
    }

    /// Strikes after `sample`, not before those that are listed. There has to be room.
    #[inline(always)]
    pub fn push(&mut self, sample: usize, impulse: Impulse) {
        self.asked = sample.wrapping_add(1).clamp(self.asked, BLOCK);
        self.list[self.count] = Hit {
            frames: ((self.asked - self.done) as u32) << 26,
            impulse,
        };
        self.count += 1;
    }

    /// Whether there is nothing to strike with.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// Runs a resonator from where it is in the block up to the last of the `hits`, or with `whole` to the block's end,
/// adding to `out`. Returns how far the words are out, see [`State::extent`].
#[inline(always)]
pub fn ring(
    tuning: &Tuning,
    state: &mut State,
    hits: &mut Hits,
    whole: bool,
    out: &mut Block,
) -> u32 {
    let end = Impulse {
        first: i32::MIN,
        ..Impulse::default()
    };
    let to = if whole { BLOCK } else { hits.asked };
    hits.push(to.wrapping_sub(1), end);
    let from = &mut out[hits.done..];
    hits.done = to;
    hits.count = 0;
    let run = if hits.direct {
        freshet_ring_direct
    } else {
        freshet_ring_circle
    };
    // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It reads the two coefficients, and the
    // list up to the hit that ends it, which is there now and has at most DRAWN before it; it reads and writes the state,
    // and of `out` the frames from `done` on up to the last hit, which `push` keeps inside the block.
    unsafe {
        run(
            state,
            tuning.coefficients(),
            from.as_mut_ptr(),
            hits.list.as_ptr(),
        )
    }
}

/// Draws births and rings with them, if there is nothing out of the ordinary among them.
#[inline(always)]
pub fn play(
    tuning: &Tuning,
    state: &mut State,
    stroke: &Stroke,
    clock: &mut u64,
    source: &mut Source,
    out: &mut Block,
) -> Outcome {
    let play = match tuning.form {
        Form::Circle if stroke.coarse == 0 => freshet_play_circle,
        Form::Direct if stroke.coarse == 0 => freshet_play_direct,
        _ => return Outcome::Drawn(source.draw(stroke, clock, stroke.silent_below)),
    };
    // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It reads the two coefficients and the
    // stroke, reads and writes the clock, the source, the state and the 32 frames of `out`. It draws at most DRAWN
    // births, for which, and an end mark, there is room in the source and in its own frame; their positions are 5 bits.
    let outcome = unsafe {
        play(
            state,
            tuning.coefficients(),
            out.as_mut_ptr(),
            stroke,
            clock,
            source,
        )
    };
    let (value, status) = (outcome as u32, (outcome >> 32) as u32);
    if status == 0 {
        Outcome::Rung(value)
    } else {
        Outcome::Drawn(Drawn {
            count: value as usize,
            more: status == 2,
        })
    }
}
