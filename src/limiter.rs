//! A look-ahead limiter. The gain falls along a line that reaches its mark just as the peak leaves the delay, so no
//! peak passes full scale; it comes back quickly after a lone drip and slowly out of a sustained roar.

use crate::fixed::{mul_high_down, to_fixed};
use crate::frame::{BLOCK, Block, Frame};
use crate::mix::CEILING;
use crate::stats::Stats;

/// Look-ahead, and so the delay of the mix, frames (1.3 ms at 48 kHz).
pub const LOOK_AHEAD: usize = 64;
const BLOCKS: usize = LOOK_AHEAD / BLOCK;

/// Unity gain, Q30.
const ONE: i32 = 1 << 30;
const ONE_WIDE: i64 = (ONE as i64) << 32;
/// From this near to unity the mean goes there at once.
const NEARLY: i32 = ONE >> 12;
/// Quick recovery towards the recent mean gain, s.
const RELEASE_FAST: f64 = 0.010;
/// Time constant of that mean, s.
const RELEASE_SLOW: f64 = 0.400;

/// What there is to do for a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loudness {
    Silent,
    Below,
    /// Above the ceiling somewhere.
    Above,
}

/// The limiter's state. Gains are Q30.
#[derive(Clone, Debug)]
pub struct Limiter {
    /// What came in, and how loud it is.
    delay: [(Block, Loudness); BLOCKS],
    /// The oldest.
    at: usize,
    gain: i32,
    /// Fall a frame that brings the gain down in time.
    fall: i32,
    /// Least gain wanted by what came in lately, and in the stretch before: together they cover the delay.
    wanted: [i32; 2],
    /// Frames left of this stretch.
    stretch: usize,
    /// Recent mean of the gain, with 32 further bits.
    mean: i64,
    /// One-pole coefficients, Q32.
    fast: i32,
    slow: i32,
}

impl Limiter {
    /// At rest.
    pub fn new(sample_rate: f64) -> Self {
        let pole = |seconds: f64| to_fixed(-libm::expm1(-1.0 / (seconds * sample_rate)), 32);
        Self {
            delay: [([Frame::ZERO; BLOCK], Loudness::Silent); BLOCKS],
            at: 0,
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
        let new = Loudness::of(block);
        let at = self.at;
        self.at = (at + 1) % BLOCKS;
        core::mem::swap(&mut self.delay[at].0, block);
        let old = core::mem::replace(&mut self.delay[at].1, new);
        let peaks = on && new == Loudness::Above;
        if peaks || !self.is_open() {
            self.hold(at, block, peaks, stats);
        }
        if old == Loudness::Above {
            clip(block, stats);
        }
    }

    /// Scales what goes out by what comes in, which with `peaks` is above the ceiling somewhere.
    #[inline(never)]
    fn hold(&mut self, newest: usize, block: &mut Block, peaks: bool, stats: &mut Stats) {
        let mut limited = 0;
        let mut open = self.is_open();
        for (i, frame) in block.iter_mut().enumerate() {
            if peaks {
                let peak = peak(&self.delay[newest].0[i]);
                if peak > CEILING as u32 {
                    self.expect(peak);
                    open = false;
                }
            }
            if open {
                continue;
            }
            self.step();
            open = self.is_open();
            frame.left = scale(frame.left, self.gain);
            frame.right = scale(frame.right, self.gain);
            // A hundredth of a dB is not held down.
            limited += u32::from(self.gain < ONE - (ONE >> 10));
        }
        stats.limited = stats.limited.wrapping_add(u64::from(limited));
    }

    /// Whether a silent block comes out silent and changes nothing.
    pub fn is_at_rest(&self) -> bool {
        self.is_open()
            && self
                .delay
                .iter()
                .all(|(_, loudness)| *loudness == Loudness::Silent)
    }

    fn is_open(&self) -> bool {
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
    #[inline(always)]
    fn step(&mut self) {
        if self.stretch == 0 {
            self.stretch = LOOK_AHEAD + 1;
            self.wanted = [ONE, self.wanted[0]];
        }
        self.stretch -= 1;
        let allowed = self.wanted[0].min(self.wanted[1]);
        let mean = (self.mean >> 32) as i32;
        if self.gain > allowed {
            self.gain = (self.gain - self.fall).max(allowed);
        } else {
            self.fall = 0;
            // Quickly back to the mean, and with the mean from there on.
            let short = (mean - self.gain).max(0);
            let back = if short < ONE >> 14 {
                mean
            } else {
                self.gain + mul_high_down(short, self.fast)
            };
            self.gain = back.max(self.gain).min(allowed);
        }
        let aim = if allowed < ONE { self.gain } else { ONE };
        self.mean += i64::from(aim - mean) * i64::from(self.slow);
        if allowed == ONE && aim - mean < NEARLY {
            self.mean = ONE_WIDE;
        }
    }
}

fn peak(frame: &Frame) -> u32 {
    frame.left.unsigned_abs().max(frame.right.unsigned_abs())
}

impl Loudness {
    #[inline(always)]
    fn of(block: &Block) -> Self {
        // Each number's highest bit that is not its sign, one place up.
        let bits = block.iter().fold(0, |bits, frame| {
            bits | (frame.left ^ (frame.left << 1)) | (frame.right ^ (frame.right << 1))
        }) as u32;
        let above = |frame: &Frame| peak(frame) > CEILING as u32;
        if bits == 0 {
            Self::Silent
        } else if bits >= CEILING as u32 && block.iter().any(above) {
            Self::Above
        } else {
            Self::Below
        }
    }
}

/// Holds the block below the ceiling by force.
#[inline(never)]
fn clip(block: &mut Block, stats: &mut Stats) {
    for frame in block {
        let clipped = Frame {
            left: frame.left.clamp(-CEILING, CEILING),
            right: frame.right.clamp(-CEILING, CEILING),
        };
        stats.clipped = stats.clipped.wrapping_add(u64::from(clipped != *frame));
        *frame = clipped;
    }
}

/// Product with a gain of at most one, never larger than exact.
#[inline(always)]
fn scale(x: i32, gain: i32) -> i32 {
    let down = ((i64::from(x) * i64::from(gain)) >> 30) as i32;
    down - (down >> 31)
}
