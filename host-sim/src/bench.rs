//! `freshet bench`: speed on one core, as multiples of real time.

use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;
use freshet::mix::Output;
use freshet::scene::Scene;
use freshet::voices::{Pitch, Strike};
use freshet::{Frame, TICK};

use crate::board::{Board, Player};
use crate::built_in;
use crate::scene_file::SceneFile;

mod clouds;

const RATE: u32 = 48_000;
/// Each figure is the best of so many runs: what else the machine does only ever adds.
const RUNS: usize = 5;

/// What `freshet bench` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// Seconds of sound in a run
    #[arg(
        long,
        value_name = "S",
        default_value_t = 4.0,
        allow_hyphen_values = true
    )]
    pub seconds: f64,
    /// Only the coupled clouds
    #[arg(long)]
    pub coupled: bool,
    /// Only a breaking wave of 300 000 coupled bubbles in 4.5 s, once: it takes minutes
    #[arg(long)]
    pub wave: bool,
    /// Only the transfer from bubble to ear: its residuals and its speed; it takes minutes
    #[arg(long)]
    pub transfer: bool,
    /// With --transfer: draw convergence and cost into this folder
    #[arg(long, value_name = "FOLDER", requires = "transfer")]
    pub plots: Option<std::path::PathBuf>,
}

/// One line of the table.
struct Line {
    what: String,
    /// Multiples of real time.
    speed: f64,
    note: String,
}

/// The figures, as a table.
pub fn bench(request: &Request) -> Result<String> {
    if !(0.01..=3600.0).contains(&request.seconds) {
        bail!("--seconds {}: expected from 0.01 to 3600", request.seconds);
    }
    if request.transfer {
        return crate::transfer::bench::bench(request.plots.as_deref());
    }
    if request.wave {
        return clouds::wave();
    }
    let frames = (request.seconds * f64::from(RATE)) as usize;
    let coupled = clouds::clouds(request.seconds.min(2.0))?;
    if request.coupled {
        return Ok(table(request, &coupled));
    }
    let mut lines: Vec<Line> = [1e6, 1e5, 1e4]
        .iter()
        .map(|rate| births(*rate, frames))
        .collect();
    lines.extend([5_000, 10_000].map(|count| voices(count, frames)));
    lines.extend(idle(frames));
    for scene in built_in::all() {
        let (name, file) = scene?;
        let scene = file.scene;
        let speed = speed(
            || Board::Desk.player(&scene, RATE, 1, Output::Bits16),
            frames,
        );
        lines.push(Line {
            what: format!("scene {name}"),
            speed,
            note: String::new(),
        });
    }
    lines.extend(coupled);
    Ok(table(request, &lines))
}

fn table(request: &Request, lines: &[Line]) -> String {
    let mut table = vec![
        format!(
            "one core, {RATE} Hz stereo, {} s a run, best of {RUNS}",
            request.seconds
        ),
        format!("{:<52} {:>12}  note", "what", "x real time"),
    ];
    table.extend(lines.iter().map(|line| {
        format!("{:<52} {:>12.1}  {}", line.what, line.speed, line.note)
            .trim_end()
            .to_owned()
    }));
    table.join("\n")
}

/// Best multiple of real time of playing on with what `make` gives.
fn speed(make: impl Fn() -> Box<dyn Player>, frames: usize) -> f64 {
    let mut block = [Frame::ZERO; TICK];
    let mut best = 0.0f64;
    for _ in 0..RUNS {
        let mut player = make();
        // Past the start: every class rings.
        player.render(&mut block);
        let begun = Instant::now();
        for _ in 0..frames.div_ceil(TICK) {
            player.render(&mut block);
        }
        let rendered = (frames.div_ceil(TICK) * TICK) as f64 / f64::from(RATE);
        best = best.max(rendered / begun.elapsed().as_secs_f64());
    }
    best
}

fn scene(text: &str) -> Scene {
    SceneFile::parse("bench", text)
        .expect("the bench's scenes are valid")
        .scene
}

/// The whole population, evenly spread over 50 classes: the most work a birth rate can be.
fn births(rate: f64, frames: usize) -> Line {
    let scene = scene(&format!(
        "[water]\nrate = {rate:.0}\nradius_min = 0.2\nradius_max = 50\nlaw = \"flat\"\nrise_factor = 0\npressure = 0.0003"
    ));
    let speed = speed(
        || Board::Desk.player(&scene, RATE, 1, Output::Bits16),
        frames,
    );
    Line {
        what: format!("50 classes, {rate:.0} births/s"),
        speed,
        note: format!("{:.1} % of a core", 100.0 / speed),
    }
}

/// `count` rising bubbles that all sound throughout.
fn voices(count: usize, frames: usize) -> Line {
    let silent = scene("[water]\nrate = 0");
    let make = || {
        let mut player = Board::Desk.player(&silent, RATE, 1, Output::Bits16);
        for i in 0..count {
            // 100 to 150 mm: the decay outlasts the run.
            let radius = 0.1 + 0.05 * i as f32 / count as f32;
            let pitch = Pitch::new(radius, 0.1, f64::from(RATE));
            let at = 480.0 * i as f64 / count as f64;
            player.strike(&Strike::new(pitch, at, [1 << 14, 1 << 13]), &mut ());
        }
        player
    };
    let alive = {
        let mut player = make();
        let mut block = [Frame::ZERO; TICK];
        (0..frames.div_ceil(TICK)).for_each(|_| player.render(&mut block));
        player.voices()
    };
    let speed = speed(make, frames);
    Line {
        what: format!("{count} rising voices, {alive} at the end"),
        speed,
        note: format!(
            "{:.0} voices in real time, {:.2} ns a voice-sample",
            count as f64 * speed,
            1e9 / (f64::from(RATE) * speed * count as f64)
        ),
    }
}

/// Silence, with the fewest and the most idle slots.
fn idle(frames: usize) -> Vec<Line> {
    let silent = scene("[water]\nrate = 0");
    [(Board::F411, "12"), (Board::Desk, "16384")]
        .map(|(board, slots)| Line {
            what: format!("silence, {slots} idle voice slots"),
            speed: speed(|| board.player(&silent, RATE, 1, Output::Bits16), frames),
            note: String::new(),
        })
        .into()
}
