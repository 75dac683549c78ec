//! A look-ahead limiter. The gain falls along a line that reaches its mark just as the peak leaves the delay, so no
//! peak passes full scale; it comes back quickly after a lone drip and slowly out of a sustained roar.

use crate::fixed::to_fixed;
use crate::frame::{BLOCK, Block, Frame};
use crate::mix::CEILING;
use crate::stats::Stats;

/// Look-ahead, and so the delay of the mix, frames (1.3 ms at 48 kHz).
pub const LOOK_AHEAD: usize = 64;

/// The same in blocks.
const BLOCKS: usize = LOOK_AHEAD / BLOCK;

/// Whether no sample of a block passes the ceiling.
#[inline(always)]
fn is_calm(block: &Block) -> bool {
    // All sizes or-ed are at least the largest and below its double: two instructions a sample settle most blocks.
    let size = |x: i32| (x ^ (x >> 31)) as u32;
    let all = block
        .iter()
        .fold(0, |all, frame| all | size(frame.left) | size(frame.right));
    all < CEILING as u32
        || block.iter().all(|frame| {
            frame.left.unsigned_abs().max(frame.right.unsigned_abs()) <= CEILING as u32
        })
}

/// Unity gain, Q30.
const ONE: i32 = 1 << 30;
const ONE_WIDE: i64 = (ONE as i64) << 16;
/// Quick recovery towards the recent mean gain, s.
const RELEASE_FAST: f64 = 0.010;
/// Time constant of that mean, s.
const RELEASE_SLOW: f64 = 0.400;

/// The limiter's state. Gains are Q30.
#[derive(Clone, Debug)]
pub struct Limiter {
    /// Blocks on their way, the oldest first from `at`.
    delay: [Block; BLOCKS],
    at: usize,
    /// Blocks in a row that had no peak, of those in the delay and before.
    calm: usize,
    gain: i32,
    /// Fall a frame that brings the gain down in time.
    fall: i32,
    /// Least gain wanted by what came in lately, and in the stretch before: together they cover the delay.
    wanted: [i32; 2],
    /// Frames left of this stretch.
    stretch: usize,
    /// Recent mean of the gain, with 16 further bits.
    mean: i64,
    /// One-pole coefficients, Q31.
    fast: i32,
    slow: i32,
}

impl Limiter {
    /// At rest.
    pub fn new(sample_rate: f64) -> Self {
        let pole = |seconds: f64| to_fixed(-libm::expm1(-1.0 / (seconds * sample_rate)), 31);
        Self {
            delay: [[Frame::ZERO; BLOCK]; BLOCKS],
            at: 0,
            calm: BLOCKS,
            gain: ONE,
            fall: 0,
            wanted: [ONE; 2],
            stretch: 0,
            mean: ONE_WIDE,
            fast: pole(RELEASE_FAST),
            slow: pole(RELEASE_SLOW),
        }
    }

    /// Delays a block by [`LOOK_AHEAD`] and holds it below the ceiling. With `on` false it only clips.
    pub fn render(&mut self, block: &mut Block, on: bool, stats: &mut Stats) {
        let calm = is_calm(block);
        self.calm = if calm {
            (self.calm + 1).min(BLOCKS + 1)
        } else {
            0
        };
        core::mem::swap(block, &mut self.delay[self.at]);
        self.at = (self.at + 1) % BLOCKS;
        // The block that came in, those in the delay and the one that goes out.
        if self.calm > BLOCKS && self.is_open() {
            return;
        }
        let incoming = self.delay[(self.at + BLOCKS - 1) % BLOCKS];
        for (frame, coming) in block.iter_mut().zip(&incoming) {
            let peak = coming.left.unsigned_abs().max(coming.right.unsigned_abs());
            if on && peak > CEILING as u32 {
                self.expect(peak);
            }
            if !self.is_open() {
                self.step();
                frame.left = scale(frame.left, self.gain);
                frame.right = scale(frame.right, self.gain);
                // A hundredth of a dB is not held down.
                stats.limited = stats
                    .limited
                    .wrapping_add(u64::from(self.gain < ONE - (ONE >> 10)));
            }
            let clipped = Frame {
                left: frame.left.clamp(-CEILING, CEILING),
                right: frame.right.clamp(-CEILING, CEILING),
            };
            if clipped != *frame {
                stats.clipped = stats.clipped.wrapping_add(1);
                *frame = clipped;
            }
        }
    }

    /// Whether it lets everything through as it is.
    pub fn is_open(&self) -> bool {
        self.gain == ONE && self.wanted == [ONE; 2] && self.mean == ONE_WIDE
    }

    /// A sample of size `peak` has come in: the gain must have fallen far enough when it goes out.
    fn expect(&mut self, peak: u32) {
        let wanted = (((CEILING as u64) << 30) / u64::from(peak)) as i32;
        self.wanted[0] = self.wanted[0].min(wanted);
        if wanted < self.gain {
            let fall = (self.gain - wanted) / LOOK_AHEAD as i32 + 1;
            self.fall = self.fall.max(fall);
        }
    }

    /// Moves the gain by one frame.
    fn step(&mut self) {
        if self.stretch == 0 {
            self.stretch = LOOK_AHEAD + 1;
            self.wanted = [ONE, self.wanted[0]];
        }
        self.stretch -= 1;
        let allowed = self.wanted[0].min(self.wanted[1]);
        if self.gain > allowed {
            self.gain = (self.gain - self.fall).max(allowed);
        } else {
            self.fall = 0;
            // Quickly back to the mean, and with the mean from there on.
            let mean = (self.mean >> 16) as i32;
            let short = (mean - self.gain).max(0);
            let up = ((i64::from(short) * i64::from(self.fast)) >> 31) as i32;
            let back = if short < ONE >> 14 {
                mean
            } else {
                self.gain + up
            };
            self.gain = back.max(self.gain).min(allowed);
        }
        let aim = if allowed < ONE { self.gain } else { ONE };
        let away = (i64::from(aim) << 16) - self.mean;
        self.mean += ((away >> 16) * i64::from(self.slow)) >> 15;
        if allowed == ONE && away < 1 << 34 {
            self.mean = ONE_WIDE;
        }
    }
}

/// Product with a gain of at most one, rounded towards zero: never up.
#[inline(always)]
fn scale(x: i32, gain: i32) -> i32 {
    (i64::from(x) * i64::from(gain) / i64::from(ONE)) as i32
}
