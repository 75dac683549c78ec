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

/// The limiter's state.
#[derive(Clone, Debug)]
pub struct Limiter {
    /// What came in, and how loud it is.
    delay: [(Block, Loudness); BLOCKS],
    /// The oldest.
    at: usize,
    gain: Gain,
}

/// What the sound is scaled by; all gains are Q30.
#[derive(Clone, Copy, Debug)]
struct Gain {
    now: i32,
    /// Fall a frame that brings it down in time.
    fall: i32,
    /// Least gain wanted by what came in lately, and in the stretch before: together they cover the delay.
    wanted: [i32; 2],
    /// The loudest sample of this stretch; the ceiling at least.
    loudest: u32,
    /// Frames left of this stretch.
    stretch: usize,
    /// Its recent mean, with 32 further bits.
    mean: i64,
    /// One-pole coefficients, Q32.
    fast: i32,
    slow: i32,
}

impl Limiter {
    /// One that lets nothing through, until another takes its place.
    pub const OFF: Self = Self {
        delay: [([Frame::ZERO; BLOCK], Loudness::Silent); BLOCKS],
        at: 0,
        gain: Gain {
            now: 0,
            fall: 0,
            wanted: [0; 2],
            loudest: 0,
            stretch: 0,
            mean: 0,
            fast: 0,
            slow: 0,
        },
    };

    /// At rest.
    pub fn new(sample_rate: f64) -> Self {
        let pole = |seconds: f64| to_fixed(-libm::expm1(-1.0 / (seconds * sample_rate)), 32);
        Self {
            delay: [([Frame::ZERO; BLOCK], Loudness::Silent); BLOCKS],
            at: 0,
            gain: Gain {
                now: ONE,
                fall: 0,
                wanted: [ONE; 2],
                loudest: CEILING as u32,
                stretch: 0,
                mean: ONE_WIDE,
                fast: pole(RELEASE_FAST),
                slow: pole(RELEASE_SLOW),
            },
        }
    }

    /// Delays a block by [`LOOK_AHEAD`] and holds it below the ceiling. With `on` false it only clips.
    pub fn render(&mut self, block: &mut Block, on: bool, stats: &mut Stats) {
        let (delayed, loudness) = &mut self.delay[self.at];
        self.at = (self.at + 1) % BLOCKS;
        let old = *loudness;
        *loudness = Loudness::swap(block, delayed);
        let peaks = on && *loudness == Loudness::Above;
        if peaks || !self.gain.is_open() {
            let incoming = peaks.then_some(&*delayed);
            let limited = self.gain.hold(incoming, block);
            stats.limited = stats.limited.wrapping_add(u64::from(limited));
        }
        if old == Loudness::Above {
            clip(block, stats);
        }
    }

    /// Whether a silent block comes out silent and changes nothing.
    pub fn is_at_rest(&self) -> bool {
        self.gain.is_open()
            && self
                .delay
                .iter()
                .all(|(_, loudness)| *loudness == Loudness::Silent)
    }
}

impl Gain {
    #[inline(always)]
    fn is_open(&self) -> bool {
        self.mean == ONE_WIDE && self.now == ONE && self.wanted == [ONE; 2]
    }

    /// Scales what goes out by what comes in, where that has peaks. Returns how many frames are held down.
    #[inline(never)]
    fn hold(&mut self, incoming: Option<&Block>, block: &mut Block) -> u32 {
        let mut limited = 0;
        let mut at = 0;
        while at < BLOCK {
            if let Some(incoming) = incoming {
                let peak = peak(&incoming[at]);
                if peak > self.loudest {
                    self.expect(peak);
                }
            }
            if self.is_open() {
                at += 1;
                continue;
            }
            if self.stretch == 0 {
                self.stretch = LOOK_AHEAD + 1;
                self.wanted = [ONE, self.wanted[0]];
                self.loudest = CEILING as u32;
            }
            // As far as nothing more is asked for.
            let mut frames = &mut block[at..];
            if self.stretch < frames.len() {
                frames = &mut frames[..self.stretch];
            }
            if let Some(incoming) = incoming {
                let next = &incoming[at + 1..at + frames.len()];
                let most = self.loudest.min(i32::MAX as u32);
                let above = |x: i32| (x as u32).wrapping_add(most) > 2 * most;
                let above = |frame: &Frame| above(frame.left) || above(frame.right);
                if let Some(next) = next.iter().position(above) {
                    frames = &mut frames[..=next];
                }
            }
            let done = if self.wanted == [ONE; 2] {
                self.run(frames, true, &mut limited)
            } else {
                self.run(frames, false, &mut limited)
            };
            self.stretch -= done;
            at += done;
        }
        limited
    }

    /// A sample of size `peak` has come in, the loudest of its stretch: the gain must have fallen far enough when it goes
    /// out. Softer ones ask for no more than that.
    #[cold]
    fn expect(&mut self, peak: u32) {
        self.loudest = peak;
        let wanted = (((CEILING as u64) << 30) / u64::from(peak)) as i32;
        self.wanted[0] = wanted;
        if wanted < self.now {
            let fall = (self.now - wanted) / LOOK_AHEAD as i32 + 1;
            self.fall = self.fall.max(fall);
        }
    }

    /// Scales `frames`, for which nothing changes, until it is open, for which it has to be `free`: nothing that is
    /// delayed asks for less than unity. Returns how many frames that were.
    #[inline(always)]
    fn run(&mut self, frames: &mut [Frame], free: bool, limited: &mut u32) -> usize {
        let allowed = self.wanted[0].min(self.wanted[1]);
        let Self {
            mut now,
            mut fall,
            mut mean,
            fast,
            slow,
            ..
        } = *self;
        let mut done = 0;
        let mut loud = 0;
        for frame in frames {
            done += 1;
            let from = (mean >> 32) as i32;
            if now > allowed {
                now = (now - fall).max(allowed);
            } else {
                fall = 0;
                // Quickly back to the mean, and with the mean from there on.
                let short = from - now;
                let back = if short < ONE >> 14 {
                    from
                } else {
                    now + mul_high_down(short, fast)
                };
                now = back.max(now).min(allowed);
            }
            frame.left = scale(frame.left, now);
            frame.right = scale(frame.right, now);
            // A hundredth of a dB is not held down.
            loud += (now + (ONE >> 10)) as u32 >> 30;
            let aim = if free { ONE } else { now };
            mean += i64::from(aim - from) * i64::from(slow);
            if free && aim - from < NEARLY {
                mean = ONE_WIDE;
                if now == ONE {
                    break;
                }
            }
        }
        *limited += done as u32 - loud;
        (self.now, self.fall, self.mean) = (now, fall, mean);
        done
    }
}

fn peak(frame: &Frame) -> u32 {
    frame.left.unsigned_abs().max(frame.right.unsigned_abs())
}

impl Loudness {
    /// How loud `new` is, which changes places with `old`.
    #[inline(always)]
    fn swap(new: &mut Block, old: &mut Block) -> Self {
        // Each number's highest bit that is not its sign, one place up.
        let mut bits = 0;
        for (new, old) in new.iter_mut().zip(old.iter_mut()) {
            bits |= (new.left ^ (new.left << 1)) | (new.right ^ (new.right << 1));
            core::mem::swap(new, old);
        }
        let bits = bits as u32;
        let above = |frame: &Frame| peak(frame) > CEILING as u32;
        if bits == 0 {
            Self::Silent
        } else if bits >= CEILING as u32 && old.iter().any(above) {
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
