//! The flash of the STM32F4, RM0090 chapter 3. The code stands in the same flash: the core does while that is busy.

use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::vals::Psize;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::Fault;
use crate::supervisor;

/// Sectors 1 and 2, which the memory maps of all these boards leave out.
const START: u32 = 0x0800_4000;
const FIRST_SECTOR: u8 = 1;
/// Bytes of a sector.
const PAGE: usize = 16 << 10;
/// Turns of the loop that waits; the core stands still meanwhile, so that any do.
const PATIENCE: u32 = 1_000_000;

/// Time that an erase takes at most, of words of 32 bits, ms (DS8626 table 40; DS10314 table 46); and a word, typically, µs.
pub const ERASE_MS: u32 = 500;
/// See [`ERASE_MS`].
pub const WORD_US: u32 = 16;

/// The sectors where settings are kept.
pub struct Flash;

impl Flash {
    /// Runs `operation` with the interface unlocked.
    fn unlocked(operation: impl FnOnce() -> Result<(), Fault>) -> Result<(), Fault> {
        if FLASH.cr().read().lock() {
            FLASH.keyr().write_value(0x4567_0123);
            FLASH.keyr().write_value(0xcdef_89ab);
        }
        // Errors of before: a one clears each.
        FLASH.sr().write(|w| {
            w.set_eop(true);
            w.set_operr(true);
            w.set_wrperr(true);
            w.set_pgaerr(true);
            w.set_pgperr(true);
            w.set_pgserr(true);
        });
        let result = operation();
        FLASH.cr().write(|w| w.set_lock(true));
        result
    }

    fn wait() -> Result<(), Fault> {
        let ready = (0..PATIENCE).any(|_| !FLASH.sr().read().bsy());
        let status = FLASH.sr().read();
        let failed = status.wrperr() || status.pgaerr() || status.pgperr() || status.pgserr();
        if ready && !failed { Ok(()) } else { Err(Fault) }
    }

    /// Forgets what the cache holds of before.
    fn flush() {
        FLASH.acr().modify(|w| w.set_dcen(false));
        FLASH.acr().modify(|w| w.set_dcrst(true));
        FLASH.acr().modify(|w| w.set_dcrst(false));
        FLASH.acr().modify(|w| w.set_dcen(true));
    }
}

impl ErrorType for Flash {
    type Error = Fault;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        super::check(offset, bytes.len(), self.capacity())?;
        let from = (START + offset) as *const u8;
        for (i, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: in the two sectors, which are flash and nothing else.
            *byte = unsafe { from.add(i).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * PAGE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        super::check(from, to.saturating_sub(from) as usize, self.capacity())?;
        for page in (from..to).step_by(PAGE) {
            // Nobody can feed the watchdog while the core stands still.
            supervisor::stretch_watchdog();
            let erased = Self::unlocked(|| {
                FLASH.cr().write(|w| {
                    w.set_ser(true);
                    w.set_snb(FIRST_SECTOR + (page / PAGE as u32) as u8);
                    w.set_psize(Psize::PSIZE32);
                });
                FLASH.cr().modify(|w| w.set_strt(true));
                Self::wait()
            });
            supervisor::relax_watchdog();
            Self::flush();
            erased?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        super::check(offset, bytes.len(), self.capacity())?;
        let to = (START + offset) as *mut u32;
        Self::unlocked(|| {
            FLASH.cr().write(|w| {
                w.set_pg(true);
                w.set_psize(Psize::PSIZE32);
            });
            for (i, word) in bytes.chunks_exact(4).enumerate() {
                let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
                // SAFETY: in the two sectors, aligned as the trait demands, and the interface is set to program.
                unsafe { to.add(i).write_volatile(word) };
                Self::wait()?;
            }
            Ok(())
        })?;
        Self::flush();
        Ok(())
    }
}
