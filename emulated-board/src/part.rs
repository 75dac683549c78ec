//! What a board asks of the microcontroller on it, whichever that is.

use std::num::NonZeroU64;

use rigless::emulator::CoreSpec;
use rigless::machine::{self, Target};
use rigless::mcu::Mcu;
use rigless::snapshot::Store;
use rigless::soc::Error;
use rigless::time::VirtualNanos;

use crate::codec::Codec;
use crate::f4::F4;
use crate::h743::H743;
use crate::record::Shared;
use crate::warm::warm;
use crate::{f407, f411, flash, h743};

/// The microcontrollers emulated here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chip {
    /// The STM32F407VG of an STM32F407G-DISC1: 168 MHz, codec on board.
    F407,
    /// The STM32F411CE of a Black Pill: 96 MHz.
    F411,
    /// The STM32H743ZI of a Nucleo-H743ZI2: 480 MHz.
    H743,
}

/// What is the same for every board of a chip.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facts {
    /// The core clock the firmware is written for, Hz.
    pub(crate) core_hz: u64,
    /// The crystal or clock on the oscillator pins, Hz.
    pub(crate) crystal_hz: u64,
    /// The flash array: first address and bytes.
    pub(crate) flash: (u32, u32),
    /// Every RAM, first address and bytes.
    pub(crate) ram: &'static [(u32, u32)],
    /// Where the unique identity is.
    pub(crate) identity: u32,
    /// Where the size of the flash in kB is.
    pub(crate) flash_size: u32,
}

impl Chip {
    pub(crate) fn facts(self) -> &'static Facts {
        match self {
            Self::F407 => &f407::SHEET.facts,
            Self::F411 => &f411::SHEET.facts,
            Self::H743 => &h743::FACTS,
        }
    }
}

/// What a part is built with.
#[derive(Debug, Clone)]
pub(crate) struct Fittings {
    pub(crate) record: Shared,
    pub(crate) codec: Codec,
    /// 0 for a crystal that does not start.
    pub(crate) crystal_hz: u64,
    pub(crate) options: Option<u32>,
}

/// One of the microcontrollers.
pub(crate) trait Part: Mcu + Send + std::fmt::Debug {
    /// The core, retiring this many instructions a second.
    fn core(&self, instructions_per_second: NonZeroU64) -> CoreSpec;
    /// After a reset: the supply came on, and the backup domain and the reset flags with it.
    fn power_on(&mut self);
    /// Types `bytes` on the serial line.
    fn type_serial(&mut self, bytes: &[u8]);
    /// Has a bit on the serial line take this many clocks of the port, both ways.
    fn serial_divider(&mut self, clocks: u32);
    /// Has this many words in a million arrive garbled on the serial line, each with a framing error.
    fn garble_serial(&mut self, per_million: u32);
    /// Presses the user button, or lets go of it.
    fn button(&mut self, at: VirtualNanos, pressed: bool);
    /// Cuts an interrupt's line until an instant; answers whether the part can.
    fn cut_interrupt(&mut self, at: VirtualNanos, line: u16, until: VirtualNanos) -> bool;
    /// What is being done to the flash array, which the core waits for.
    fn flash_operation(&self) -> Option<flash::Operation>;
    /// The option bytes.
    fn options(&self) -> u32;
    /// Frames a second as the registers stand, 0 while nothing is clocked.
    fn sample_rate(&self) -> f64;
}

/// The board as rigless runs it.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) part: Box<dyn Part>,
    instructions_per_second: NonZeroU64,
}

impl Machine {
    pub(crate) fn new(
        chip: Chip,
        fittings: Fittings,
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        let part: Box<dyn Part> = match chip {
            Chip::F407 => Box::new(F4::new(&f407::SHEET, fittings)?),
            Chip::F411 => Box::new(F4::new(&f411::SHEET, fittings)?),
            Chip::H743 => Box::new(H743::new(fittings)?),
        };
        Ok(Self {
            part,
            instructions_per_second,
        })
    }
}

impl Store for Machine {}

const NAME: &str = "board";

impl machine::Board for Machine {
    fn name(&self) -> &'static str {
        NAME
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![NAME]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(self.part.as_mut() as &mut dyn Mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = warm(self.part.core(self.instructions_per_second));
        vec![Target::new(NAME, self.part.as_mut(), core)]
    }
}
