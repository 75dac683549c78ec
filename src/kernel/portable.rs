//! In plain Rust.

use core::ops::Range;

use super::{DRAWN, Flow, Source, Stop};
use crate::frame::Block;
use crate::population::CLASSES;
use crate::resonator::{Form, Impulse, Resonator, State, Tuning};

/// What strikes a class in a block, in order.
#[derive(Clone, Debug)]
pub struct Hits {
    /// After which sample, and what.
    list: [(usize, Impulse); DRAWN],
    count: usize,
    /// Samples that have been run.
    done: usize,
}

impl Hits {
    /// None.
    pub const fn new() -> Self {
        Self {
            list: [(0, Impulse::NONE); DRAWN],
            count: 0,
            done: 0,
        }
    }

    /// Begins another class's block.
    #[inline(always)]
    pub fn begin(&mut self, _form: Form) {
        self.count = 0;
        self.done = 0;
    }

    /// Strikes after `sample`, not before those that are listed. There has to be room.
    #[inline(always)]
    pub fn push(&mut self, sample: usize, impulse: Impulse) {
        self.list[self.count] = (sample, impulse);
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
    for (sample, impulse) in &hits.list[..hits.count] {
        state.run(tuning, &mut out[hits.done..=*sample]);
        state.strike(tuning.form.strike(*impulse));
        hits.done = sample + 1;
    }
    hits.count = 0;
    if whole {
        state.run(tuning, &mut out[hits.done..]);
    }
    state.extent()
}

/// Leaves every class to the caller.
#[inline(always)]
pub fn walk(
    classes: Range<usize>,
    _resonators: &mut [Resonator; CLASSES],
    _tunings: &[Tuning; CLASSES],
    _flows: &[Flow; CLASSES],
    _clocks: &mut [u64; CLASSES],
    _source: &mut Source,
    _out: &mut Block,
) -> Stop {
    Stop {
        class: classes.start,
        swing: 0,
        drawn: None,
    }
}
