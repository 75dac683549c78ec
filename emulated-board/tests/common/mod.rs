//! A board with the real firmware, and the desk to compare it with.
#![allow(dead_code, reason = "each test takes what it needs")]

pub mod talk;

use std::path::PathBuf;
use std::time::Duration;

use emulated_board::{Board, Chip, Elf, Setup};
use freshet::bank::Boot;
use freshet::mix::Output;
use freshet::scene::Scene;
use freshet_host::board::Board as Desk;
use freshet_host::{bank, built_in};

/// The rate that scenes are tuned for, Hz.
pub const RATE: u32 = 48_000;
/// Power-on to sound takes less than this, and a seed is chosen for it.
pub const START: Duration = Duration::from_millis(600);

/// A board whose core never wants for time: what it plays is compared, not when. What takes how long is `budget.rs`'s.
pub fn unhurried() -> Setup {
    Setup {
        cycles_per_instruction: 0.5,
        ..Setup::default()
    }
}

/// The firmware as it is flashed: what `cargo build-<board>` leaves.
pub fn elf(name: &str) -> Elf {
    let top = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let path = top.join(format!(
        "target/thumbv7em-none-eabihf/firmware/freshet-{name}"
    ));
    match Elf::load(&path) {
        Ok(elf) => elf,
        Err(error) => panic!("{error}; `cargo build-{name}` at the top of the tree makes it"),
    }
}

/// A built-in scene.
pub fn scene(name: &str) -> Scene {
    let file = built_in::scene(name).expect("a built-in scene");
    file.expect("it is valid").scene
}

/// An F407 that has `scenes` in its flash and starts with the first of them.
pub fn board(scenes: &[(&str, Scene)], seed: u64, setup: Setup) -> Board {
    chip(Desk::F407, scenes, seed, setup)
}

/// The same of any board.
pub fn chip(board: Desk, scenes: &[(&str, Scene)], seed: u64, setup: Setup) -> Board {
    let chip = match board {
        Desk::F411 => Chip::F411,
        Desk::H743 => Chip::H743,
        _ => Chip::F407,
    };
    let elf = elf(board.name());
    let mut board = Board::new(chip, &elf, setup).expect("a board");
    let boot = Boot {
        scene: 0,
        seed: Some(seed),
    };
    let bytes = bank::write(scenes, boot).expect("a bank");
    let region = elf.section(".bank").expect("it is linked").address;
    board.write(region, &bytes).expect("flash takes it");
    board
}

/// What the desk renders with the capacities of `board`.
pub fn desk(board: Desk, scene: &Scene, seed: u64, frames: usize) -> Vec<[i32; 2]> {
    let mut player = board.player(scene, RATE, seed, Output::Bits24);
    let mut out = vec![freshet::Frame::ZERO; frames];
    player.render(&mut out);
    out.iter().map(|frame| [frame.left, frame.right]).collect()
}

/// Without the silence before the first sample that is not zero.
pub fn from_first_sound(frames: &[[i32; 2]]) -> &[[i32; 2]] {
    let first = frames.iter().position(|frame| *frame != [0; 2]);
    &frames[first.unwrap_or(frames.len())..]
}
