//! What comes out of the board's I2S is what the desk renders, sample for sample, at 48 000 Hz.

mod common;

use std::time::Duration;

use common::{RATE, START, chip, desk, from_first_sound, scene, unhurried};
use emulated_board::Setup;
use freshet_host::board::Board as Desk;
use freshet_host::built_in::SCENES;

/// Scenes that are played with three seeds; the others with one.
const THRICE: [&str; 4] = ["cave-drip", "light-rain", "surf", "waterfall"];

/// Compares so many seconds of sound.
fn compare(board: Desk, name: &str, seed: u64, seconds: u64) {
    let frames = RATE as usize * seconds as usize;
    let scene = scene(name);
    let what = board;
    let mut board = chip(what, &[(name, scene.clone())], seed, unhurried());
    board
        .run(START + Duration::from_secs(seconds))
        .expect("it runs");
    let rate = board.sample_rate().expect("the clocks run");
    assert!(
        (rate / f64::from(RATE) - 1.0).abs() < 20e-6,
        "{name}: {rate} Hz"
    );
    assert_eq!(board.i2s_underruns(), 0, "{name}");
    assert_eq!(
        board.resets().expect("listed").len(),
        1,
        "{name}: power-on alone"
    );
    let start = board.first_sound().expect("it sounds");
    let played = board.take_audio();
    let expected = desk(what, &scene, seed, frames);
    let (played, expected) = (from_first_sound(&played), from_first_sound(&expected));
    assert!(expected.len() > frames / 2, "{name} begins late");
    assert!(
        played.len() >= expected.len(),
        "{name}: sound from {start:?} on"
    );
    let first = expected.iter().zip(played).position(|(a, b)| a != b);
    assert_eq!(first, None, "{name}, seed {seed}: board and desk part here");
    let load = (0..expected.len())
        .filter(|i| expected[*i] != [0; 2])
        .count();
    println!(
        "{name:12} seed {seed}: {} frames alike, {load} of them not zero",
        expected.len()
    );
}

#[test]
fn the_board_plays_every_scene_as_the_desk_does() {
    for (name, _) in SCENES {
        compare(Desk::F407, name, 1, 2);
    }
}

#[test]
fn and_so_it_does_with_other_seeds() {
    for name in THRICE {
        compare(Desk::F407, name, 2, 2);
        compare(Desk::F407, name, u64::MAX, 2);
    }
}

#[test]
fn the_f411_plays_as_the_desk_does_with_its_capacities() {
    for name in ["light-rain", "river", "pour"] {
        compare(Desk::F411, name, 1, 1);
    }
}

#[test]
fn the_h743_plays_as_the_desk_does_with_its_capacities() {
    for name in ["cave-drip", "surf", "waterfall", "breaking-wave"] {
        compare(Desk::H743, name, 1, 2);
    }
}

#[test]
fn a_board_whose_bank_names_no_seed_takes_its_own_number() {
    use emulated_board::{Board, Chip};
    let listen = |unique_id: [u8; 12]| {
        let setup = Setup {
            unique_id,
            ..Setup::default()
        };
        let mut board = Board::new(Chip::F407, &common::elf("f407"), setup).expect("a board");
        board.run(START).expect("it runs");
        from_first_sound(&board.take_audio()).to_vec()
    };
    let [one, again, other] = [*b"freshet no 1", *b"freshet no 1", *b"freshet no 2"].map(listen);
    assert!(one.len() > 4_800);
    assert_eq!(one, again);
    assert_ne!(one, other);
}
