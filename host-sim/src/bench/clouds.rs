//! How fast bubbles that hear each other are.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::Result;

use super::{Line, RATE, RUNS};
use crate::cloud::coupling::Coupling;
use crate::cloud::ensemble::{Ensemble, Event};
use crate::cloud::forcing::{Cause, Pulse};
use crate::cloud::player::TrackPlayer;
use crate::cloud::solver::Method;
use crate::cloud::step::Tone;
use crate::cloud::synthetic::{Law, Stream, ball, write_stream};
use crate::cloud::tracks::Tracks;

const METHOD: Method = Method {
    coupling: Coupling::DEFAULT,
    choice: None,
    rate: RATE as f64,
};

/// Seconds for which every cloud rings on once it is struck: what is silent costs nothing.
const RINGING: f64 = 0.2;

/// Standing clouds of growing size, and a stream.
pub fn clouds(seconds: f64) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    let mut points = Vec::new();
    for count in [64, 128, 250, 500, 1000, 2000, 4000] {
        let speed = standing(count)?;
        if count >= 250 {
            points.push(((count as f64).ln(), -speed.ln()));
        }
        let exponent = if count == 4000 {
            format!(", cost from 250 on grows as N^{:.2}", slope(&points))
        } else {
            String::new()
        };
        lines.push(Line {
            what: format!("{count} coupled bubbles"),
            speed,
            note: format!(
                "{:.2} us a sample{exponent}",
                1e6 / (f64::from(RATE) * speed)
            ),
        });
    }
    let stream = Stream {
        seconds,
        rate: 9_000.0,
        radius: [0.5e-3, 3e-3],
        law: Law::Log,
        region: [0.08, 0.06, 0.08],
        rise: 0.25,
        life: 0.02,
        split: 0.0,
        merge: 0.0,
        step: 1e-3,
        seed: 1,
    };
    let mut text = Vec::new();
    write_stream(&stream, &mut text)?;
    let mut speed = 0.0f64;
    let mut alive = 0;
    for _ in 0..RUNS {
        let begun = Stopwatch::start();
        let (sounded, most) = play(&text)?;
        alive = most;
        speed = speed.max(sounded / begun.seconds());
    }
    lines.push(Line {
        what: format!("9000 coupled births/s, {alive} alive at most, from tracks"),
        speed,
        note: "the reading included".into(),
    });
    Ok(lines)
}

/// Best multiple of real time of a cloud that stands and rings.
fn standing(count: usize) -> Result<f64> {
    // As dense for every size.
    let size = 0.03 * (count as f64 / 64.0).cbrt();
    let places = ball(count, size, 0.5e-3, 3e-3, 1);
    let mut ensemble = Ensemble::new(METHOD, false);
    let mut sound = Vec::new();
    let births: Vec<Event> = places
        .iter()
        .enumerate()
        .map(|(key, &place)| Event::Birth {
            key,
            place,
            tone: Tone::of_radius(place.radius),
        })
        .collect();
    ensemble.play(&births, &mut sound)?;
    let mut best = 0.0f64;
    for _ in 0..RUNS {
        // Struck again, so that it rings all the time.
        let time = ensemble.frame() as f64 / f64::from(RATE);
        let strikes: Vec<Event> = places
            .iter()
            .enumerate()
            .map(|(key, place)| Event::Strike {
                key,
                time,
                pulse: Pulse::new(Cause::Entrained, place.radius, 0.6),
            })
            .collect();
        ensemble.play(&strikes, &mut sound)?;
        sound.clear();
        let wanted = (RINGING * f64::from(RATE)) as usize;
        let begun = Stopwatch::start();
        while sound.len() < wanted {
            ensemble.play(&[], &mut sound)?;
        }
        let made = sound.len() as f64 / f64::from(RATE);
        best = best.max(made / begun.seconds());
    }
    Ok(best)
}

/// Seconds of sound and bubbles alive at most.
fn play(text: &[u8]) -> Result<(f64, usize)> {
    let tracks = Tracks::read(Path::new("bench"), text, &AtomicBool::new(false))?;
    let ensemble = Ensemble::new(METHOD, false);
    let mut player = TrackPlayer::new(tracks, ensemble, METHOD.rate, 1);
    let (mut sound, mut frames) = (Vec::new(), 0);
    while !player.is_over() {
        sound.clear();
        player.play(&mut sound)?;
        frames += sound.len();
    }
    let counts = player.ensemble().counts();
    Ok((frames as f64 / f64::from(RATE), counts.most_coupled))
}

/// As many bubbles as CB's Wave Crash.
pub fn wave() -> Result<String> {
    let stream = Stream {
        seconds: 4.5,
        rate: 300_000.0 / 4.5,
        radius: [0.3e-3, 6e-3],
        law: Law::Waves,
        region: [1.5, 0.25, 0.75],
        rise: 0.25,
        life: 0.04,
        split: 0.0,
        merge: 0.0,
        step: 10e-3,
        seed: 1,
    };
    let mut text = tempfile::tempfile()?;
    let count = write_stream(&stream, &mut std::io::BufWriter::new(&mut text))?;
    std::io::Seek::rewind(&mut text)?;
    let begun = Stopwatch::start();
    let tracks = Tracks::read(Path::new("wave"), text, &AtomicBool::new(false))?;
    let mut player = TrackPlayer::new(tracks, Ensemble::new(METHOD, false), METHOD.rate, 1);
    let bar = crate::render::progress((4.6 * f64::from(RATE)) as u64, RATE);
    let (mut sound, mut frames) = (Vec::new(), 0);
    while !player.is_over() {
        sound.clear();
        player.play(&mut sound)?;
        frames += sound.len() as u64;
        bar.set_position(frames);
    }
    bar.finish_and_clear();
    let counts = player.ensemble().counts();
    let memory = std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| {
            let line = status.lines().find(|line| line.starts_with("VmHWM"))?;
            let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
            Some(format!(", {:.0} MB at most", kb / 1024.0))
        });
    Ok(format!(
        "{count} bubbles in 4.5 s, {} coupled and {} sounding at most: {:.0} s of one core{}",
        counts.most_coupled,
        counts.most_sounding,
        begun.seconds(),
        memory.unwrap_or_default()
    ))
}

/// Of a line through the points, by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let x = points.iter().map(|p| p.0).sum::<f64>() / n;
    let y = points.iter().map(|p| p.1).sum::<f64>() / n;
    let xy: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    xy / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

/// Time of this thread on its core, where the system tells it; else the clock's.
struct Stopwatch(f64);

impl Stopwatch {
    fn start() -> Self {
        Self(Self::now())
    }

    fn seconds(&self) -> f64 {
        Self::now() - self.0
    }

    #[cfg(unix)]
    fn now() -> f64 {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
    }

    #[cfg(not(unix))]
    fn now() -> f64 {
        static FIRST: std::sync::LazyLock<std::time::Instant> =
            std::sync::LazyLock::new(std::time::Instant::now);
        FIRST.elapsed().as_secs_f64()
    }
}
