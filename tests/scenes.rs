//! What every scene owes its listener: words, a picture, a sane level, an intensity that grows, no loop and no beat.

mod common;

use std::fs;

use common::{built_in, db, desk, play, rms, scene_names};
use freshet::mix::Output;
use freshet::param;
use realfft::RealFftPlanner;

const RATE: u32 = 24_000;

/// Loudness in 20 ms steps over `seconds`, full scale 1.
fn envelope(name: &str, intensity: Option<f32>, seconds: usize) -> Vec<f64> {
    let scene = built_in(name).scene;
    let mut player = desk(&scene, RATE, 11, Output::Bits24);
    if let Some(intensity) = intensity {
        player
            .control()
            .set(param::INTENSITY, intensity, Some(0.0))
            .expect("allowed");
    }
    let frames = play(&mut *player, seconds * RATE as usize, &mut ());
    frames
        .chunks(RATE as usize / 50)
        .map(|step| rms(step.iter().map(|frame| f64::from(frame.left) / 8_388_608.0)))
        .collect()
}

#[test]
fn every_scene_has_words_and_a_picture_in_the_guide() {
    let guide = fs::read_to_string("docs/scenes.md").expect("the guide is there");
    for name in scene_names() {
        let file = built_in(name);
        assert!(
            !file.title.is_empty() && !file.sounds.is_empty(),
            "{name} has no words"
        );
        let tail = &file.sounds[1..];
        assert!(
            guide.contains(tail),
            "docs/scenes.md does not say what {name} sounds like"
        );
        assert!(
            guide.contains(&format!("pictures/{name}.png")),
            "{name} is not shown"
        );
        assert!(fs::exists(format!("docs/pictures/{name}.png")).expect("readable"));
    }
    assert_eq!(scene_names().count(), 16);
}

#[test]
fn every_scene_plays_at_a_level_that_can_be_used_beside_the_others() {
    for name in scene_names() {
        let envelope = envelope(name, None, 12);
        let level = db(rms(envelope.iter().copied()));
        println!("{name:12} {level:6.1} dBFS rms");
        assert!((-46.0..=-20.0).contains(&level), "{name}: {level:.1} dBFS");
    }
}

#[test]
fn more_intensity_is_more_sound() {
    for name in scene_names() {
        let levels = [0.0, 0.5, 1.0].map(|x| db(rms(envelope(name, Some(x), 10).into_iter())));
        println!(
            "{name:12} {:6.1} {:6.1} {:6.1} dBFS at intensity 0, 0.5, 1",
            levels[0], levels[1], levels[2]
        );
        assert!(levels[2] > levels[0] + 3.0, "{name}: {levels:?}");
    }
}

/// A loop repeats its loudness, a beat puts a line into the loudness' spectrum. Chance alone gives correlations of about
/// 3/sqrt(independent steps).
#[test]
fn no_scene_loops_or_beats() {
    const STEPS: usize = 2_048;
    for name in scene_names() {
        let mut loudness: Vec<f64> = envelope(name, None, 41)
            .iter()
            .take(STEPS)
            .map(|x| (x + 1e-6).ln())
            .collect();
        let mean = loudness.iter().sum::<f64>() / STEPS as f64;
        loudness.iter_mut().for_each(|x| *x -= mean);
        let correlation = |lag: usize| {
            let (a, b) = (&loudness[lag..], &loudness[..STEPS - lag]);
            let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
            dot / (norm(a) * norm(b))
        };
        // A loop of 2 to 25 s: slower than any bubble but the largest rings.
        let repeat = (100..1_250).map(correlation).fold(0.0, f64::max);
        let mut spectrum = vec![Default::default(); STEPS / 2 + 1];
        let mut windowed: Vec<f64> = (0..STEPS)
            .map(|n| {
                let turn = 2.0 * std::f64::consts::PI * n as f64 / STEPS as f64;
                loudness[n] * 0.5 * (1.0 - turn.cos())
            })
            .collect();
        RealFftPlanner::new()
            .plan_fft_forward(STEPS)
            .process(&mut windowed, &mut spectrum)
            .expect("the lengths match");
        let power: Vec<f64> = spectrum
            .iter()
            .map(|bin: &realfft::num_complex::Complex<f64>| bin.norm_sqr())
            .collect();
        // From 0.5 Hz: the highest line over the median of its neighbours.
        let mut line = 0.0f64;
        for i in 32..power.len() - 16 {
            let mut near = power[i - 16..=i + 16].to_vec();
            near.sort_by(f64::total_cmp);
            line = line.max(10.0 * (power[i] / near[16]).log10());
        }
        println!("{name:12} repeats by {repeat:.2}, strongest line {line:.1} dB");
        // Waves come and go with some regularity, and a tap drips evenly: that is their nature, within bounds.
        let (repeat_max, line_max) = match name {
            "surf" => (0.75, 18.0),
            "tap" => (0.6, 26.0),
            _ => (0.45, 18.0),
        };
        assert!(repeat < repeat_max, "{name} repeats: {repeat:.2}");
        assert!(line < line_max, "{name} beats: {line:.1} dB");
    }
}
