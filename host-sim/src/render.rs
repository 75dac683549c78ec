//! `freshet render`: a scene or a file of events to a WAV, a spectrogram and a log of its births.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::Args;
use freshet::cloud::Work;
use freshet::fixed::{FULL_SCALE, PASCAL};
use freshet::mix::Output;
use freshet::param;
use freshet::profile::Limits;
use freshet::stats::Stats;
use freshet::{BLOCK, Frame};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::births::EventLog;
use crate::board::{Board, Player};
use crate::cloud::render::CouplingOptions;
use crate::cloud::{self, tracks};
use crate::load::{Both, Meter};
use crate::scene_file::put;
use crate::source::{Source, Strikes};
use crate::spectrogram::{self, Spectrogram};
use crate::wav::{self, Format, WavWriter};

/// Seconds of a scene where nothing is said.
const SCENE_SECONDS: f64 = 10.0;
/// Sample rates that are rendered, Hz.
const RATES: std::ops::RangeInclusive<u32> = 8_000..=192_000;
/// The longest sound, frames: beyond, an f64 would no longer tell them apart in time.
pub(crate) const MAX_FRAMES: f64 = 1e15;
/// Frames rendered between two looks at the outside world.
const STRETCH: usize = 64 * BLOCK;

/// What `freshet render` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A scene (`freshet list`), a scene file (.toml), bubble events (.csv) or bubble tracks (.txt, .xz)
    pub source: String,
    /// Where the sound goes; `-` is the standard output [default: the scene's name, .wav]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// How long [default: 10 for a scene, to the last bubble's end for events]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub seconds: Option<f64>,
    /// The same seed gives the same sound
    #[arg(long, default_value_t = 1, allow_hyphen_values = true)]
    pub seed: u64,
    /// Sample rate in Hz, 8000 to 192000
    #[arg(
        long,
        value_name = "HZ",
        default_value_t = 48_000,
        allow_hyphen_values = true
    )]
    pub rate: u32,
    /// Bits of a sample, 16 or 24 [default: 16]
    #[arg(long, conflicts_with = "raw", value_parser = ["16", "24"])]
    pub bits: Option<String>,
    /// Play with the capacities of a board
    #[arg(long, value_enum, default_value = "desk")]
    pub board: Board,
    /// Set a parameter (`freshet describe`); may be given again
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Draw a spectrogram
    #[arg(long, value_name = "PNG")]
    pub spectrogram: Option<PathBuf>,
    /// Log every birth
    #[arg(long, value_name = "CSV")]
    pub events: Option<PathBuf>,
    /// 32-bit float in pascal for measuring: no limiter, dither, tone or DC blocker, width 0
    #[arg(long)]
    pub raw: bool,
    /// How bubbles of tracks hear each other.
    #[command(flatten)]
    pub coupling: CouplingOptions,
}

/// What came of a rendering.
#[derive(Clone, Debug)]
pub struct Report {
    /// Where the sound went.
    pub output: PathBuf,
    /// Frames written.
    pub frames: u64,
    /// Sample rate, Hz.
    pub rate: u32,
    /// Largest sample, full scale 1.
    pub peak: f64,
    /// Root mean square of both channels, full scale 1.
    pub rms: f64,
    /// Most voices at once.
    pub voices: usize,
    /// The core's counters.
    pub stats: Stats,
    /// Parts of the board's time that it takes: on average, and in the busiest block.
    pub share: Option<[f64; 2]>,
    /// Ended before all was rendered: by Ctrl-C, or because nobody reads it any more.
    pub stopped: bool,
    /// Ended by Ctrl-C.
    pub interrupted: bool,
    /// What was asked for beyond what the board takes: what of, how much, and the most there is.
    pub cuts: Vec<(&'static str, f32, f32)>,
    /// Time the rendering took.
    pub elapsed: Duration,
    /// What else the summary says.
    pub lines: Vec<String>,
}

/// Renders what is asked. `stop` ends it early with a valid file.
pub fn render(request: &Request, stop: &Arc<AtomicBool>) -> Result<Report> {
    if !RATES.contains(&request.rate) {
        bail!(
            "--rate {}: expected from {} to {} Hz",
            request.rate,
            RATES.start(),
            RATES.end()
        );
    }
    if tracks::is_tracks(Path::new(&request.source)) {
        return cloud::render::render(request, stop);
    }
    request.coupling.refuse(&request.source)?;
    let mut source = Source::find_until(&request.source, stop)?;
    source.scene.set_all(&request.set)?;
    let output = output_kind(request);
    if request.raw {
        put(&mut source.scene.scene, param::WIDTH, 0.0);
        source
            .scene
            .scene
            .curves
            .retain(|curve| curve.param != param::WIDTH);
    }
    let frames = frames(request, &source)?;
    let path = match &request.output {
        // By its other name, where the summary would run into it.
        Some(path) if path == Path::new("/dev/stdout") => "-".into(),
        Some(path) => path.clone(),
        None => format!("{}.wav", source.name).into(),
    };
    let format = match output {
        Output::Raw => Format::Float32,
        Output::Bits16 => Format::Int16,
        Output::Bits24 => Format::Int24,
    };
    // Everything that can be refused is, before a file is begun.
    let strikes = source
        .events
        .as_ref()
        .map(|file| file.strikes(request.rate))
        .transpose()?;
    check_apart(source.path.as_deref(), &path, request)?;
    if let Some(path) = &request.spectrogram {
        spectrogram::check_name(path)?;
    }
    for path in [&request.spectrogram, &request.events]
        .into_iter()
        .flatten()
    {
        check_writable(path)?;
    }
    let wav = WavWriter::create(&path, format, request.rate, frames)?;
    let log = request
        .events
        .as_deref()
        .map(|path| EventLog::create(path, request.rate))
        .transpose()?;
    let player = request
        .board
        .player(&source.scene.scene, request.rate, request.seed, output);
    let mut job = Job {
        player,
        strikes,
        log,
        meter: (request.board.core().is_some() && output != Output::Raw).then(Meter::new),
        wav,
        picture: request
            .spectrogram
            .is_some()
            .then(|| Spectrogram::new(request.rate, frames)),
        scale: full_scale(output),
        output,
        rate: request.rate,
        done: 0,
        peak: 0.0,
        energy: 0.0,
        voices: 0,
    };
    let begun = Instant::now();
    let stopped = job.run(frames, stop)?;
    let most = request.board.limits();
    let report = Report {
        output: path,
        frames: job.done,
        rate: request.rate,
        peak: job.peak,
        rms: (job.energy / (2 * job.done).max(1) as f64).sqrt(),
        voices: job.voices,
        stats: job.player.stats(),
        share: (job.meter.as_ref())
            .and_then(|meter| meter.load().share(request.board, request.rate)),
        stopped,
        interrupted: stopped && stop.load(Ordering::Relaxed),
        cuts: cuts(&source, &most),
        elapsed: begun.elapsed(),
        lines: cloud_line(job.player.cloud()).into_iter().collect(),
    };
    job.finish(request, &source.scene.title)?;
    Ok(report)
}

/// What a cloud has done, if there was one.
fn cloud_line(work: Work) -> Option<String> {
    (work.commits > 0).then(|| {
        format!(
            "cloud     {} changes, {} strikes too many or too strong",
            work.commits, work.refused
        )
    })
}

/// See [`Report::cuts`].
fn cuts(source: &Source, limits: &Limits) -> Vec<(&'static str, f32, f32)> {
    let most = if source.scene.value(param::CLOUD_RATE) > 0.0 {
        limits.beside_cloud
    } else {
        limits.alone
    };
    let rows = [
        ("births a second", param::RATE, most.rate),
        ("radius classes", param::CLASSES, most.classes as f32),
        (
            "bubbles of a cloud",
            param::CLOUD_BUBBLES,
            limits.bubbles as f32,
        ),
    ];
    let rows = rows.map(|(what, index, most)| (what, source.scene.value(index), most));
    let mut rows = rows.to_vec();
    rows.retain(|(_, asked, most)| asked > most);
    rows
}

pub(crate) fn output_kind(request: &Request) -> Output {
    match (request.raw, request.bits.as_deref()) {
        (true, _) => Output::Raw,
        (false, Some("24")) => Output::Bits24,
        (false, _) => Output::Bits16,
    }
}

/// The sample value that is 1.0 in a float.
pub(crate) fn full_scale(output: Output) -> f64 {
    match output {
        Output::Raw => f64::from(PASCAL),
        Output::Bits16 => 32_768.0,
        Output::Bits24 => 8_388_608.0,
    }
}

fn frames(request: &Request, source: &Source) -> Result<u64> {
    let seconds = match (request.seconds, &source.events) {
        (Some(seconds), _) => seconds,
        (None, Some(events)) => events.end.max(0.01),
        (None, None) => SCENE_SECONDS,
    };
    let frames = (seconds * f64::from(request.rate)).round();
    if !(1.0..=MAX_FRAMES).contains(&frames) {
        let asked = match request.seconds {
            Some(_) => format!("--seconds {seconds:?}"),
            None => format!("the last bubble ends after {seconds:?} s"),
        };
        bail!("{asked}: expected a number above 0, from 1 to {MAX_FRAMES:e} frames");
    }
    Ok(frames as u64)
}

/// Refuses a file that would be overwritten while it is read, or written twice.
pub(crate) fn check_apart(source: Option<&Path>, output: &Path, request: &Request) -> Result<()> {
    // The same file by any name, there already or not; no device or pipe, which may be shared.
    let place = |path: &Path| -> Option<PathBuf> {
        match fs::canonicalize(path) {
            Ok(place) => place.is_file().then_some(place),
            Err(_) => {
                let folder = path.parent().filter(|folder| *folder != Path::new(""));
                let folder = fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
                Some(folder.join(path.file_name()?))
            }
        }
    };
    let files = [
        ("what is read", source),
        ("the sound", (output != Path::new("-")).then_some(output)),
        ("the spectrogram", request.spectrogram.as_deref()),
        ("the events", request.events.as_deref()),
    ];
    let mut taken: Vec<(&str, PathBuf)> = Vec::new();
    for (what, path) in files {
        let Some((path, place)) = path.and_then(|path| Some((path, place(path)?))) else {
            continue;
        };
        if let Some((other, _)) = taken.iter().find(|taken| taken.1 == place) {
            bail!(
                "cannot write {what} to {}: {other} is there (give another name)",
                path.display()
            );
        }
        taken.push((what, place));
    }
    Ok(())
}

/// Finds out early that a file cannot be written; leaves no trace.
pub(crate) fn check_writable(path: &Path) -> Result<()> {
    // Whoever reads a pipe would take the end of the check for the end of the file.
    if fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir()) {
        return Ok(());
    }
    let is_new = fs::symlink_metadata(path).is_err();
    fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(path)
        .map_err(|error| wav::write_error(path.display(), &error))?;
    if is_new {
        let _ = fs::remove_file(path);
    }
    Ok(())
}

/// A rendering under way.
struct Job {
    player: Box<dyn Player>,
    strikes: Option<Strikes>,
    log: Option<EventLog>,
    /// Where it is rendered as a board.
    meter: Option<Meter>,
    wav: WavWriter,
    picture: Option<Spectrogram>,
    output: Output,
    scale: f64,
    rate: u32,
    done: u64,
    peak: f64,
    energy: f64,
    voices: usize,
}

impl Job {
    /// Renders `frames`; true if it was stopped before.
    fn run(&mut self, frames: u64, stop: &AtomicBool) -> Result<bool> {
        let bar = progress(frames, self.rate);
        let mut block = [Frame::ZERO; STRETCH];
        while self.done < frames {
            if stop.load(Ordering::Relaxed) {
                bar.finish_and_clear();
                return Ok(true);
            }
            let n = (frames - self.done).min(STRETCH as u64) as usize;
            self.fill(&mut block[..n])?;
            if let Err(error) = self.write(&block[..n]) {
                bar.finish_and_clear();
                if wav::is_broken_pipe(&error) {
                    return Ok(true);
                }
                return Err(error);
            }
            self.done += n as u64;
            self.voices = self.voices.max(self.player.voices());
            bar.set_position(self.done);
        }
        bar.finish_and_clear();
        Ok(false)
    }

    /// Renders the next frames, with the events that fall on them.
    fn fill(&mut self, out: &mut [Frame]) -> Result<()> {
        for (i, block) in out.chunks_mut(BLOCK).enumerate() {
            let start = self.done + (i * BLOCK) as u64;
            if let Some(strikes) = &mut self.strikes {
                while let Some(strike) = strikes.next_before(start, start + BLOCK as u64)? {
                    match &mut self.log {
                        Some(log) => self.player.strike(&strike, log),
                        None => self.player.strike(&strike, &mut ()),
                    }
                }
            }
            match (&mut self.log, &mut self.meter) {
                (None, None) => self.player.render(block),
                (Some(log), None) => self.player.render_observed(block, log),
                (None, Some(meter)) => self.player.render_observed(block, meter),
                (Some(log), Some(meter)) => {
                    self.player.render_observed(block, &mut Both(log, meter));
                }
            }
            if let Some(meter) = &mut self.meter {
                meter.block(&*self.player, block);
            }
        }
        if let Some(log) = &mut self.log {
            log.flush_before((self.done + out.len() as u64) as f64 / f64::from(self.rate))?;
        }
        Ok(())
    }

    fn write(&mut self, frames: &[Frame]) -> Result<()> {
        for frame in frames {
            let [left, right] = [frame.left, frame.right].map(|x| f64::from(x) / self.scale);
            self.peak = self.peak.max(left.abs()).max(right.abs());
            self.energy += left * left + right * right;
            if let Some(picture) = &mut self.picture {
                picture.push(left as f32, right as f32);
            }
            if self.output == Output::Raw {
                self.wav.write_float(left as f32, right as f32)?;
            } else {
                self.wav.write_int(frame.left, frame.right)?;
            }
        }
        Ok(())
    }

    fn finish(self, request: &Request, title: &str) -> Result<()> {
        match self.wav.finish() {
            Err(error) if !wav::is_broken_pipe(&error) => return Err(error),
            _ => {}
        }
        if let (Some(picture), Some(path)) = (self.picture, &request.spectrogram) {
            picture.write_png(path, title)?;
        }
        self.log.map_or(Ok(()), EventLog::finish)
    }
}

pub(crate) fn progress(frames: u64, rate: u32) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(frames), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {speed}  {eta} left")
        .expect("the template is valid")
        .with_key(
            "speed",
            move |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
                let _ = write!(out, "{:.1} x real time", state.per_sec() / f64::from(rate));
            },
        );
    bar.set_style(style);
    bar
}

impl Report {
    /// The summary, for people.
    pub fn summary(&self) -> String {
        let seconds = self.frames as f64 / f64::from(self.rate);
        let speed = seconds / self.elapsed.as_secs_f64().max(1e-9);
        let stats = &self.stats;
        let db = |x: f64| {
            if x > 0.0 {
                format!("{:.1} dBFS", 20.0 * x.log10())
            } else {
                "silence".into()
            }
        };
        let output = match self.output.to_string_lossy() {
            name if name == "-" => "standard output".into(),
            name => name,
        };
        let mut lines = vec![
            format!(
                "{output}  {seconds:.3} s at {} Hz, rendered at {speed:.0} x real time{}",
                self.rate,
                if self.stopped { " (stopped early)" } else { "" },
            ),
            format!(
                "births    {} ({} a second)",
                stats.births,
                (stats.births as f64 / seconds.max(1e-9)).round()
            ),
            format!("peak      {}, rms {}", db(self.peak), db(self.rms)),
            format!("voices    {} at most, {} stolen", self.voices, stats.stolen),
        ];
        if let Some([mean, busiest]) = self.share.map(|share| share.map(|part| 100.0 * part)) {
            lines.push(format!(
                "chip      {mean:.0} % of its time, {busiest:.0} % in the busiest block"
            ));
        }
        lines.extend_from_slice(&self.lines);
        let mut note = |count: u64, text: &str| {
            if count > 0 {
                lines.push(format!("note      {count} {text}"));
            }
        };
        note(
            stats.unvoiced,
            "rising bubbles found no voice and sounded in their class",
        );
        note(stats.dropped, "bubbles found no voice and were not sounded");
        note(
            stats.too_high,
            "bubbles were too high for the sample rate and were not sounded",
        );
        note(
            stats.late,
            "blocks had more births than the board takes; the rest came a block later",
        );
        note(
            stats.overloads,
            "births found their resonator at its limit: lower water.pressure",
        );
        note(stats.limited, "frames were held down by the limiter");
        if self.output_clips() {
            lines.push("note      the sound passes full scale: lower mix.level".into());
        }
        for (what, asked, most) in &self.cuts {
            lines.push(format!(
                "note      {asked} {what} asked for, {most} is the board's most"
            ));
        }
        lines.join("\n")
    }

    /// Whether samples pass full scale, as only a raw rendering may.
    fn output_clips(&self) -> bool {
        self.peak > 1.0 + 1.0 / f64::from(FULL_SCALE)
    }
}
