//! The fixed-point core against the same bubbles in f64.

mod common;

use common::{built_in, db, desk, play, raw, rms, scene, scene_names, with};
use freshet::mix::Output;
use freshet::param;
use freshet_host::reference::residual_db;

/// Rounding of the words and the 5e-6 of the sine table; the rest is margin.
const WANTED_DB: f64 = 90.0;

fn residual(scene: &freshet::scene::Scene, level: f32, seconds: f64) -> f64 {
    let (sound, births) = raw(scene, 48_000, 1, seconds);
    residual_db(
        &births.sounds,
        10f64.powf(f64::from(level) / 20.0),
        48_000,
        &sound,
    )
}

#[test]
fn every_scene_at_its_own_level_is_within_90_db_of_f64() {
    for name in scene_names() {
        let file = built_in(name);
        let level = file.value(param::LEVEL);
        // The cloud has its own f64 (tests/cloud.rs). The water beside it may be soft.
        let wanted = WANTED_DB
            - if file.value(param::CLOUD_RATE) > 0.0 {
                10.0
            } else {
                0.0
            };
        let water = with(file.scene.clone(), "cloud.rate", 0.0);
        let residual = residual(&with(water, "cloud.pushes", 0.0), level, 8.0);
        println!("{name:14} residual {residual:6.1} dB below the signal");
        assert!(residual >= wanted, "{name}: {residual:.1} dB");
    }
}

#[test]
fn crowds_and_single_births_alike_are_within_90_db_of_f64() {
    // As loud as scenes are: the fewer, the louder.
    for (rate, pressure) in [(30, 0.5), (3_000, 0.1), (300_000, 0.03), (1_000_000, 0.02)] {
        for range in [
            "radius_min = 0.2\nradius_max = 3",
            "radius_min = 3\nradius_max = 150",
        ] {
            let text = format!(
                "[water]\nrate = {rate}\n{range}\npressure = {pressure}\nalpha = 0.5\ngamma = 3\nrise_factor = 0.2"
            );
            let residual = residual(&scene(&text), 0.0, 2.0);
            println!("{rate:>8} births/s, {range:?}: {residual:.1} dB");
            assert!(residual >= WANTED_DB, "{residual:.1} dB for {text}");
        }
    }
}

#[test]
fn silence_after_the_tails_is_exact_zero() {
    for output in [Output::Raw, Output::Bits16, Output::Bits24] {
        for name in scene_names() {
            let mut player = desk(&built_in(name).scene, 48_000, 3, output);
            play(&mut *player, 3 * 48_000, &mut ());
            for path in ["water.rate", "drops.rate", "cloud.rate", "cloud.pushes"] {
                let index = param::index_of(path).expect("in the table");
                player
                    .control()
                    .set(index, 0.0, Some(0.0))
                    .expect("allowed");
            }
            // The slowest bubble a scene may have, 150 mm, loses 103 dB in 11 s; the DC blocker settles in 3 s.
            play(&mut *player, 16 * 48_000, &mut ());
            let tail = play(&mut *player, 48_000, &mut ());
            let loud = tail
                .iter()
                .filter(|frame| frame.left != 0 || frame.right != 0)
                .count();
            assert_eq!(loud, 0, "{name}, {output:?}: {loud} frames are not zero");
            assert!(player.is_silent());
        }
    }
}

#[test]
fn a_crowd_sounds_as_loud_as_its_bubbles_one_by_one() {
    // Just above one birth a sample and class, and the same births shared out to be just below.
    let text = "[water]\nradius_min = 1\nradius_max = 1.000001\nlaw = \"flat\"\nrise_factor = 0\npressure = 0.001\nbeta = 2";
    let base = scene(text);
    let crowd = with(
        with(base.clone(), "water.classes", 1.0),
        "water.rate",
        90_000.0,
    );
    let singles = with(with(base, "water.classes", 3.0), "water.rate", 90_000.0);
    let level = |scene| {
        let (sound, births) = raw(scene, 48_000, 5, 20.0);
        let counted: u64 = births.sounds.iter().map(|sound| sound.births).sum();
        (
            rms(sound[4800..].iter().map(|frame| frame[0])),
            counted,
            births.sounds.len(),
        )
    };
    let (one, two) = (level(&crowd), level(&singles));
    let difference = db(one.0 / two.0);
    println!(
        "crowd against singles: {difference:+.3} dB, {} and {} births",
        one.1, two.1
    );
    assert!(one.2 < one.1 as usize, "it is no crowd");
    assert_eq!(two.2, two.1 as usize, "they are no singles");
    assert!(difference.abs() < 0.1, "{difference:+.3} dB");
}
