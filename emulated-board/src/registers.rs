//! The core's registers, read out of the state rigless saves.

use std::fmt;

use serde::Deserialize;

/// The registers of the core at an instant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Registers {
    /// `R0` to `R15`: 13 is the stack pointer in use, 14 the link register, 15 the next instruction.
    pub r: [u32; 16],
    /// The exception being handled, 0 in thread mode; interrupt `n` is `n + 16`.
    pub exception: u32,
    /// Whether the core is locked up: a fault inside a fault handler, B1.5.15 of DDI 0403E.
    pub locked_up: bool,
    /// Whether the core waits in `WFI` or `WFE`.
    pub sleeping: bool,
    /// The stack pointer not in use.
    pub other_sp: u32,
}

impl Registers {
    /// The stack pointer in use.
    pub fn sp(&self) -> u32 {
        self.r[13]
    }

    /// The link register.
    pub fn lr(&self) -> u32 {
        self.r[14]
    }

    /// The next instruction.
    pub fn pc(&self) -> u32 {
        self.r[15]
    }

    /// The registers in `state`, what rigless 0.4.0's `Host::save_state` answers for an ARMv7-M core:
    /// the processor's bytes, which begin with its register file.
    pub(crate) fn from_state(state: &[u8]) -> Option<Self> {
        let (core, _) = postcard::take_from_bytes::<&[u8]>(state).ok()?;
        let (file, _) = postcard::take_from_bytes::<File>(core).ok()?;
        Some(Self {
            r: file.r,
            exception: file.ipsr,
            locked_up: file.locked_up != 0,
            sleeping: file.sleeping != 0,
            other_sp: file.other_sp,
        })
    }
}

impl fmt::Display for Registers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, value) in self.r.iter().enumerate() {
            let gap = if number % 4 == 3 { "\n" } else { "  " };
            write!(f, "r{number:<2} {value:#010x}{gap}")?;
        }
        write!(f, "exception {}", self.exception)
    }
}

/// The register file in the order rigless keeps it.
#[derive(Deserialize)]
#[allow(
    dead_code,
    reason = "the fields between the ones read have to be read over"
)]
struct File {
    r: [u32; 16],
    flags: [u32; 5],
    ge: u32,
    it: u32,
    t: u32,
    ipsr: u32,
    primask: u32,
    faultmask: u32,
    control: u32,
    other_sp: u32,
    s: [u32; 32],
    fpscr: u32,
    locked_up: u32,
    sleeping: u32,
}
