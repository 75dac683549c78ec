//! The power goes at any time while the firmware saves, and nothing is lost but what was being saved.

mod common;

use std::convert::Infallible;
use std::time::Duration;

use common::talk::{MS, SECOND, Talk};
use common::{RATE, scene, unhurried};
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use freshet::control::Control;
use freshet::profile::{F407, Profile};
use freshet::protocol::{BootRecord, Name, Preset, SLOTS, Slot};
use freshet::storage::{Record, Storage};

/// Sectors 1 and 2 of the F407.
const START: u32 = 0x0800_4000;
const PAGE: usize = 16 << 10;
/// `FLASH_CR`, and its bit that says that nothing is being written.
const CONTROL: u32 = 0x4002_3c10;
const LOCK: u32 = 1 << 31;

/// The two sectors, on the desk.
struct Sectors(Vec<u8>);

impl ErrorType for Sectors {
    type Error = Infallible;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
        Ok(())
    }
    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.0[from as usize..to as usize].fill(0xff);
        Ok(())
    }
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        for (cell, byte) in self.0[offset as usize..].iter_mut().zip(bytes) {
            *cell &= byte;
        }
        Ok(())
    }
}

/// The scene `tap` as it is, as the firmware stores it.
fn preset(name: &str) -> Preset {
    let control = Control::new(&scene("tap"), RATE, F407::LIMITS, 1);
    let plain = |text| Name::try_from(text).expect("short");
    Preset::new(plain(name), plain("tap"), &control)
}

/// Presets in slots 1, 2 and 16, and a boot choice; where it is `full`, the next save erases a page.
fn image(full: bool) -> Vec<u8> {
    let (mut storage, _) = block_on(Storage::open(Sectors(vec![0xff; 2 * PAGE])));
    let mut keep = |record: Option<Record>| {
        let record = record.expect("it has a form");
        block_on(storage.keep(&record)).expect("there is room");
        block_on(storage.erases(&record))
    };
    keep(Record::preset(2, &preset("two")));
    keep(Record::preset(16, &preset("sixteen")));
    keep(Record::boot(&BootRecord::Preset(2)));
    while !keep(Record::preset(1, &preset("old"))) && full {}
    storage.flash().0.clone()
}

/// All that is kept, as the desk reads it.
fn all(image: Vec<u8>) -> (Vec<Option<Preset>>, BootRecord) {
    let (mut storage, sound) = block_on(Storage::open(Sectors(image)));
    assert!(sound);
    let slots = 0..=SLOTS;
    let presets = slots.map(|slot: Slot| block_on(storage.preset(slot)));
    let presets = presets.collect();
    (presets, block_on(storage.boot()))
}

/// Cuts the power so long after the firmware has begun to write, for each of `delays`; returns after how many of them the
/// new value was there.
fn cut(full: bool, delays: impl Iterator<Item = Duration>) -> (usize, usize) {
    let mut talk = Talk::new(&[("tap", scene("tap"))], 1, unhurried());
    let image = image(full);
    let before = all(image.clone());
    let mut after = before.clone();
    after.0[1] = Some(preset("new"));
    let (mut cuts, mut renewed) = (0, 0);
    for delay in delays {
        talk.board.write(START, &image).expect("it is flash");
        talk.restart();
        talk.send("store 1 new");
        // It fades, and settles, first.
        talk.board.run(390 * MS).expect("it runs");
        while talk.board.read_u32(CONTROL).expect("a register") & LOCK != 0 {
            talk.board.run(MS / 20).expect("it runs");
        }
        talk.board.run(delay).expect("it runs");
        talk.restart();
        let kept = talk.board.read(START, 2 * PAGE).expect("it is flash");
        let kept = all(kept);
        assert!(
            kept == before || kept == after,
            "{delay:?} after it began: {kept:?}"
        );
        renewed += usize::from(kept == after);
        cuts += 1;
        // The firmware sees the same.
        let name = if kept == after { "new" } else { "old" };
        assert_eq!(
            talk.ask("presets")[0],
            format!("preset 1 = {name} (over tap)")
        );
        let status = talk.ask("status");
        assert!(status.contains(&"trouble = no".to_owned()), "{status:?}");
    }
    // And saves on.
    let answer = talk.ask("store 1 new");
    assert!(answer[answer.len() - 1].starts_with("ok store 1 new"));
    let kept = talk.board.read(START, 2 * PAGE).expect("it is flash");
    assert_eq!(all(kept), after);
    (cuts, renewed)
}

#[test]
fn a_cut_in_a_save_leaves_the_old_or_the_new() {
    let (cuts, renewed) = cut(false, (0..30).map(|i| i * MS / 50));
    println!("{cuts} cuts, {renewed} of them left the new value");
    assert!(renewed > 0 && renewed < cuts);
}

#[test]
fn so_does_a_cut_in_a_save_that_changes_pages() {
    let soon = (0..20).map(|i| i * MS / 2);
    let later = (1..16).map(|i| i * 20 * MS);
    let (cuts, renewed) = cut(true, soon.chain(later));
    println!("{cuts} cuts, {renewed} of them left the new value");
    assert!(renewed > 0 && renewed < cuts);
}

#[test]
fn a_save_pauses_for_as_long_as_it_says_and_the_sound_comes_back_as_it_was() {
    for full in [false, true] {
        let mut talk = Talk::new(&[("tap", scene("tap"))], 1, unhurried());
        talk.board.write(START, &image(full)).expect("it is flash");
        talk.restart();
        talk.send("store 1 new");
        let said = talk.wait(SECOND, |line| line.starts_with("pause of about"));
        let promised: u64 = said[0]
            .split(' ')
            .nth(3)
            .and_then(|ms| ms.parse().ok())
            .expect("ms");
        let begun = talk.board.now();
        talk.wait(2 * SECOND, |line| line.starts_with("ok store"));
        let took = talk.board.now() - begun;
        assert!(
            took <= promised as u32 * MS,
            "{took:?}, {promised} ms were promised"
        );
        assert!(
            took >= promised as u32 * MS / 3,
            "{took:?}, {promised} ms were promised"
        );
        talk.board.run(SECOND / 2).expect("it runs");
        assert_eq!(talk.count("underruns"), 0.0);
        assert_eq!(talk.count("restarts"), 0.0);
        assert_eq!(talk.board.i2s_underruns(), 0);
        assert_eq!(talk.board.resets().expect("listed").len(), 2);
        // The same again is no save at all.
        let again = talk.ask("store 1 new");
        assert!(
            again.len() == 1 && again[0].starts_with("ok store 1 new"),
            "{again:?}"
        );
        println!("full {full}: {took:?}, {promised} ms were promised");
    }
}
