//! From the bus in pascal to the converter: level, DC blocker, tone, limiter, dither.

use crate::fixed::{FULL_SCALE, mul_high, to_fixed};
use crate::frame::{BLOCK, Block, Frame, TICK};
use crate::limiter::{LOOK_AHEAD, Limiter};
use crate::random::{Random, Stream};
use crate::stats::Stats;

/// What comes out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// The bus after the level: units of 2^-26 Pa, no DC blocker, tone, limiter or dither. For measuring.
    Raw,
    /// 16-bit samples.
    Bits16,
    /// 24-bit samples.
    Bits24,
}

impl Output {
    /// Bits between the bus and the sample.
    fn shift(self) -> u32 {
        let bits = match self {
            Self::Raw => return 0,
            Self::Bits16 => 15,
            Self::Bits24 => 23,
        };
        FULL_SCALE.trailing_zeros() - bits
    }
}

/// Corner of the tone control, Hz.
pub const TONE_CORNER: f64 = 1000.0;
/// The DC blocker's corner is about this, Hz: its time constant is a power of two in samples, 2^12 at 48 kHz.
const DC_CORNER: f64 = 1.9;
/// Frames of exact silence after which the dither stops too.
const DITHER_TAIL: u32 = 1024;
/// After so many blocks of zeros the limiter's delay holds nothing else.
const REST: usize = LOOK_AHEAD / BLOCK + 1;
/// Gains are Q24: up to +42 dB.
const UNITY: i32 = 1 << 24;

/// What the mix needs of the parameters.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Level, Q24.
    level: i32,
    /// Gain below the tone's corner, Q24.
    low: i32,
    /// Gain above it, Q24.
    high: i32,
    limiter: bool,
}

impl Settings {
    /// `level` and `tone` in dB; tone is the tilt from far below to far above 1 kHz.
    pub fn new(level: f64, tone: f64, limiter: bool) -> Self {
        let gain = |db: f64| {
            if db <= -120.0 {
                0
            } else {
                to_fixed(libm::exp10(db / 20.0), 24)
            }
        };
        Self {
            level: gain(level),
            low: gain(-tone / 2.0),
            high: gain(tone / 2.0),
            limiter,
        }
    }
}

/// A gain on its way to where it should be, a step each frame.
#[derive(Clone, Copy, Debug)]
struct Glide {
    /// Q24 with 16 further bits.
    now: i64,
    step: i64,
    target: i32,
    left: u32,
}

impl Glide {
    fn at(target: i32) -> Self {
        Self {
            now: i64::from(target) << 16,
            step: 0,
            target,
            left: 0,
        }
    }

    fn aim(&mut self, target: i32) {
        self.target = target;
        self.left = TICK as u32;
        self.step = ((i64::from(target) << 16) - self.now) / TICK as i64;
    }

    /// The gain of a whole block, where it does not move.
    fn steady(&self) -> Option<i32> {
        (self.left == 0).then_some((self.now >> 16) as i32)
    }

    #[inline(always)]
    fn next(&mut self) -> i32 {
        if self.left > 0 {
            self.left -= 1;
            self.now += self.step;
            if self.left == 0 {
                self.now = i64::from(self.target) << 16;
            }
        }
        (self.now >> 16) as i32
    }
}

/// One ear's filters.
#[derive(Clone, Copy, Debug, Default)]
struct Ear {
    /// Running mean, Q32.32.
    dc: i64,
    /// The tone's low-pass, Q32.32.
    low: i64,
}

impl Ear {
    /// Takes the running mean away.
    #[inline(always)]
    fn block_dc(&mut self, x: i32, corners: &Corners) -> i32 {
        let x = x.saturating_sub((self.dc >> 32) as i32);
        self.dc += i64::from(x) * i64::from(corners.dc);
        x
    }

    #[inline(always)]
    fn tilt(&mut self, x: i32, corners: &Corners, low: i32, high: i32) -> i32 {
        let x = i64::from(x);
        // One pole by the trapezoidal rule: nothing is left of it at the top of the band.
        let above = saturate(x - (self.low >> 32));
        let step = i64::from(above) * i64::from(corners.tone);
        let below = (self.low + (step << 1)) >> 32;
        self.low += step << 2;
        saturate((below * i64::from(low) + (x - below) * i64::from(high)) >> 24)
    }
}

/// Where the filters turn; they depend on the sample rate alone.
#[derive(Clone, Copy, Debug)]
struct Corners {
    /// Part of a sample that goes into the DC blocker's mean, Q32.
    dc: i32,
    /// g/(1 + g) with g = tan(π·corner/rate), Q31.
    tone: i32,
}

impl Corners {
    fn new(sample_rate: f64) -> Self {
        let pi = core::f64::consts::PI;
        let g = libm::tan(pi * TONE_CORNER / sample_rate);
        Self {
            dc: 1 << (32 - libm::round(libm::log2(sample_rate / (2.0 * pi * DC_CORNER))) as u32),
            tone: to_fixed(g / (1.0 + g), 31),
        }
    }
}

#[inline(always)]
fn saturate(x: i64) -> i32 {
    x.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

/// `x` times a gain in Q24, rounded.
#[inline(always)]
fn amplify(x: i32, gain: i32) -> i32 {
    saturate((i64::from(x) * i64::from(gain) + (1 << 23)) >> 24)
}

/// The same for a whole block of one gain; the gains that are near one or below a half take one multiplication.
fn amplify_block(block: &mut Block, gain: i32) {
    let each = |block: &mut Block, f: &dyn Fn(i32) -> i32| {
        for frame in block.iter_mut() {
            *frame = Frame {
                left: f(frame.left),
                right: f(frame.right),
            };
        }
    };
    let over = i64::from(gain) - i64::from(UNITY);
    if over == 0 {
    } else if gain < UNITY / 2 {
        let gain = gain << 8;
        each(block, &|x| mul_high(x, gain));
    } else if over <= 0 {
        let over = (over << 8) as i32;
        each(block, &|x| x + mul_high(x, over));
    } else {
        each(block, &|x| amplify(x, gain));
    }
}

/// The mix's state.
#[derive(Clone, Debug)]
pub struct Mix {
    output: Output,
    level: Glide,
    low: Glide,
    high: Glide,
    corners: Corners,
    limiting: bool,
    ears: [Ear; 2],
    limiter: Limiter,
    random: Random,
    /// Blocks of zeros that came in lately, up to [`REST`].
    zeros: usize,
    /// Frames since the last sample that was not zero.
    silence: u32,
}

impl Mix {
    /// A mix at rest, already at its settings.
    pub fn new(output: Output, seed: u64, settings: &Settings, sample_rate: f64) -> Self {
        Self {
            output,
            level: Glide::at(settings.level),
            low: Glide::at(settings.low),
            high: Glide::at(settings.high),
            corners: Corners::new(sample_rate),
            limiting: settings.limiter,
            ears: [Ear::default(); 2],
            limiter: Limiter::new(sample_rate),
            random: Random::new(seed, Stream::Dither),
            zeros: REST,
            silence: DITHER_TAIL,
        }
    }

    /// Glides to new settings over the next tick.
    pub fn apply(&mut self, settings: &Settings) {
        self.level.aim(settings.level);
        self.low.aim(settings.low);
        self.high.aim(settings.high);
        self.limiting = settings.limiter;
    }

    /// Turns a block of the bus into a block of output.
    pub fn render(&mut self, block: &mut Block, stats: &mut Stats) {
        let flat = self.low.steady() == Some(UNITY) && self.high.steady() == Some(UNITY);
        if flat && self.level.left == 0 && self.stays_silent(block) {
            return;
        }
        match self.level.steady() {
            Some(gain) => amplify_block(block, gain),
            None => {
                for frame in block.iter_mut() {
                    let level = self.level.next();
                    frame.left = amplify(frame.left, level);
                    frame.right = amplify(frame.right, level);
                }
            }
        }
        if self.output == Output::Raw {
            return;
        }
        let [left, right] = &mut self.ears;
        for frame in block.iter_mut() {
            frame.left = left.block_dc(frame.left, &self.corners);
            frame.right = right.block_dc(frame.right, &self.corners);
        }
        if flat {
            // As if it had followed: it is there within a millisecond, and the tone moves more slowly.
            let last = block[BLOCK - 1];
            left.low = i64::from(last.left) << 32;
            right.low = i64::from(last.right) << 32;
        } else {
            for frame in block.iter_mut() {
                let (low, high) = (self.low.next(), self.high.next());
                frame.left = left.tilt(frame.left, &self.corners, low, high);
                frame.right = right.tilt(frame.right, &self.corners, low, high);
            }
        }
        self.limiter.render(block, self.limiting, stats);
        self.dither(block);
    }

    /// Whether zeros come in and, nothing being left of what came before, go out.
    fn stays_silent(&mut self, block: &Block) -> bool {
        let zeros = block.iter().all(|frame| *frame == Frame::ZERO);
        self.zeros = if zeros { (self.zeros + 1).min(REST) } else { 0 };
        self.zeros == REST
            && self.silence == DITHER_TAIL
            && self.limiter.is_open()
            && self.ears.iter().all(|ear| ear.dc >> 32 == 0)
    }

    fn dither(&mut self, block: &mut [Frame; BLOCK]) {
        let shift = self.output.shift();
        let half = 1 << (shift - 1);
        // In a register.
        let mut random = self.random.clone();
        for frame in block {
            if *frame == Frame::ZERO {
                self.silence = (self.silence + 1).min(DITHER_TAIL);
                if self.silence == DITHER_TAIL {
                    continue;
                }
            } else {
                self.silence = 0;
            }
            for x in [&mut frame.left, &mut frame.right] {
                // Triangular, ±1 of the last bit: the difference of two uniform numbers.
                let bits = random.bits();
                let noise =
                    (bits >> (32 - shift)) as i32 - ((bits & 0xffff) >> (16 - shift)) as i32;
                // The limiter's ceiling leaves room for the noise.
                *x = (*x + noise + half) >> shift;
            }
        }
        self.random = random;
    }
}

/// The limiter's ceiling, bus units: four 16-bit steps below full scale, for the dither.
pub const CEILING: i32 = FULL_SCALE - 4 * (FULL_SCALE >> 15);
