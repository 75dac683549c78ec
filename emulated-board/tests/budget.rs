//! Instructions a sample of the whole audio path on the F407, its interrupts included, and what there is of memory.
//!
//! Limits are what was measured (docs/figures.md) and 5 %, with the toolchain that rust-toolchain.toml names; another
//! compiler may differ by more. A limit is lowered when the code gets faster, never raised without a reason.

mod common;

use std::time::Duration;

use common::{RATE, START, board, chip, scene, unhurried};
use freshet::mix::Output;
use freshet::scene::Scene;
use freshet_host::board::Board as Desk;
use freshet_host::built_in::SCENES;
use freshet_host::scene_file::SceneFile;

/// Frames in a block.
const BLOCK: f64 = freshet::BLOCK as f64;
/// What is played in time on a slow day, instructions a sample: at 168 MHz there are 3 500 cycles for one, at 96 MHz
/// 2 000, and an instruction takes 2 of them at most.
const IN_TIME: [(Desk, f64); 2] = [(Desk::F407, 1_750.0), (Desk::F411, 1_200.0)];

/// Most instructions of a tick of control.
const TICK: u64 = 70_000;

/// Whether a tick of control comes in time beside the audio path, `mean` instructions a sample, at 1.5 cycles an instruction.
fn is_in_time(board: Desk, mean: f64, tick: u64) -> bool {
    let cycles = if board == Desk::F411 {
        2_000.0
    } else {
        3_500.0
    };
    1.5 * (mean + tick as f64 / freshet::TICK as f64) <= cycles
}

/// `population(rate)`: 50 classes from 0.2 to 50 mm, evenly, none rising.
fn population(rate: u32) -> Scene {
    let text = format!(
        "[water]\nrate = {rate}\nradius_min = 0.2\nradius_max = 50\nlaw = \"flat\"\nrise_factor = 0\npressure = 0.0003"
    );
    SceneFile::parse("population", &text).expect("valid").scene
}

/// Mean and busiest block, instructions a sample, over a second; and the longest tick of control.
fn cost(board: Desk, scene: &Scene) -> (f64, f64, u64) {
    let mut board = chip(board, &[("scene", scene.clone())], 1, unhurried());
    board.run(START).expect("it runs");
    let play = board
        .count("freshet_firmware::audio::Player::play")
        .expect("it is there");
    let tick = board
        .count("freshet_firmware::control::tick")
        .expect("it is there");
    board.interrupt_counts().expect("counted");
    let before = board.frames();
    board.run(Duration::from_secs(1)).expect("it runs");
    let frames = (board.frames() - before) as f64;
    let interrupts = board.interrupt_counts().expect("counted");
    let play = board.counts(play).expect("counted");
    let tick = board.counts(tick).expect("counted").max();
    let all: u64 = interrupts
        .handlers
        .values()
        .map(|handler| handler.instructions)
        .sum();
    // Around the block: the DMA's interrupt, the executor, the meter.
    let around = all as f64 / frames - play.mean() / BLOCK;
    (
        play.mean() / BLOCK + around,
        play.max() as f64 / BLOCK + around,
        tick,
    )
}

#[test]
fn the_audio_path_stays_within_its_budget() {
    let rows = [
        ("silence", population(0), 33.0),
        ("50 classes, 50 000 births/s", population(50_000), 861.0),
        ("50 classes, 100 000 births/s", population(100_000), 1_031.0),
    ];
    for (name, scene, most) in rows {
        let (mean, busiest, tick) = cost(Desk::F407, &scene);
        println!("{name:30} {mean:6.0} mean {busiest:6.0} busiest block; tick {tick}");
        assert!(
            mean <= most,
            "{name}: {mean:.0} instructions a sample, the budget is {most}"
        );
        assert!(tick <= TICK, "{name}: a tick of {tick} instructions");
    }
}

/// A cloud alone, with all births that it may have.
fn cloud(bubbles: u32) -> Scene {
    let text = format!(
        "[water]\nrate = 0\n[cloud]\nbubbles = {bubbles}\nrate = 100\nradius_min = 0.7\nradius_max = 6"
    );
    SceneFile::parse("cloud", &text).expect("valid").scene
}

#[test]
fn bubbles_that_hear_each_other_stay_within_their_budget() {
    for (board, bubbles, most) in [
        (Desk::F411, 64, 676.0),
        (Desk::F407, 64, 676.0),
        (Desk::F407, 128, 1_212.0),
    ] {
        let name = format!("{}, {bubbles} bubbles", board.name());
        let (mean, busiest, tick) = cost(board, &cloud(bubbles));
        println!("{name} {mean:6.0} mean {busiest:6.0} busiest block; tick {tick}");
        assert!(mean <= most, "{name}: {mean:.0} instructions a sample");
        let (_, deadline) = IN_TIME
            .into_iter()
            .find(|(of, _)| *of == board)
            .expect("both are there");
        assert!(
            busiest <= deadline,
            "{name}: {busiest:.0} in the busiest block"
        );
        assert!(tick <= TICK, "{name}: a tick of {tick} instructions");
        assert!(is_in_time(board, mean, tick), "{name}: control is late");
    }
}

/// Classes of [`population`].
const CLASSES: f64 = 50.0;

#[test]
fn a_resonator_and_a_birth_cost_what_they_may() {
    // All classes ring at each of these rates; what differs is births, and in how many classes a block has any.
    let rates = [50_000, 100_000, 200_000];
    let walks = rates.map(|rate| {
        let mut board = board(&[("scene", population(rate))], 1, unhurried());
        board.run(START).expect("it runs");
        let walk = board.count("freshet_walk").expect("it is there");
        board.run(Duration::from_secs(1)).expect("it runs");
        board.counts(walk).expect("counted").mean()
    });
    let births = rates.map(|rate| f64::from(rate) * BLOCK / 48_000.0);
    let struck = births.map(|births| CLASSES * (1.0 - (-births / CLASSES).exp()));
    // walk = resonators + births · a_birth + struck · a_class, three times.
    let [low, high] = [0, 1].map(|i| {
        let step = |of: &[f64; 3]| of[i + 1] - of[i];
        [step(&walks), step(&births), step(&struck)]
    });
    let cross = |a: usize, b: usize| low[a] * high[b] - low[b] * high[a];
    let a_birth = cross(0, 2) / cross(1, 2);
    let a_class = cross(1, 0) / cross(1, 2);
    let resonators = walks[0] - births[0] * a_birth - struck[0] * a_class;
    // Both ears, a sample each.
    let a_resonator = resonators / (2.0 * BLOCK * CLASSES);
    println!(
        "{a_resonator:.2} a resonator and sample, {a_birth:.0} a birth, {a_class:.0} a class that has some"
    );
    assert!(a_resonator <= 5.3, "{a_resonator:.2}");
    assert!(a_birth <= 78.0, "{a_birth:.0} a birth");
    assert!(a_class <= 154.0, "{a_class:.0} a class");
}

/// `rate` bubbles a second from 60 to 100 mm, all of them rising slowly, which ring for 10 s.
fn voices(rate: u32) -> Scene {
    let text = format!(
        "[water]\nrate = {rate}\nradius_min = 60\nradius_max = 100\nrise_cutoff = 0\nrise_factor = 0.02\npressure = 0.01"
    );
    SceneFile::parse("voices", &text).expect("valid").scene
}

/// Instructions a voice and sample of everything that all voices are in a block, from `from` on and for `time`; and those
/// of a start.
fn voice_cost(scene: &Scene, from: Duration, time: Duration) -> (f64, f64) {
    let mut board = board(&[("scene", scene.clone())], 1, unhurried());
    let [play, render, start] = ["Player::play", "Voices<..>::render", "Births<..>::voice"]
        .map(|name| board.count(name).expect("it is there"));
    board.run(from).expect("it runs");
    let before = board.counts(play).expect("counted").calls.len();
    let _ = board.counts(render).expect("counted");
    board.run(time).expect("it runs");
    let blocks = board.counts(play).expect("counted").calls.len();
    let render = board.counts(render).expect("counted").total();
    let start = board.counts(start).expect("counted").mean();
    // The desk knows how many there are.
    let mut player = Desk::F407.player(scene, RATE, 1, Output::Bits24);
    let mut block = [freshet::Frame::ZERO; freshet::BLOCK];
    let mut voices = 0;
    for i in 0..before + blocks {
        player.render(&mut block);
        if i >= before {
            voices += player.voices();
        }
    }
    assert_eq!(player.stats().stolen, 0);
    println!("{} voices", voices / blocks);
    (render as f64 / voices as f64 / BLOCK, start)
}

#[test]
fn a_rising_voice_costs_what_it_may() {
    let (plain, start) = voice_cost(
        &voices(5),
        Duration::from_secs(8),
        Duration::from_millis(500),
    );
    println!("{plain:.2} a voice and sample, {start:.0} a start");
    // All have begun within the last 90 ms, and the attack of the shortest takes 120.
    let from = Duration::from_millis(310);
    let (attack, _) = voice_cost(&voices(300), from, Duration::from_millis(90));
    println!("{attack:.2} a voice and sample under the soft attack");
    assert!(plain <= 12.9, "{plain:.2}");
    assert!(attack <= 19.8, "{attack:.2}");
    assert!(start <= 186.0, "{start:.0}");
}

#[test]
fn every_scene_is_played_in_time() {
    for (board, most) in IN_TIME {
        let mut beyond = Vec::new();
        for (name, _) in SCENES {
            let (mean, busiest, tick) = cost(board, &scene(name));
            let row = format!(
                "{} {name:12} {mean:6.0} mean {busiest:6.0} busiest block; tick {tick}",
                board.name()
            );
            println!("{row}");
            if busiest > most || tick > TICK || !is_in_time(board, mean, tick) {
                beyond.push(row);
            }
        }
        assert!(beyond.is_empty(), "more than they may: {beyond:#?}");
    }
}

#[test]
fn the_stack_has_room_and_stands_where_it_cannot_run_into_anything() {
    stack(Desk::F407, 0x2000_0000, 0x2000_8000);
    stack(Desk::H743, 0x2400_0000, 0x2401_0000);
}

/// A board's stack, which grows down from `start` to `end`, below which there is nothing.
fn stack(what: Desk, end: u32, start: u32) {
    let scenes = [("surf", scene("surf")), ("river", scene("river"))];
    let mut board = chip(what, &scenes, 1, unhurried());
    board.run(START + Duration::from_secs(1)).expect("it runs");
    // Another scene is read while the first one plays.
    board.button(true).expect("it is pressed");
    board.run(Duration::from_secs(1)).expect("it runs");
    // The first word of the vectors.
    let first = board.read(0x0800_0000, 4).expect("it is flash");
    assert_eq!(first, start.to_le_bytes());
    let stack = board
        .read(end, (start - end) as usize)
        .expect("it is memory");
    let painted = 0xc0de_ca5e_u32.to_le_bytes();
    let free = 4 * stack.chunks(4).take_while(|word| *word == painted).count();
    let used = stack.len() - free;
    println!(
        "{}: {used} of {} bytes used at most",
        what.name(),
        stack.len()
    );
    assert!(free >= 8_192, "{free} bytes of stack left");
}
