//! How samples go over I2S.

use std::fmt;

/// The alignment of a sample within its channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Standard {
    /// Philips: one bit clock after the edge of the word select.
    #[default]
    Philips,
    /// Left justified.
    LeftJustified,
    /// Right justified.
    RightJustified,
    /// PCM.
    Pcm,
}

/// How an I2S sends its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AudioFormat {
    /// Bits of a sample: 16, 24 or 32.
    pub data_bits: u32,
    /// Bit clocks of a channel: 16 or 32.
    pub channel_bits: u32,
    /// Alignment.
    pub standard: Standard,
    /// Whether the master clock, 256 times the frame rate, is put out.
    pub master_clock: bool,
}

impl AudioFormat {
    /// The format the fields `DATLEN`, `CHLEN`, `I2SSTD` and `MCKOE` of any STM32 ask for.
    pub(crate) fn from_fields(datlen: u64, chlen: u64, standard: u64, master_clock: bool) -> Self {
        let data_bits = match datlen {
            0 => 16,
            1 => 24,
            _ => 32,
        };
        Self {
            data_bits,
            // A channel of more than 16 bits of data is 32 long whatever CHLEN says.
            channel_bits: if data_bits > 16 || chlen != 0 { 32 } else { 16 },
            standard: match standard {
                0 => Standard::Philips,
                1 => Standard::LeftJustified,
                2 => Standard::RightJustified,
                _ => Standard::Pcm,
            },
            master_clock,
        }
    }

    /// Kernel clocks of a frame whose divider is `divider`, RM0090 28.4.4 and RM0433 50.9.
    pub(crate) fn frame_cycles(&self, divider: u64) -> u64 {
        let per_step = if self.master_clock {
            256
        } else {
            2 * u64::from(self.channel_bits)
        };
        per_step * divider
    }
}

impl fmt::Display for AudioFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let clock = if self.master_clock { "with" } else { "no" };
        write!(
            f,
            "{} bits in {}-bit channels, {:?}, {clock} master clock",
            self.data_bits, self.channel_bits, self.standard
        )
    }
}
