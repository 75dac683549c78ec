//! The flash where settings are kept, and what has to be done around a save: silence first, for an F4's core stands still
//! while its flash is busy, and its DMA plays over and over what the buffer holds then.

#[cfg_attr(any(feature = "f407", feature = "f411"), path = "storage/f4.rs")]
#[cfg_attr(feature = "h743", path = "storage/h7.rs")]
mod hardware;

use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind};
use freshet::TICK;
use freshet::storage::{Record, Storage};

use crate::clock::SAMPLE_RATE;

/// Time that everything rings and glides on after the mute, ms: the DC blocker is the slowest.
const SETTLE_MS: u32 = 350;
/// Ticks of [`SETTLE_MS`].
pub const SETTLE_TICKS: u32 = SETTLE_MS * (SAMPLE_RATE / 1000) / TICK as u32;
/// Time that the mute takes, and as long again until everything is back, ms.
const FADES_MS: u32 = 2 * 50;

/// The flash did not do what it should.
#[derive(Clone, Copy, Debug)]
pub struct Fault;

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// What outlives the power.
pub type Kept = Storage<hardware::Flash>;

/// Opens what is kept; false where it had to be begun anew.
pub async fn open() -> (Kept, bool) {
    Storage::open(hardware::Flash).await
}

/// For how long the sound pauses when `record` is kept, ms.
pub async fn pause(kept: &mut Kept, record: &Record) -> u32 {
    let word = <hardware::Flash as NorFlash>::WRITE_SIZE as u32;
    let (bytes, erase) = if kept.erases(record).await {
        // All that is kept moves to the other page, at most.
        let page = <hardware::Flash as NorFlash>::ERASE_SIZE as u32;
        (page.min(16 << 10), hardware::ERASE_MS)
    } else {
        (record.len() as u32, 0)
    };
    FADES_MS + SETTLE_MS + erase + (bytes / word * hardware::WORD_US).div_ceil(1000)
}

/// For how long it fades before a restart, ms.
pub fn restart_pause() -> u32 {
    FADES_MS + SETTLE_MS
}

/// Checks that a stretch of `length` bytes from `offset` is in a flash of `capacity` bytes.
fn check(offset: u32, length: usize, capacity: usize) -> Result<(), Fault> {
    let end = (offset as usize).checked_add(length).ok_or(Fault)?;
    if end <= capacity { Ok(()) } else { Err(Fault) }
}
