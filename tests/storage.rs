//! What is stored outlives the power, wherever it goes away.

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use freshet::param::{COUNT, TABLE};
use freshet::protocol::{BootRecord, Name, Preset, SLOTS, Slot};
use freshet::storage::{Record, Storage, StorageError};

const PAGES: usize = 2;

/// A flash of two pages, as the boards have: words that are written once between erases, and whose supply may be cut.
#[derive(Clone)]
struct Flash<const PAGE: usize, const WORD: usize> {
    bytes: Vec<u8>,
    /// Steps until the power goes: a byte written or a 64th of a page erased is one. None: it stays.
    power: Option<u64>,
    /// Steps so far.
    steps: u64,
    erases: [u32; PAGES],
    /// What a word half written, or a page half erased, holds is drawn from this.
    noise: u64,
}

/// The power is gone, or the flash was misused.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Dark,
    Misuse,
}

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<const PAGE: usize, const WORD: usize> Flash<PAGE, WORD> {
    fn new() -> Self {
        Self {
            bytes: vec![0xff; PAGES * PAGE],
            power: None,
            steps: 0,
            erases: [0; PAGES],
            noise: 1,
        }
    }

    fn draw(&mut self) -> u8 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 7;
        self.noise ^= self.noise << 17;
        (self.noise >> 32) as u8
    }

    fn step(&mut self) -> Result<(), Fault> {
        self.steps += 1;
        match &mut self.power {
            Some(0) => Err(Fault::Dark),
            Some(left) => {
                *left -= 1;
                Ok(())
            }
            None => Ok(()),
        }
    }

    /// The power comes on again.
    fn on(mut self) -> Self {
        self.power = None;
        self
    }
}

impl<const PAGE: usize, const WORD: usize> ErrorType for Flash<PAGE, WORD> {
    type Error = Fault;
}

impl<const PAGE: usize, const WORD: usize> ReadNorFlash for Flash<PAGE, WORD> {
    const READ_SIZE: usize = 1;
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        let at = offset as usize;
        bytes.copy_from_slice(self.bytes.get(at..at + bytes.len()).ok_or(Fault::Misuse)?);
        Ok(())
    }
    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const PAGE: usize, const WORD: usize> NorFlash for Flash<PAGE, WORD> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        if !from.is_multiple_of(PAGE as u32) || !to.is_multiple_of(PAGE as u32) {
            return Err(Fault::Misuse);
        }
        for page in from as usize / PAGE..to as usize / PAGE {
            self.erases[page] += 1;
            for part in 0..64 {
                if let Err(fault) = self.step() {
                    // Some bits of all cells have risen, the more the longer it took.
                    for at in page * PAGE..(page + 1) * PAGE {
                        let risen = if self.draw() % 64 < part {
                            0xff
                        } else {
                            self.draw()
                        };
                        self.bytes[at] |= risen;
                    }
                    return Err(fault);
                }
            }
            self.bytes[page * PAGE..(page + 1) * PAGE].fill(0xff);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        let start = offset as usize;
        if !start.is_multiple_of(WORD) || !bytes.len().is_multiple_of(WORD) {
            return Err(Fault::Misuse);
        }
        for (word, new) in bytes.chunks(WORD).enumerate() {
            let at = start + word * WORD;
            let old = self.bytes.get(at..at + WORD).ok_or(Fault::Misuse)?;
            // The H743 has a checksum over each word that would no longer be right, but zeros read as zeros either way.
            if old.iter().any(|byte| *byte != 0xff) && new.iter().any(|byte| *byte != 0) {
                return Err(Fault::Misuse);
            }
            for (i, byte) in new.iter().enumerate() {
                if let Err(fault) = self.step() {
                    // Of this byte some bits have fallen; of those after it none.
                    self.bytes[at + i] = byte | self.draw();
                    return Err(fault);
                }
                self.bytes[at + i] = *byte;
            }
        }
        Ok(())
    }
}

type F4 = Flash<16_384, 4>;
type H7 = Flash<131_072, 32>;
/// Small pages, so that thousands of cuts through a change of pages are soon made.
type Small = Flash<2_048, 4>;

fn open<const PAGE: usize, const WORD: usize>(
    flash: Flash<PAGE, WORD>,
) -> (Storage<Flash<PAGE, WORD>>, bool) {
    block_on(Storage::open(flash))
}

/// A preset of `count` parameters, told apart by `number`.
fn preset(number: u32, count: usize) -> Preset {
    Preset {
        name: Name::try_from(format!("number {number}").as_str()).expect("short"),
        scene: Name::try_from("light-rain").expect("short"),
        values: (TABLE.iter().take(count))
            .map(|param| {
                (
                    param.id,
                    param.between(param.min, param.max, (number % 97) as f32 / 96.0),
                )
            })
            .map(|(id, value)| {
                (
                    id,
                    value
                        .floor()
                        .max(TABLE[freshet::param::index_of_id(id).expect("known")].min),
                )
            })
            .collect(),
    }
}

fn keep<const PAGE: usize, const WORD: usize>(
    storage: &mut Storage<Flash<PAGE, WORD>>,
    slot: Slot,
    preset: &Preset,
) -> Result<(), StorageError> {
    let record = Record::preset(slot, preset).expect("it has a form");
    block_on(storage.keep(&record))
}

/// The power goes at every step of `save`; then the old or the new is in `slot`, and all else is as it was. Returns how
/// many cuts, and how many of them left the new value.
fn cut_everywhere<const PAGE: usize, const WORD: usize>(
    flash: &Flash<PAGE, WORD>,
    slot: Slot,
    new: &Preset,
) -> (u64, u64) {
    let all = |storage: &mut Storage<Flash<PAGE, WORD>>| -> Vec<Option<Preset>> {
        (0..=SLOTS)
            .map(|slot| block_on(storage.preset(slot)))
            .collect()
    };
    let (mut storage, sound) = open(flash.clone());
    assert!(sound);
    let before = all(&mut storage);
    let boot = block_on(storage.boot());
    let begun = storage.flash().steps;
    keep(&mut storage, slot, new).expect("it is kept");
    let steps = storage.flash().steps - begun;
    let mut after = before.clone();
    after[usize::from(slot)] = Some(new.clone());
    assert_eq!(all(&mut storage), after);
    let mut renewed = 0;
    for cut in 0..steps {
        let (mut storage, _) = open(flash.clone());
        storage.flash().power = Some(cut);
        storage.flash().noise = cut + 1;
        assert_eq!(keep(&mut storage, slot, new), Err(StorageError::Flash));
        let dark = storage.flash().clone();
        let (mut storage, sound) = open(dark.on());
        assert!(sound, "cut at {cut} of {steps}");
        let found = all(&mut storage);
        assert!(found == before || found == after, "cut at {cut} of {steps}");
        renewed += u64::from(found == after);
        assert_eq!(block_on(storage.boot()), boot);
        // And it goes on from there.
        keep(&mut storage, slot, new).expect("it is kept after all");
        assert_eq!(all(&mut storage), after, "cut at {cut} of {steps}");
    }
    (steps, renewed)
}

/// Some presets and a boot choice in it.
fn filled<const PAGE: usize, const WORD: usize>(presets: &[(Slot, Preset)]) -> Flash<PAGE, WORD> {
    let (mut storage, _) = open(Flash::new());
    for (slot, preset) in presets {
        keep(&mut storage, *slot, preset).expect("it is kept");
    }
    let boot = Record::boot(&BootRecord::Preset(1)).expect("it has a form");
    block_on(storage.keep(&boot)).expect("it is kept");
    storage.flash().clone()
}

#[test]
fn a_cut_at_any_byte_of_a_save_leaves_the_old_or_the_new() {
    let old: Vec<_> = (0..=4)
        .map(|slot| (slot, preset(u32::from(slot), 30)))
        .collect();
    for cuts in [
        cut_everywhere::<16_384, 4>(&filled(&old), 2, &preset(50, COUNT)),
        cut_everywhere::<131_072, 32>(&filled(&old), 2, &preset(50, COUNT)),
        cut_everywhere::<16_384, 4>(&filled(&old), 9, &preset(51, 40)),
        cut_everywhere::<16_384, 4>(&F4::new(), 1, &preset(52, 40)),
    ] {
        println!("{} cuts, {} of them left the new value", cuts.0, cuts.1);
    }
}

#[test]
fn so_does_a_cut_while_pages_change() {
    let old: Vec<_> = (0..=4)
        .map(|slot| (slot, preset(u32::from(slot), 30)))
        .collect();
    let mut total = 0;
    for round in 0..6 {
        // Saved again and again, until the next save needs another page.
        let (mut storage, _) = open::<2_048, 4>(filled(&old));
        let mut number = 100 * round;
        let new = loop {
            let new = preset(number, 20 + 3 * round as usize);
            let record = Record::preset(3, &new).expect("it has a form");
            if block_on(storage.erases(&record)) {
                break new;
            }
            block_on(storage.keep(&record)).expect("it is kept");
            number += 1;
        };
        let flash: Small = storage.flash().clone();
        let (mut storage, _) = open(flash.clone());
        keep(&mut storage, 3, &new).expect("it is kept");
        assert!(storage.flash().erases.iter().sum::<u32>() > flash.erases.iter().sum());
        let (cuts, renewed) = cut_everywhere(&flash, 3, &new);
        println!("{cuts} cuts, {renewed} of them left the new value");
        total += cuts;
    }
    assert!(total > 2_000, "{total} cuts");
}

#[test]
fn power_that_goes_again_while_it_is_mended_does_no_harm() {
    let old: Vec<_> = (0..=4)
        .map(|slot| (slot, preset(u32::from(slot), 30)))
        .collect();
    let (mut storage, _) = open::<2_048, 4>(filled(&old));
    let mut number = 0;
    while {
        let record = Record::preset(3, &preset(number, 30)).expect("it has a form");
        !block_on(storage.erases(&record))
    } {
        keep(&mut storage, 3, &preset(number, 30)).expect("it is kept");
        number += 1;
    }
    let flash: Small = storage.flash().clone();
    let mut twice = 0;
    for cut in (0..2_000).step_by(37) {
        let (mut storage, _) = open(flash.clone());
        storage.flash().power = Some(cut);
        if keep(&mut storage, 3, &preset(number, 30)).is_ok() {
            break;
        }
        let dark = storage.flash().clone();
        for again in (0..600).step_by(13) {
            let mut once_more = dark.clone();
            once_more.power = Some(again);
            let (mut storage, _) = open(once_more);
            let dark = storage.flash().clone();
            let (mut storage, sound) = open(dark.on());
            assert!(sound, "cut at {cut} and {again}");
            for (slot, preset) in old.iter().filter(|(slot, _)| *slot != 3) {
                assert_eq!(
                    block_on(storage.preset(*slot)).as_ref(),
                    Some(preset),
                    "cut at {cut} and {again}"
                );
            }
            twice += 1;
        }
    }
    println!("{twice} double cuts");
}

#[test]
fn there_is_room_for_all_slots_at_their_longest_and_wear_is_even() {
    fn fill<const PAGE: usize, const WORD: usize>() {
        let (mut storage, _) = open(Flash::<PAGE, WORD>::new());
        let longest = |number: u32| Preset {
            name: Name::try_from("n".repeat(32).as_str()).expect("it fits"),
            scene: Name::try_from("s".repeat(32).as_str()).expect("it fits"),
            ..preset(number, COUNT)
        };
        for round in 0..40 {
            for slot in 0..=SLOTS {
                let new = longest(round * 20 + u32::from(slot));
                keep(&mut storage, slot, &new).expect("there is room");
            }
            let boot = Record::boot(&BootRecord::Scene(
                Name::try_from("s".repeat(32).as_str()).expect("it fits"),
            ));
            block_on(storage.keep(&boot.expect("it has a form"))).expect("there is room");
        }
        for slot in 0..=SLOTS {
            let kept = block_on(storage.preset(slot));
            assert_eq!(kept, Some(longest(39 * 20 + u32::from(slot))));
        }
        let [a, b] = storage.flash().erases;
        assert!(a.abs_diff(b) <= 1, "{a} and {b} erases");
        println!("{} saves of the longest, {a} and {b} erases", 40 * 18);
    }
    fill::<16_384, 4>();
    fill::<131_072, 32>();
}

#[test]
fn a_flash_too_full_says_so_and_loses_nothing() {
    let (mut storage, _) = open(Small::new());
    let mut kept = 0;
    let refusal = (0..=SLOTS).find_map(|slot| {
        let result = keep(&mut storage, slot, &preset(u32::from(slot), 60));
        kept += u8::from(result.is_ok());
        result.err()
    });
    assert_eq!(refusal, Some(StorageError::Full));
    let flash = storage.flash().clone();
    let (mut storage, sound) = open(flash);
    assert!(sound);
    for slot in 0..kept {
        assert_eq!(
            block_on(storage.preset(slot)),
            Some(preset(u32::from(slot), 60))
        );
    }
    // An empty slot makes room.
    for slot in 0..2 {
        block_on(storage.keep(&Record::empty(slot).expect("it has a form"))).expect("it is kept");
        assert_eq!(block_on(storage.preset(slot)), None);
    }
    keep(&mut storage, 9, &preset(9, 60)).expect("there is room now");
}

#[test]
fn what_another_table_wrote_is_read_as_far_as_it_is_known() {
    let write = |bytes: &[u8]| {
        let (mut storage, _) = open(F4::new());
        let record = Record::raw(3, bytes).expect("there is room");
        block_on(storage.keep(&record)).expect("it is kept");
        let (mut storage, _) = open(storage.flash().clone());
        block_on(storage.preset(3))
    };
    let [level, intensity] =
        [freshet::param::LEVEL, freshet::param::INTENSITY].map(|i| TABLE[i].id);
    // A table that has parameters which this one has not, and a range that was wider.
    let pairs = [(60_000u16, 1.5f32), (level, -6.0), (intensity, 1e9)];
    let newer = (1u8, "name", "surf", pairs.as_slice());
    let read = write(&postcard::to_allocvec(&newer).expect("a value")).expect("it is read");
    assert_eq!(read.name, "name");
    assert_eq!(read.scene, "surf");
    assert_eq!(read.values, [(level, -6.0)]);
    assert_eq!(
        read.value(freshet::param::INTENSITY),
        TABLE[freshet::param::INTENSITY].default
    );
    // Nothing but one that this table has.
    let many: Vec<(u16, f32)> = (0..COUNT as u16 - 1)
        .map(|i| (40_000 + i, 0.0))
        .chain([(level, -3.0)])
        .collect();
    let read = write(&postcard::to_allocvec(&(1u8, "", "surf", many.as_slice())).expect("a value"));
    assert_eq!(read.expect("it is read").values, [(level, -3.0)]);
    // A form that is not known, and ends before it should.
    assert_eq!(
        write(&postcard::to_allocvec(&(2u8, "name", "surf")).expect("a value")),
        None
    );
    assert_eq!(write(&[1, 200]), None);
    assert_eq!(write(&[]), None);
}

#[test]
fn a_flash_full_of_anything_else_is_begun_anew() {
    for noise in 1..40 {
        let mut flash = F4::new();
        flash.noise = noise;
        for at in 0..flash.bytes.len() {
            flash.bytes[at] = flash.draw();
        }
        let (mut storage, _) = open(flash);
        assert_eq!(block_on(storage.boot()), BootRecord::Default);
        keep(&mut storage, 1, &preset(1, 40)).expect("it is kept");
        assert_eq!(block_on(storage.preset(1)), Some(preset(1, 40)));
    }
    let (mut storage, sound) = open(H7::new());
    assert!(sound);
    keep(&mut storage, 1, &preset(1, 40)).expect("it is kept");
}
