//! The second bank of the STM32H7's flash, RM0433 chapter 4. The code stands in the first one, and runs on.

use core::arch::asm;

use embassy_futures::yield_now;
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::Bank;
use embassy_time::{Duration, Instant};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::Fault;
use crate::supervisor;

/// The bank's last two sectors.
const START: u32 = 0x081c_0000;
const FIRST_SECTOR: u8 = 6;
/// Bytes of a sector.
const PAGE: usize = 128 << 10;
/// Bytes that are written at once, under one checksum.
const WORD: usize = 32;
/// Of programming: 64 bits at a time.
const PARALLEL: u8 = 3;

/// Time that an erase takes at most, ms, and a word, typically, µs (DS12110 table 140).
pub const ERASE_MS: u32 = 2_600;
/// See [`ERASE_MS`].
pub const WORD_US: u32 = 100;

/// The second bank.
fn bank() -> Bank {
    FLASH.bank(1)
}

/// The sectors where settings are kept.
pub struct Flash;

impl Flash {
    fn unlock() {
        if bank().cr().read().lock() {
            bank().keyr().write_value(0x4567_0123);
            bank().keyr().write_value(0xcdef_89ab);
        }
        Self::clear();
    }

    fn lock() {
        bank().cr().write(|w| w.set_lock(true));
    }

    /// Errors of before.
    fn clear() {
        bank().ccr().write(|w| {
            w.set_clr_eop(true);
            w.set_clr_wrperr(true);
            w.set_clr_pgserr(true);
            w.set_clr_strberr(true);
            w.set_clr_incerr(true);
            w.set_clr_operr(true);
        });
    }

    /// Waits until the bank is idle, and lets others run meanwhile.
    async fn wait() -> Result<(), Fault> {
        let end = Instant::now() + Duration::from_millis(2 * u64::from(ERASE_MS));
        while bank().sr().read().qw() || bank().sr().read().bsy() {
            if Instant::now() > end {
                return Err(Fault);
            }
            supervisor::feed_watchdog();
            yield_now().await;
        }
        let status = bank().sr().read();
        let failed = status.wrperr()
            || status.pgserr()
            || status.strberr()
            || status.incerr()
            || status.operr();
        if failed { Err(Fault) } else { Ok(()) }
    }

    /// Reads up to a word. One that a loss of power left half written does not match its own checksum, and reading it is
    /// a bus fault: that is ignored here, and such a word reads as zeros.
    fn read_word(at: u32, bytes: &mut [u8]) {
        // SAFETY: only this touches the register that has faults ignored, with everything else masked.
        let scb = unsafe { &*cortex_m::peripheral::SCB::PTR };
        const IGNORE_BUS_FAULTS: u32 = 1 << 8;
        const BUS_FAULTS: u32 = 0xff << 8;
        // SAFETY: reads flash; faults are masked in between, and what was masked before is not changed.
        unsafe {
            asm!("cpsid f");
            scb.ccr.modify(|ccr| ccr | IGNORE_BUS_FAULTS);
            asm!("dsb", "isb");
            for (i, byte) in bytes.iter_mut().enumerate() {
                *byte = (at as *const u8).add(i).read_volatile();
            }
            asm!("dsb", "isb");
            scb.ccr.modify(|ccr| ccr & !IGNORE_BUS_FAULTS);
            scb.cfsr.write(BUS_FAULTS);
            asm!("cpsie f");
        }
        if bank().sr().read().dbeccerr() {
            bank().ccr().write(|w| w.set_clr_dbeccerr(true));
            bytes.fill(0);
        }
    }
}

impl ErrorType for Flash {
    type Error = Fault;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        super::check(offset, bytes.len(), self.capacity())?;
        let mut at = START + offset;
        let mut rest = bytes;
        while !rest.is_empty() {
            let count = (WORD - at as usize % WORD).min(rest.len());
            let (word, more) = rest.split_at_mut(count);
            Self::read_word(at, word);
            at += count as u32;
            rest = more;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * PAGE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        super::check(from, to.saturating_sub(from) as usize, self.capacity())?;
        for page in (from..to).step_by(PAGE) {
            Self::unlock();
            bank().cr().write(|w| {
                w.set_ser(true);
                w.set_snb(FIRST_SECTOR + (page / PAGE as u32) as u8);
                w.set_psize(PARALLEL);
            });
            bank().cr().modify(|w| w.set_start(true));
            let erased = Self::wait().await;
            Self::lock();
            erased?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        super::check(offset, bytes.len(), self.capacity())?;
        Self::unlock();
        bank().cr().write(|w| {
            w.set_pg(true);
            w.set_psize(PARALLEL);
        });
        let mut written = Ok(());
        let mut to = (START + offset) as *mut u32;
        for word in bytes.chunks_exact(WORD) {
            for part in word.chunks_exact(4) {
                let part = u32::from_le_bytes([part[0], part[1], part[2], part[3]]);
                // SAFETY: in the two sectors, aligned as the trait demands, and the bank is set to program.
                unsafe {
                    to.write_volatile(part);
                    to = to.add(1);
                }
            }
            written = Self::wait().await;
            if written.is_err() {
                break;
            }
        }
        Self::lock();
        written
    }
}
