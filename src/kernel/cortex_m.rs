//! In assembly, for processors with the DSP instructions of a Cortex-M4. `unsafe` is here and in the voices' assembly.
//!
//! A resonator's word is a pair of registers and a multiplication adds to it in one instruction (SMLAL), the upper
//! register being the next factor as it is. Both ears' words, the coefficients, a frame and its address just fill the
//! register file, so the loop is written out for a block, and entered where as many frames are left as there are to the
//! next hit. What strikes is a stream of words on the stack, taken off it as it is used: where to enter, then what to
//! strike with after those frames. An interrupt's frame below the stack pointer covers only what has been used.
#![allow(unsafe_code)]

use core::arch::global_asm;
use core::mem::offset_of;
use core::ops::Range;

use super::{DRAWN, Drawn, Flow, Source, Stop};
use crate::fixed::{EXP2_NEG, NEG_LOG2, PAN, SINE_COSINE};
use crate::frame::{BLOCK, Block, Frame};
use crate::population::CLASSES;
use crate::resonator::{Form, Impulse, Resonator, STRIKES_MAX, State, Tuning};

global_asm!(
    include_str!("cortex_m.s"),
    drawn = const DRAWN,
    // Six words a birth, and as many for the end mark.
    stream = const (DRAWN + 1) * 24,
    strikes_max = const STRIKES_MAX,
    resonator = const size_of::<Resonator>(),
    extent = const offset_of!(Resonator, extent),
    tuning = const size_of::<Tuning>(),
    form = const offset_of!(Tuning, form),
    circle = const Form::Circle as u8,
    coefficients = const offset_of!(Tuning, coefficients),
    floor = const offset_of!(Tuning, floor),
    flow = const size_of::<Flow>(),
    coarse = const offset_of!(Flow, stroke.coarse),
    list = const offset_of!(Source, drawn),
    neg_log2 = sym NEG_LOG2,
    exp2_neg = sym EXP2_NEG,
    pan = sym PAN,
    sine_cosine = sym SINE_COSINE,
);

// What else the assembly takes for granted.
const _: () = {
    assert!(BLOCK == 32 && size_of::<Frame>() == 8);
    assert!(size_of::<State>() == 32 && size_of::<Hit>() == 20);
    assert!(offset_of!(Resonator, state) == 0 && offset_of!(Flow, stroke) == 0);
    assert!(offset_of!(Flow, crowd) == offset_of!(Flow, stroke.coarse) + 4);
    assert!((Form::Silent as u8) < Form::Circle as u8 && (Form::Circle as u8) < Form::Direct as u8);
    assert!(offset_of!(Tuning, swing) == offset_of!(Tuning, floor) + 4);
    assert!(offset_of!(Walk, swing) == 32);
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
    fn freshet_walk(walk: *mut Walk) -> u64;
}

/// Where the assembly is on its way through the classes.
#[repr(C)]
struct Walk {
    resonator: *mut Resonator,
    tuning: *const Tuning,
    flow: *const Flow,
    clock: *mut u64,
    /// Classes to go, at least one.
    left: usize,
    source: *mut Source,
    out: *mut Frame,
    /// Of the classes that are done.
    swing: u64,
}

/// After how many frames, in the upper 6 bits, and what; a `first` of `i32::MIN` is the end.
#[derive(Clone, Copy, Debug)]
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
    pub const fn new() -> Self {
        Self {
            list: [Hit {
                frames: 0,
                impulse: Impulse::NONE,
            }; DRAWN + 1],
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
        ..Impulse::NONE
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

/// Draws the births of class after class and rings with them, up to one with something out of the ordinary.
#[inline(always)]
pub fn walk(
    classes: Range<usize>,
    resonators: &mut [Resonator; CLASSES],
    tunings: &[Tuning; CLASSES],
    flows: &[Flow; CLASSES],
    clocks: &mut [u64; CLASSES],
    source: &mut Source,
    out: &mut Block,
) -> Stop {
    let mut walk = Walk {
        resonator: resonators[classes.clone()].as_mut_ptr(),
        tuning: tunings[classes.clone()].as_ptr(),
        flow: flows[classes.clone()].as_ptr(),
        clock: clocks[classes.clone()].as_mut_ptr(),
        left: classes.len(),
        source,
        out: out.as_mut_ptr(),
        swing: 0,
    };
    if walk.left == 0 {
        return Stop {
            class: classes.end,
            swing: 0,
            drawn: None,
        };
    }
    // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It goes through as many classes as all
    // four slices have; of each it reads the tuning and the flow, and reads and writes the resonator and the clock. It
    // reads and writes the source and the 32 frames of `out`. It draws at most DRAWN births at a time, for which, and an
    // end mark, there is room in the source and in its own frame; their positions are 5 bits.
    let outcome = unsafe { freshet_walk(&mut walk) };
    let (count, status) = (outcome as usize, outcome >> 32);
    Stop {
        class: classes.end - walk.left,
        swing: walk.swing,
        drawn: (status >= 2).then_some(Drawn {
            count,
            more: status == 3,
        }),
    }
}
