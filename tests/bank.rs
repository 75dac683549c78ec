//! A bank gives back what was put in, and refuses everything else with a reason.

use freshet::bank::{Bank, BankError, Boot, MAGIC};
use freshet_host::bank::{built_in, write};
use freshet_host::built_in::{self, SCENES};
use proptest::prelude::*;

fn bank() -> Vec<u8> {
    built_in("brook", Some(7)).expect("the built-in scenes make a bank")
}

#[test]
fn every_scene_comes_back_as_it_was() {
    let bytes = bank();
    let bank = Bank::open(&bytes).expect("a bank");
    assert_eq!(usize::from(bank.scenes()), SCENES.len());
    assert_eq!(bank.boot().seed, Some(7));
    for (i, (name, _)) in SCENES.iter().enumerate() {
        let file = built_in::scene(name)
            .expect("it is built in")
            .expect("valid");
        assert_eq!(bank.scene(i as u16), Some((*name, file.scene)));
    }
    assert_eq!(
        bank.scene(bank.boot().scene).map(|scene| scene.0),
        Some("brook")
    );
    assert_eq!(bank.scene(bank.scenes()), None);
    println!("{} scenes in {} bytes", SCENES.len(), bytes.len());
}

#[test]
fn a_bank_with_any_byte_changed_is_refused() {
    let good = bank();
    for at in 0..good.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[at] ^= change;
            let error = Bank::open(&bytes).err();
            let expected = match at {
                0..4 => matches!(error, Some(BankError::NoBank)),
                4..6 => matches!(error, Some(BankError::Version(_))),
                8..12 => matches!(error, Some(BankError::Length(_) | BankError::Checksum)),
                _ => error == Some(BankError::Checksum),
            };
            assert!(expected, "byte {at} ^ {change:#x}: {error:?}");
        }
    }
}

#[test]
fn a_bank_cut_short_is_refused_and_one_with_more_behind_it_is_not() {
    let mut bytes = bank();
    for length in 0..bytes.len() {
        assert!(Bank::open(&bytes[..length]).is_err(), "{length} bytes");
    }
    bytes.resize(bytes.len() + 4096, 0xff);
    assert!(Bank::open(&bytes).is_ok());
    assert_eq!(Bank::open(&[0xff; 64]).err(), Some(BankError::NoBank));
}

#[test]
fn a_boot_record_must_name_a_scene_that_is_there() {
    let scene = built_in::scene("tap")
        .expect("built in")
        .expect("valid")
        .scene;
    let boot = |scene| Boot { scene, seed: None };
    assert!(write(&[("tap", scene.clone())], boot(0)).is_ok());
    assert!(write(&[("tap", scene.clone())], boot(1)).is_err());
    assert!(write(&[("", scene)], boot(0)).is_err());
    assert!(write(&[], boot(0)).is_err());
}

proptest! {
    #[test]
    fn no_bytes_at_all_make_the_reader_panic(body in proptest::collection::vec(any::<u8>(), 0..600)) {
        // As they are, and under a header that is right, so that the parts behind it are reached.
        let _ = Bank::open(&body);
        let mut bytes = Vec::from(MAGIC);
        bytes.extend([1, 0, 2, 0]);
        bytes.extend((body.len() as u32 + 16).to_le_bytes());
        bytes.extend(freshet::bank::checksum(&bytes, &body).to_le_bytes());
        bytes.extend(&body);
        let _ = Bank::open(&bytes);
    }

    #[test]
    fn no_section_makes_the_reader_panic(kind in 1u32..3, body in proptest::collection::vec(any::<u8>(), 0..300)) {
        let mut rows = Vec::new();
        for word in [kind, 28, body.len() as u32] {
            rows.extend(word.to_le_bytes());
        }
        let body = [rows, body].concat();
        let mut bytes = Vec::from(MAGIC);
        bytes.extend([1, 0, 1, 0]);
        bytes.extend((body.len() as u32 + 16).to_le_bytes());
        bytes.extend(freshet::bank::checksum(&bytes, &body).to_le_bytes());
        bytes.extend(&body);
        if let Ok(bank) = Bank::open(&bytes) {
            prop_assert!(bank.scenes() > 0);
        }
    }
}
