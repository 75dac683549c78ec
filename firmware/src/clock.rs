//! The sample clock, computed from the dividers that are set.

/// Dividers from the crystal to the sample clock.
#[derive(Clone, Copy)]
pub struct SampleClock {
    /// Crystal, Hz.
    pub crystal: u32,
    /// Into the phase-locked loop.
    pub m: u32,
    /// Its multiplier.
    pub n: u32,
    /// Out of it, to the I2S block.
    pub r: u32,
    /// `I2SDIV`.
    pub div: u8,
    /// `ODD`.
    pub odd: bool,
    /// Whether the DAC gets a master clock of 256 times the sample rate.
    pub master_clock: bool,
}

impl SampleClock {
    /// The I2S block's clock in Hz times `m·r`, so that nothing is rounded.
    const fn scaled(&self) -> u64 {
        self.crystal as u64 * self.n as u64
    }

    /// Clocks of the I2S block in a frame, times `m·r`: 256 a step with a master clock, else 64 (two slots of 32 bits).
    const fn frame(&self) -> u64 {
        let step = if self.master_clock { 256 } else { 64 };
        step * (2 * self.div as u64 + self.odd as u64) * (self.m * self.r) as u64
    }

    /// The true sample rate, Hz.
    pub const fn rate(&self) -> f64 {
        self.scaled() as f64 / self.frame() as f64
    }

    /// How far the true rate is from `wanted` Hz, in parts per million, rounded up.
    pub const fn error_ppm(&self, wanted: u64) -> u64 {
        let off = self.scaled().abs_diff(wanted * self.frame());
        (off * 1_000_000).div_ceil(wanted * self.frame())
    }
}

/// The rate that scenes are tuned for, Hz.
pub const SAMPLE_RATE: u32 = 48_000;

const _: () = assert!(
    crate::board::CLOCK.error_ppm(SAMPLE_RATE as u64) <= 20,
    "the board's dividers miss 48 kHz by more than 20 ppm"
);
