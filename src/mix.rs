//! From the bus in pascal to the converter: level, DC blocker, tone, limiter, dither.

use crate::fixed::{FULL_SCALE, to_fixed};
use crate::frame::{BLOCK, Block, Frame};
use crate::limiter::Limiter;
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
    const fn shift(self) -> u32 {
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
/// Frames in which a gain moves to another one, along a line: 21 ms at 48 kHz.
pub const GLIDE: usize = 1024;
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

    /// The same, with a further gain from 0 to 1.
    pub fn attenuated(mut self, gain: f32) -> Self {
        // The level itself is finer than an f32.
        if gain < 1.0 {
            self.level = (self.level as f32 * gain) as i32;
        }
        self
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
    const fn at(target: i32) -> Self {
        Self {
            now: (target as i64) << 16,
            step: 0,
            target,
            left: 0,
        }
    }

    fn aim(&mut self, target: i32) {
        if self.settled() == Some(target) {
            return;
        }
        self.target = target;
        self.left = GLIDE as u32;
        self.step = ((i64::from(target) << 16) - self.now) / GLIDE as i64;
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

    /// The gain for as long as nothing new is aimed at; none where it is still moving.
    fn settled(&self) -> Option<i32> {
        (self.left == 0).then_some(self.target)
    }
}

/// One ear's filters.
#[derive(Clone, Copy, Debug, Default)]
struct Ear {
    /// Running mean, Q32.32.
    mean: i64,
    /// The tone's low-pass, Q32.32.
    low: i64,
}

impl Ear {
    #[inline(always)]
    fn block_dc(&mut self, x: i32, corners: &Corners) -> i32 {
        let x = x.saturating_sub((self.mean >> 32) as i32);
        self.mean += i64::from(x) * i64::from(corners.dc);
        x
    }

    #[inline(always)]
    fn tone(&mut self, x: i32, corners: &Corners, low: i32, high: i32) -> i32 {
        // One pole by the trapezoidal rule: nothing is left of it at the top of the band.
        let above = x.saturating_sub((self.low >> 32) as i32);
        let half_step = i64::from(above) * i64::from(corners.tone);
        self.low += half_step;
        let below = (self.low >> 32) as i32;
        self.low += half_step;
        let above = x.saturating_sub(below);
        narrow(i64::from(below) * i64::from(low) + i64::from(above) * i64::from(high))
    }

    /// Whether silence goes through and changes nothing.
    fn is_at_rest(&self) -> bool {
        self.mean >> 32 == 0 && self.low >> 32 == 0
    }
}

/// Where the filters turn; they depend on the sample rate alone.
#[derive(Clone, Copy, Debug)]
struct Corners {
    /// The DC blocker's part of a sample, a power of two, Q32.
    dc: i32,
    /// g/(1 + g) with g = tan(π·corner/rate), Q32.
    tone: i32,
}

impl Corners {
    fn new(sample_rate: f64) -> Self {
        let pi = core::f64::consts::PI;
        let g = libm::tan(pi * TONE_CORNER / sample_rate);
        let octaves = libm::round(libm::log2(sample_rate / (2.0 * pi * DC_CORNER)));
        Self {
            dc: to_fixed(libm::exp2(-octaves), 32),
            tone: to_fixed(g / (1.0 + g), 32),
        }
    }
}

/// `x >> 24`, held inside an i32.
#[inline(always)]
fn narrow(x: i64) -> i32 {
    let top = (x >> 32) as i32;
    match top.clamp(-(1 << 23), (1 << 23) - 1) {
        held if held == top => (x >> 24) as i32,
        held => (held >> 31) ^ i32::MAX,
    }
}

#[inline(always)]
fn amplify(x: i32, gain: i32) -> i32 {
    narrow(i64::from(x) * i64::from(gain) + (1 << 23))
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
    /// Frames since the last sample that was not zero.
    silence: u32,
}

impl Mix {
    /// One that lets nothing through, until another takes its place.
    pub const OFF: Self = Self {
        output: Output::Raw,
        level: Glide::at(0),
        low: Glide::at(0),
        high: Glide::at(0),
        corners: Corners { dc: 0, tone: 0 },
        limiting: false,
        ears: [Ear { mean: 0, low: 0 }; 2],
        limiter: Limiter::OFF,
        random: Random::OFF,
        silence: 0,
    };

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
            silence: DITHER_TAIL,
        }
    }

    /// Glides to new settings.
    pub fn apply(&mut self, settings: &Settings) {
        self.level.aim(settings.level);
        self.low.aim(settings.low);
        self.high.aim(settings.high);
        self.limiting = settings.limiter;
    }

    /// Turns a block of the bus into a block of output.
    pub fn render(&mut self, block: &mut Block, stats: &mut Stats) {
        if self.is_at_rest() && *block == [Frame::ZERO; BLOCK] {
            return;
        }
        self.amplify(block);
        match self.output {
            Output::Raw => return,
            Output::Bits16 | Output::Bits24 => self.filter(block),
        }
        self.limiter.render(block, self.limiting, stats);
        match self.output {
            Output::Bits16 => self.dither::<{ Output::Bits16.shift() }>(block),
            _ => self.dither::<{ Output::Bits24.shift() }>(block),
        }
    }

    /// Whether a silent block comes out silent and changes nothing.
    fn is_at_rest(&self) -> bool {
        [&self.level, &self.low, &self.high]
            .iter()
            .all(|gain| gain.left == 0)
            && self.silence == DITHER_TAIL
            && self.ears.iter().all(Ear::is_at_rest)
            && self.limiter.is_at_rest()
    }

    fn amplify(&mut self, block: &mut Block) {
        match self.level.settled() {
            Some(UNITY) => {}
            Some(level) => block.iter_mut().for_each(|frame| {
                frame.left = amplify(frame.left, level);
                frame.right = amplify(frame.right, level);
            }),
            None => block.iter_mut().for_each(|frame| {
                let level = self.level.next();
                frame.left = amplify(frame.left, level);
                frame.right = amplify(frame.right, level);
            }),
        }
    }

    fn filter(&mut self, block: &mut Block) {
        let corners = self.corners;
        let [mut left, mut right] = self.ears;
        for frame in block.iter_mut() {
            frame.left = left.block_dc(frame.left, &corners);
            frame.right = right.block_dc(frame.right, &corners);
        }
        let gains = (self.low.settled(), self.high.settled());
        if gains == (Some(UNITY), Some(UNITY)) {
            // Flat: begins anew when it is wanted, long before its gains have glided apart.
            (left.low, right.low) = (0, 0);
        } else if let (Some(low), Some(high)) = gains {
            for frame in block.iter_mut() {
                frame.left = left.tone(frame.left, &corners, low, high);
                frame.right = right.tone(frame.right, &corners, low, high);
            }
        } else {
            for frame in block.iter_mut() {
                let (low, high) = (self.low.next(), self.high.next());
                frame.left = left.tone(frame.left, &corners, low, high);
                frame.right = right.tone(frame.right, &corners, low, high);
            }
        }
        self.ears = [left, right];
    }

    #[inline(always)]
    fn dither<const SHIFT: u32>(&mut self, block: &mut Block) {
        const { assert!(0 < SHIFT && SHIFT < 16) };
        let top = (FULL_SCALE >> SHIFT) - 1;
        let mut random = self.random.clone();
        let mut silence = self.silence;
        let mut dither = |frame: &mut Frame| {
            silence = if *frame == Frame::ZERO {
                (silence + 1).min(DITHER_TAIL)
            } else {
                0
            };
            if silence == DITHER_TAIL {
                return;
            }
            for x in [&mut frame.left, &mut frame.right] {
                // Triangular, ±1 of the last bit: the difference of two uniform numbers.
                let bits = random.bits();
                let noise =
                    (bits >> (32 - SHIFT)) as i32 - ((bits & 0xffff) >> (16 - SHIFT)) as i32;
                *x = ((*x + noise + (1 << (SHIFT - 1))) >> SHIFT).clamp(-top - 1, top);
            }
        };
        // By fours, for a Cortex-M: what the loop itself costs counts.
        for four in block.as_chunks_mut::<4>().0 {
            four.iter_mut().for_each(&mut dither);
        }
        self.random = random;
        self.silence = silence;
    }
}

/// The limiter's ceiling, bus units: four 16-bit steps below full scale, for the dither.
pub const CEILING: i32 = FULL_SCALE - 4 * (FULL_SCALE >> 15);
