//! A seeded generator: xoroshiro64* (Blackman and Vigna), six instructions a draw on a 32-bit core.

use crate::fixed::cosine;

/// Each part of the instrument has a stream of its own, so that none disturbs another.
#[derive(Clone, Copy, Debug)]
pub enum Stream {
    /// Births of the population.
    Population = 1,
    /// Dither.
    Dither,
    /// Waves of the swell.
    Swell,
    /// Falling drops.
    Drops,
    /// Bubbles of the cloud.
    Cloud,
}

/// The generator; period 2^64 − 1.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Random {
    s0: u32,
    s1: u32,
}

impl Random {
    /// One that is not seeded, until another takes its place.
    pub const OFF: Self = Self { s0: 0, s1: 0 };

    /// The generator of one stream of one seed.
    pub fn new(seed: u64, stream: Stream) -> Self {
        let mut x = seed ^ (stream as u64).wrapping_mul(0xd134_2543_de82_ef95);
        let mut mix = move || {
            // splitmix64, Steele et al.
            x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = x;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        };
        // All zeros is the one state that stays where it is.
        let state = mix().max(1);
        Self {
            s0: state as u32,
            s1: (state >> 32) as u32,
        }
    }

    /// 32 random bits.
    #[inline(always)]
    pub fn bits(&mut self) -> u32 {
        let (s0, mut s1) = (self.s0, self.s1);
        let result = s0.wrapping_mul(0x9e37_79bb);
        s1 ^= s0;
        self.s0 = s0.rotate_left(26) ^ s1 ^ (s1 << 9);
        self.s1 = s1.rotate_left(13);
        result
    }

    /// Twice 32 random bits in one step: the state is evenly spread over all its values, so the pair is too.
    #[inline(always)]
    pub fn pair(&mut self) -> [u32; 2] {
        let other = self.s1.wrapping_mul(0x9e37_79bb);
        [self.bits(), other]
    }

    /// A uniform number in (0, 1). Control path only.
    pub fn uniform(&mut self) -> f32 {
        ((self.bits() >> 9) as f32 + 0.5) / 8_388_608.0
    }

    /// A standard exponential number. Control path only.
    pub fn exponential(&mut self) -> f32 {
        -libm::logf(self.uniform())
    }

    /// A standard normal number (Box–Muller). Control path only.
    pub fn normal(&mut self) -> f32 {
        let radius = libm::sqrtf(2.0 * self.exponential());
        radius * cosine(self.uniform())
    }

    /// A number of about normal distribution in the audio path: mean 0, deviation [`Self::ROUGH_DEVIATION`],
    /// the sum of four uniform 16-bit numbers.
    #[inline(always)]
    pub fn rough_normal(&mut self) -> i32 {
        let (a, b) = (self.bits(), self.bits());
        ((a & 0xffff) + (a >> 16) + (b & 0xffff) + (b >> 16)) as i32 - 0x1_fffe
    }

    /// `sqrt(4 (2^32 − 1) / 12)`.
    pub const ROUGH_DEVIATION: f64 = 37_837.227;
}
