//! The board freshet runs on, emulated: it boots the ELF that is flashed, unmodified, and records
//! what a DAC on its I2S pins would hear.
//!
//! ```no_run
//! use std::time::Duration;
//! use emulated_board::{Board, Chip, Elf, Setup};
//!
//! # fn main() -> Result<(), emulated_board::Error> {
//! let elf = Elf::load("freshet-f407")?;
//! let mut board = Board::new(Chip::F407, &elf, Setup::default())?;
//! board.run(Duration::from_secs(1))?;
//! assert_eq!(board.sample_rate()?, 48_000.0);
//! let frames = board.take_audio();
//! # Ok(())
//! # }
//! ```
//!
//! The core, its interrupt controller and most peripherals are rigless'; this crate adds the I2S, the
//! codec, external interrupts, a flash that programs, and the faults. Time is counted in executed
//! instructions, [`Setup::cycles_per_instruction`] of the core clock each, whatever the clock tree
//! says; peripherals keep the time their own registers give.

mod board;
mod clocks;
mod codec;
mod counter;
mod elf;
mod exti;
mod f4;
mod f407;
mod f411;
mod flash;
mod h743;
mod i2s;
mod i2s_f4;
mod i2s_h7;
mod part;
mod pins;
mod record;
mod registers;
mod rtt;
mod serial;
mod timer;
mod transmitter;
mod warm;
mod watchdog;
mod wires;

pub use board::{Board, Cause, Error, MOST_GAPS, Reset, Setup};
pub use codec::{ADDRESS as CODEC_ADDRESS, Codec, CodecEvent, CodecFault};
pub use counter::{Counter, Counts, HandlerCounts, InterruptCounts};
pub use elf::{Elf, ElfError, Section, Symbol};
pub use i2s::{AudioFormat, Standard};
pub use part::Chip;
pub use record::{LedChange, Stream};
pub use registers::Registers;
