//! The share of the chip that `freshet render` prints is what the firmware takes.

mod common;

use std::time::Duration;

use common::{START, board, scene, unhurried};
use freshet::mix::Output;
use freshet::scene::Scene;
use freshet::{BLOCK, Frame};
use freshet_host::board::Board as Desk;
use freshet_host::built_in::SCENES;
use freshet_host::load::{COST, COUNTED, Counts, Meter};
use freshet_host::scene_file::SceneFile;

/// Frames compared.
const FRAMES: usize = 48_000;

/// Instructions a block of the firmware, interrupts included, and what the desk counts in the same blocks.
fn blocks(scene: &Scene) -> Vec<(f64, Counts)> {
    let mut board = board(&[("scene", scene.clone())], 1, unhurried());
    let play = board
        .count("freshet_firmware::audio::Player::play")
        .expect("it is there");
    board.run(START).expect("it runs");
    board.interrupt_counts().expect("counted");
    let before = board.frames();
    let second = Duration::from_secs_f64(FRAMES as f64 / 48_000.0);
    board.run(second).expect("it runs");
    let frames = (board.frames() - before) as f64;
    let interrupts = board.interrupt_counts().expect("counted");
    let calls = board.counts(play).expect("counted").calls;
    let all: u64 = (interrupts.handlers.values())
        .map(|handler| handler.instructions)
        .sum();
    let last = (frames / BLOCK as f64) as usize;
    let played: u64 = calls[calls.len() - last..].iter().sum();
    // Around the block: the DMA's interrupt, the executor, the meter.
    let around = (all as f64 - played as f64) / last as f64;

    let mut player = Desk::F407.player(scene, 48_000, 1, Output::Bits24);
    let mut meter = Meter::new();
    let desk = calls.iter().map(|call| {
        let mut block = [Frame::ZERO; BLOCK];
        player.render_observed(&mut block, &mut meter);
        let counts = meter.block(&*player, &block);
        (*call as f64 + around, counts)
    });
    desk.collect()
}

/// Where the limiter holds down and voices are stolen.
fn too_much() -> Scene {
    let text = "[water]\nclasses = 40\nradius_min = 0.25\nradius_max = 9\nrate = 30000\npressure = 0.3\nalpha = 0.7\nbeta = 4\nrise_cutoff = 0.7\nrise_factor = 0.3";
    SceneFile::parse("too much", text).expect("valid").scene
}

/// As many bubbles that hear each other as there can be.
fn large_cloud() -> Scene {
    let text = "[water]\nrate = 0\n[cloud]\nbubbles = 128\nrate = 100\npushes = 500";
    SceneFile::parse("large cloud", text).expect("valid").scene
}

#[test]
fn the_share_that_a_rendering_prints_is_within_10_percent_of_the_board() {
    let mut scenes: Vec<_> = (SCENES.iter())
        .map(|(name, _)| (*name, blocks(&scene(name))))
        .collect();
    scenes.push(("too much", blocks(&too_much())));
    scenes.push(("large cloud", blocks(&large_cloud())));
    let fitted = fit(scenes.iter().flat_map(|(_, blocks)| blocks));
    println!("pub const COST: [f64; COUNTED.len()] = [");
    for (cost, what) in fitted.iter().zip(COUNTED) {
        println!("    {cost:.0}.0, // {what}");
    }
    println!("];");
    let mut worst = 0.0_f64;
    for (name, blocks) in &scenes {
        let cost = |counts: &Counts| -> f64 { counts.iter().zip(COST).map(|(n, c)| n * c).sum() };
        let model: Vec<f64> = blocks.iter().map(|(_, counts)| cost(counts)).collect();
        let mean = |all: &mut dyn Iterator<Item = f64>| all.sum::<f64>() / blocks.len() as f64;
        let most = |all: &mut dyn Iterator<Item = f64>| all.fold(0.0, f64::max);
        let board = || blocks.iter().map(|(instructions, _)| *instructions);
        let of = |figure: &dyn Fn(&mut dyn Iterator<Item = f64>) -> f64| {
            let (model, board) = (figure(&mut model.iter().copied()), figure(&mut board()));
            (
                model / BLOCK as f64,
                board / BLOCK as f64,
                model / board - 1.0,
            )
        };
        let (mean, busiest) = (of(&mean), of(&most));
        println!(
            "{name:14} mean {:6.0} of {:6.0} ({:+.1} %), busiest {:6.0} of {:6.0} ({:+.1} %)",
            mean.0,
            mean.1,
            100.0 * mean.2,
            busiest.0,
            busiest.1,
            100.0 * busiest.2
        );
        worst = worst.max(mean.2.abs()).max(busiest.2.abs());
    }
    assert!(worst < 0.10, "{:.1} % off", 100.0 * worst);
}

/// Least squares: what each thing counted costs.
fn fit<'a>(blocks: impl Iterator<Item = &'a (f64, Counts)>) -> Counts {
    const N: usize = COUNTED.len();
    let mut normal = [[0.0; N + 1]; N];
    for (instructions, counts) in blocks {
        // In parts of the block's own cost: so soft scenes count as much as loud ones.
        let weight = 1.0 / (instructions * instructions);
        for (row, count) in normal.iter_mut().zip(counts) {
            for (place, other) in row.iter_mut().zip(counts.iter().chain([instructions])) {
                *place += weight * count * other;
            }
        }
    }
    for i in 0..N {
        // Never quite singular, where two things always come together or one never comes.
        normal[i][i] = normal[i][i] * (1.0 + 1e-9) + 1e-12;
        let pivot = normal[i];
        for (j, row) in normal.iter_mut().enumerate() {
            if j != i {
                let factor = row[i] / pivot[i];
                row.iter_mut()
                    .zip(pivot)
                    .for_each(|(x, p)| *x -= factor * p);
            }
        }
    }
    std::array::from_fn(|i| normal[i][N] / normal[i][i])
}
