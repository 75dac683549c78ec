//! Scratch.
#[path = "../tests/common/mod.rs"]
mod common;
use std::time::Duration;
use common::{START, board, unhurried};
use freshet_host::scene_file::SceneFile;

fn same(name: &str) {
    let scene = common::scene(name);
    let mut board = board(&[(name, scene.clone())], 5, unhurried());
    board.run(START + Duration::from_secs(2)).expect("it runs");
    let heard = board.take_audio();
    let heard = common::from_first_sound(&heard);
    let wanted = common::desk(freshet_host::board::Board::F407, &scene, 5, 120_000);
    let wanted = common::from_first_sound(&wanted);
    let n = heard.len().min(wanted.len());
    println!("{name}: {n} frames, equal: {}", heard[..n] == wanted[..n]);
    if heard[..n] != wanted[..n] {
        println!("first at {:?}", (0..n).find(|i| heard[*i] != wanted[*i]));
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if args.first().is_some_and(|a| a == "same") {
        for name in &args[1..] {
            same(name);
        }
        return;
    }
    if args.first().is_some_and(|a| a == "scenes") {
        for name in &args[1..] {
            cost(name, common::scene(name), &[]);
        }
        return;
    }
    let rows: Vec<(String, String)> = [(64, 100, 0), (64, 100, 300), (128, 100, 0), (128, 100, 300), (128, 0, 300), (64, 0, 300)]
        .iter()
        .map(|(n, r, p)| {
            (
                format!("{n} bubbles, {r} births/s, {p} pushes/s"),
                format!("[water]\nrate = 0\n[cloud]\nbubbles = {n}\nrate = {r}\npushes = {p}\nradius_min=0.7\nradius_max=6\npressure=0.1\n"),
            )
        })
        .collect();
    for (name, text) in rows {
        let scene = SceneFile::parse("x", &text).expect("valid").scene;
        cost(&name, scene, &args);
    }
}

fn cost(name: &str, scene: freshet::scene::Scene, more: &[String]) {
    let mut board = board(&[("scene", scene.clone())], 1, unhurried());
    board.run(START + Duration::from_millis(1500)).expect("runs");
    let play = board.count("freshet_firmware::audio::Player::play").expect("there");
    let tick = board.count("freshet_firmware::control::tick").expect("there");
    let kernel = board.count("freshet_cloud").expect("there");
    let more: Vec<_> = more.iter().map(|name| (name, board.count(name).expect("there"))).collect();
    board.interrupt_counts().expect("counted");
    let before = board.frames();
    board.run(Duration::from_secs(1)).expect("runs");
    let frames = (board.frames() - before) as f64;
    let interrupts = board.interrupt_counts().expect("counted");
    let all: u64 = interrupts.handlers.values().map(|handler| handler.instructions).sum();
    let play = board.counts(play).expect("c");
    let tick = board.counts(tick).expect("c");
    let kernel = board.counts(kernel).expect("c");
    println!("{name}: interrupts {:.0}/sample; play {:.0}/sample mean, {:.0} busiest block; kernel {:.0}; tick {:.0}/sample mean, longest {}",
        all as f64 / frames, play.total() as f64 / frames, play.max() as f64 / 32.0, kernel.total() as f64 / frames,
        tick.total() as f64 / frames, tick.max());
    let mut sorted = tick.calls.clone();
    sorted.sort();
    println!("   ticks: 25% {} median {} 90% {} 99% {}", sorted[sorted.len()/4], sorted[sorted.len()/2], sorted[sorted.len()*9/10], sorted[sorted.len()*99/100]);
    for (name, counter) in more {
        let counts = board.counts(counter).expect("c");
        println!("   {name}: {} calls, {:.0} mean, {} max, {:.1}/sample", counts.calls.len(), counts.mean(), counts.max(), counts.total() as f64 / frames);
    }
}
