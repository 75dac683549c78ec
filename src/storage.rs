//! What outlives the power: settings, presets and the boot choice, in a flash that is worn evenly.
//!
//! Whatever a loss of power leaves, each page of flash is whole or empty at the next start (`guard`). In them a
//! [`MapStorage`] appends every new value behind the ones before, with a checksum over length, key and value, and begins
//! a new page of flash when one is full; what is under way when the power goes is not there at the next start, and the old
//! value is. On top of that a value begins with the version of its form; parameters go by their ids, so that a table that
//! grew, or shrank, reads what another wrote: what it does not know is left out, and what is not there is at its default.

mod guard;

use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use heapless::Vec;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

use guard::{Guard, MAX_WORD, PAGES};

use crate::param::{self, COUNT, TABLE};
use crate::protocol::{Boot, BootRecord, NAME, Name, Pair, Preset, SLOTS, Slot};

/// Of all values; another means another form.
const VERSION: u8 = 1;
/// Of the boot choice. The others are the slots'.
const BOOT: u8 = 255;
/// Slots, the settings and the boot choice.
const KEYS: usize = SLOTS as usize + 2;

/// Longest value, bytes: version, two names with their lengths, a count, and all parameters, the ids in up to 3 bytes.
const VALUE: usize = 1 + 2 * (1 + NAME) + 3 + COUNT * (3 + 4);
/// Longest item that is read, bytes: there is room for the value of a table that has grown.
const ITEM: usize = 1024;
const _: () = assert!(VALUE < ITEM);

/// Why something could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StorageError {
    /// The flash did not take it.
    Flash,
    /// There is no room for it.
    Full,
}

/// A value as it is kept, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    key: u8,
    bytes: Vec<u8, VALUE>,
}

impl Record {
    /// Settings in a slot.
    pub fn preset(slot: Slot, preset: &Preset) -> Option<Self> {
        Self::new(slot, &(VERSION, preset))
    }

    /// An empty slot.
    pub fn empty(slot: Slot) -> Option<Self> {
        Self::new(slot, &VERSION)
    }

    /// The boot choice.
    pub fn boot(boot: &BootRecord) -> Option<Self> {
        Self::new(BOOT, &(VERSION, boot.boot()))
    }

    /// Any bytes, as another version may have written them.
    pub fn raw(slot: Slot, bytes: &[u8]) -> Option<Self> {
        let bytes = Vec::from_slice(bytes).ok()?;
        Some(Self { key: slot, bytes })
    }

    /// None where it is longer than any can be.
    fn new(key: u8, value: &impl serde::Serialize) -> Option<Self> {
        let mut bytes = [0; VALUE];
        let bytes = postcard::to_slice(value, &mut bytes).ok()?;
        let bytes = Vec::from_slice(bytes).ok()?;
        Some(Self { key, bytes })
    }

    /// Bytes of its value.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether it takes the place of something, and holds nothing.
    pub fn is_empty(&self) -> bool {
        body(&self.bytes).is_none()
    }

    /// The slot whose settings it has.
    pub fn slot(&self) -> Option<Slot> {
        (self.key != BOOT).then_some(self.key)
    }
}

/// A value without its version; none where this program does not know its form, or it says that nothing is kept.
fn body(bytes: &[u8]) -> Option<&[u8]> {
    let body = bytes.strip_prefix(&[VERSION])?;
    (!body.is_empty()).then_some(body)
}

/// Settings from a value.
fn preset(bytes: &[u8]) -> Option<Preset> {
    let (head, mut rest) = postcard::take_from_bytes::<(&str, &str, u32)>(body(bytes)?).ok()?;
    let (name, scene, count) = head;
    let mut preset = Preset {
        name: Name::try_from(name).unwrap_or_default(),
        scene: Name::try_from(scene).unwrap_or_default(),
        ..Preset::default()
    };
    for _ in 0..count {
        let (pair, left) = postcard::take_from_bytes::<Pair>(rest).ok()?;
        rest = left;
        let (id, value) = pair;
        if param::index_of_id(id).is_some_and(|index| TABLE[index].accepts(value)) {
            // There is room for each that is known, and one told twice is no harm.
            let _ = preset.values.push(pair);
        }
    }
    Some(preset)
}

type Cells = Cache<Uncached, Uncached, ArrayKeyPointers<u8, KEYS>, u8>;

/// What is kept in the flash `F`.
pub struct Storage<F: NorFlash> {
    map: MapStorage<u8, Guard<F>, Cells>,
    /// Slots that hold settings, one bit each.
    kept: u32,
}

impl<F: NorFlash> Storage<F> {
    /// What is kept in the first two pages of `flash`. Mends what a loss of power left; where nothing of ours is there,
    /// erases all, to begin anew, and says false.
    pub async fn open(flash: F) -> (Self, bool) {
        let config = const { MapConfig::new(0..PAGES * <Guard<F> as NorFlash>::ERASE_SIZE as u32) };
        let (flash, mended) = Guard::mend(flash).await;
        let cells = Cache::new(Uncached, Uncached, ArrayKeyPointers::new());
        let mut storage = Self {
            map: MapStorage::new(flash, config, cells),
            kept: 0,
        };
        let found = storage.find().await.is_ok();
        if !found {
            // Where not even this can be done, each save will say so.
            let _ = storage.map.erase_all().await;
        }
        let mut sound = found && mended.unwrap_or(false);
        // Where each is, so that reading one later does not have to look through all.
        for slot in 0..=SLOTS {
            if storage.is_kept(slot) {
                sound &= storage.preset(slot).await.is_some();
            }
        }
        (storage, sound)
    }

    /// Finds which slots hold something.
    async fn find(&mut self) -> Result<(), sequential_storage::Error<F::Error>> {
        let mut buffer = [0; ITEM];
        let mut kept = 0;
        let mut items = self.map.fetch_all_items(&mut buffer).await?;
        // From old to new: the last one of each is what counts.
        while let Some((key, bytes)) = items.next::<&[u8]>(&mut buffer).await? {
            if key <= SLOTS {
                let bit = 1 << key;
                kept = if body(bytes).is_some() {
                    kept | bit
                } else {
                    kept & !bit
                };
            }
        }
        self.kept = kept;
        Ok(())
    }

    /// Whether a slot holds settings.
    pub fn is_kept(&self, slot: Slot) -> bool {
        slot <= SLOTS && self.kept & (1 << slot) != 0
    }

    /// The settings in a slot.
    pub async fn preset(&mut self, slot: Slot) -> Option<Preset> {
        if !self.is_kept(slot) {
            return None;
        }
        let mut buffer = [0; ITEM];
        preset(self.fetch(slot, &mut buffer).await?)
    }

    /// The boot choice.
    pub async fn boot(&mut self) -> BootRecord {
        let mut buffer = [0; ITEM];
        let value = self.fetch(BOOT, &mut buffer).await.and_then(body);
        let boot = value.and_then(|value| postcard::from_bytes::<Boot<'_>>(value).ok());
        boot.map(BootRecord::from).unwrap_or_default()
    }

    /// Whether that is what is kept already.
    pub async fn has(&mut self, record: &Record) -> bool {
        let mut buffer = [0; ITEM];
        self.fetch(record.key, &mut buffer).await == Some(&record.bytes)
    }

    async fn fetch<'b>(&mut self, key: u8, buffer: &'b mut [u8; ITEM]) -> Option<&'b [u8]> {
        self.map.fetch_item(buffer, &key).await.ok().flatten()
    }

    /// Keeps a value. Where it fails, what was there before still is.
    pub async fn keep(&mut self, record: &Record) -> Result<(), StorageError> {
        let mut buffer = [0; ITEM];
        let bytes: &[u8] = &record.bytes;
        let stored = self.map.store_item(&mut buffer, &record.key, &bytes).await;
        stored.map_err(|error| match error {
            sequential_storage::Error::FullStorage => StorageError::Full,
            _ => StorageError::Flash,
        })?;
        if let Some(slot) = record.slot() {
            let bit = 1 << slot;
            self.kept = match body(bytes) {
                Some(_) => self.kept | bit,
                None => self.kept & !bit,
            };
        }
        Ok(())
    }

    /// Whether a page has to be erased to keep `record`, as far as can be told without doing it.
    pub async fn erases(&mut self, record: &Record) -> bool {
        let word = F::WRITE_SIZE as u32;
        let value = (1 + record.bytes.len() as u32).next_multiple_of(word);
        let needed = MapStorage::<u8, Guard<F>, Cells>::item_overhead_size() + value;
        let page = <Guard<F> as NorFlash>::ERASE_SIZE;
        for start in self.map.flash_range().step_by(page) {
            let end = start + page as u32 - word;
            // Begun, and not closed: the page that is written to now.
            if !self.is_erased(start, word).await && self.is_erased(end, word).await {
                let mut free = end;
                while free > start && self.is_erased(free - word, word).await {
                    free -= word;
                }
                return end - free < needed;
            }
        }
        false
    }

    /// Whether a word is as an erase leaves it.
    async fn is_erased(&mut self, address: u32, word: u32) -> bool {
        let mut bytes = [0; MAX_WORD];
        let bytes = &mut bytes[..(word as usize).min(MAX_WORD)];
        let read = self.map.flash().read(address, bytes).await;
        read.is_ok() && bytes.iter().all(|byte| *byte == 0xff)
    }

    /// The flash.
    pub fn flash(&mut self) -> &mut F {
        &mut self.map.flash().flash
    }
}
