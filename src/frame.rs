//! What flows between the parts: a block of stereo frames.

/// Frames the core renders at a time.
pub const BLOCK: usize = 32;

/// Blocks between two steps of the control path; every change of settings takes effect at such a step. What is asked for
/// sounds two ticks later at most, 5.3 ms at 48 kHz.
pub const BLOCKS_PER_TICK: usize = 4;

/// Frames between two steps of the control path.
pub const TICK: usize = BLOCK * BLOCKS_PER_TICK;

/// A stereo pair of samples; on the bus in units of 2^-26 Pa at 1 m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Frame {
    /// Left ear.
    pub left: i32,
    /// Right ear.
    pub right: i32,
}

impl Frame {
    /// Silence.
    pub const ZERO: Self = Self { left: 0, right: 0 };
}

/// One block of frames.
pub type Block = [Frame; BLOCK];
