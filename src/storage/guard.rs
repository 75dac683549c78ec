//! Pages of flash that are known to have been erased to the end.
//!
//! Power that goes while a page is being erased leaves it with some of its bits risen, and with what marks it as full
//! perhaps still there: a [`MapStorage`](sequential_storage::map::MapStorage) may then take it for the good one, and erase
//! the other. So each page ends with a stamp. It is cleared before the page is erased, and written when that is done; a
//! page without it holds nothing that counts, and is erased at the next start.

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// Pages there are.
pub const PAGES: u32 = 2;
/// What the stamp is made of.
const MARK: &[u8; 8] = b"freshet1";
/// Longest word of a flash, bytes.
pub const MAX_WORD: usize = 32;

/// Two pages of the flash `F`, each a little shorter than they are.
pub struct Guard<F> {
    pub(super) flash: F,
    /// Nothing was ever written, not even stamps.
    virgin: bool,
}

impl<F: NorFlash> Guard<F> {
    /// Bytes of a stamp: whole words.
    const STAMP: usize = if F::WRITE_SIZE > MARK.len() {
        F::WRITE_SIZE
    } else {
        MARK.len()
    };
    /// Bytes of a page without it.
    const PAGE: usize = F::ERASE_SIZE - Self::STAMP;

    /// Makes sure that each page is whole, or empty. False where there were none of ours.
    pub async fn mend(flash: F) -> (Self, Result<bool, F::Error>) {
        let mut guard = Self {
            flash,
            virgin: false,
        };
        let result = guard.check().await;
        (guard, result)
    }

    async fn check(&mut self) -> Result<bool, F::Error> {
        let mut stamped = [false; PAGES as usize];
        for (page, stamped) in (0..).zip(&mut stamped) {
            *stamped = self.is_stamped(page).await?;
        }
        let any = stamped.contains(&true);
        if !any && self.is_blank(F::ERASE_SIZE).await? {
            self.virgin = true;
            return Ok(true);
        }
        // But for what a loss of power left of the very first stamps.
        let sound = any || self.is_blank(Self::PAGE).await?;
        for (page, stamped) in (0..).zip(stamped) {
            if !stamped {
                self.erase_page(page).await?;
            }
        }
        Ok(sound)
    }

    /// Where a page's stamp is.
    fn stamp_of(page: u32) -> u32 {
        page * F::ERASE_SIZE as u32 + Self::PAGE as u32
    }

    async fn is_stamped(&mut self, page: u32) -> Result<bool, F::Error> {
        let mut bytes = [0; MAX_WORD];
        let bytes = &mut bytes[..Self::STAMP];
        self.flash.read(Self::stamp_of(page), bytes).await?;
        Ok(bytes.chunks(MARK.len()).all(|part| part == MARK))
    }

    /// Whether the first `length` bytes of each page are as an erase leaves them.
    async fn is_blank(&mut self, length: usize) -> Result<bool, F::Error> {
        let mut bytes = [0; MAX_WORD];
        for page in 0..PAGES {
            let start = page * F::ERASE_SIZE as u32;
            for at in (0..length).step_by(MAX_WORD) {
                let bytes = &mut bytes[..MAX_WORD.min(length - at)];
                self.flash.read(start + at as u32, bytes).await?;
                if bytes.iter().any(|byte| *byte != 0xff) {
                    return Ok(false);
                }
            }
        }
        Ok(true)
    }

    async fn stamp(&mut self, page: u32) -> Result<(), F::Error> {
        let mut bytes = [0; MAX_WORD];
        let bytes = &mut bytes[..Self::STAMP];
        for part in bytes.chunks_mut(MARK.len()) {
            part.copy_from_slice(MARK);
        }
        self.flash.write(Self::stamp_of(page), bytes).await
    }

    async fn erase_page(&mut self, page: u32) -> Result<(), F::Error> {
        if self.is_stamped(page).await? {
            // Bits only fall: that can be written over anything.
            let nothing = &[0; MAX_WORD][..Self::STAMP];
            self.flash.write(Self::stamp_of(page), nothing).await?;
        }
        let start = page * F::ERASE_SIZE as u32;
        (self.flash)
            .erase(start, start + F::ERASE_SIZE as u32)
            .await?;
        self.stamp(page).await
    }

    /// Where an address is that is counted without stamps.
    fn place(address: u32) -> u32 {
        let page = address / Self::PAGE as u32;
        address + page * Self::STAMP as u32
    }
}

impl<F: ErrorType> ErrorType for Guard<F> {
    type Error = F::Error;
}

impl<F: NorFlash> ReadNorFlash for Guard<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(Self::place(offset), bytes).await
    }

    fn capacity(&self) -> usize {
        PAGES as usize * Self::PAGE
    }
}

impl<F: NorFlash> NorFlash for Guard<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = Self::PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        self.virgin = false;
        for start in (from..to).step_by(Self::PAGE) {
            self.erase_page(start / Self::PAGE as u32).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        if self.virgin {
            for page in 0..PAGES {
                self.stamp(page).await?;
            }
            self.virgin = false;
        }
        self.flash.write(Self::place(offset), bytes).await
    }
}
