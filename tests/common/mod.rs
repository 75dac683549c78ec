//! What the tests share: rendering to f64 and measuring.
#![allow(dead_code)]

pub mod high_band;

use freshet::fixed::PASCAL;
use freshet::mix::Output;
use freshet::observer::Observer;
use freshet::param;
use freshet::scene::Scene;
use freshet::{Frame, TICK};
use freshet_host::births::Births;
use freshet_host::board::{Board, Player};
use freshet_host::built_in::SCENES;
use freshet_host::scene_file::{SceneFile, put};
use freshet_host::source::Source;

/// A scene from TOML.
pub fn scene(toml: &str) -> Scene {
    SceneFile::parse("test", toml)
        .expect("the scene is valid")
        .scene
}

/// A scene that comes with the command.
pub fn built_in(name: &str) -> SceneFile {
    Source::built_in(name).expect("the scene is there").scene
}

/// Names of the scenes that come with the command.
pub fn scene_names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|scene| scene.0)
}

/// `scene` with one more value.
pub fn with(mut scene: Scene, path: &str, value: f32) -> Scene {
    let index = param::index_of(path).expect("the path is in the table");
    put(&mut scene, index, value);
    scene.curves.retain(|curve| curve.param != index);
    scene
}

/// Frames of the bus in pascal.
pub fn pascal(frames: &[Frame]) -> Vec<[f64; 2]> {
    frames
        .iter()
        .map(|frame| [frame.left, frame.right].map(|x| f64::from(x) / f64::from(PASCAL)))
        .collect()
}

/// The desk's instrument.
pub fn desk(scene: &Scene, rate: u32, seed: u64, output: Output) -> Box<dyn Player> {
    Board::Desk.player(scene, rate, seed, output)
}

/// Renders `seconds` in stretches of a tick, with `observer` watching.
pub fn play(player: &mut dyn Player, frames: usize, observer: &mut dyn Observer) -> Vec<Frame> {
    let mut out = vec![Frame::ZERO; frames];
    for stretch in out.chunks_mut(TICK) {
        player.render_observed(stretch, observer);
    }
    out
}

/// A raw rendering and everything that was born.
pub fn raw(scene: &Scene, rate: u32, seed: u64, seconds: f64) -> (Vec<[f64; 2]>, Births) {
    let mut player = desk(scene, rate, seed, Output::Raw);
    let mut births = Births::new(rate);
    let frames = play(
        &mut *player,
        (seconds * f64::from(rate)) as usize,
        &mut births,
    );
    (pascal(&frames), births)
}

/// 64-bit FNV-1a over the samples.
pub fn hash(frames: &[Frame]) -> u64 {
    let bytes = frames
        .iter()
        .flat_map(|frame| [frame.left, frame.right])
        .flat_map(i32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Root mean square.
pub fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0f64);
    for x in x {
        sum += x * x;
        n += 1.0;
    }
    (sum / n.max(1.0)).sqrt()
}

/// Amplitude ratio in dB.
pub fn db(ratio: f64) -> f64 {
    20.0 * ratio.log10()
}
