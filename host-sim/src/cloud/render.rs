//! `freshet render tracks.txt`: a file of bubble tracks to a WAV and a spectrogram.

use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use freshet::fixed::PASCAL;
use freshet::mix::{Mix, Output, Settings};
use freshet::param;
use freshet::stats::Stats;
use freshet::{BLOCK, Frame};

use super::coupling::{Coupling, Kernel};
use super::ensemble::Ensemble;
use super::player::TrackPlayer;
use super::solver::{Choice, Method};
use super::tracks::Tracks;
use crate::board::Board;
use crate::render::{
    MAX_FRAMES, Report, Request, check_apart, check_writable, full_scale, output_kind, progress,
};
use crate::scene_file::SceneFile;
use crate::spectrogram::{self, Spectrogram};
use crate::wav::{self, Format, WavWriter};

/// Where the loudest sample comes to stand unless mix.level says otherwise, dBFS.
const PEAK_DB: f64 = -1.0;
/// What may ring after the last bubble's end, s; the file ends when all is silent, if that is before.
const TAIL: f64 = 2.0;
/// Longest sound without --seconds, s: beyond, a file's times are more likely to be wrong.
const LONGEST: f64 = 3600.0;

/// How bubbles hear each other; for files of bubble tracks.
#[derive(Clone, Debug, Default, Args)]
pub struct CouplingOptions {
    /// Tracks: let no bubble hear another
    #[arg(long)]
    pub uncoupled: bool,
    /// Tracks: how the coupling is solved [default: by size]
    #[arg(long, value_enum)]
    pub solver: Option<Choice>,
    /// Tracks: softness ε of the coupling between near bubbles [default: 2]
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    pub epsilon: Option<f64>,
    /// Tracks: form of the coupling [default: definite]
    #[arg(long, value_enum)]
    pub kernel: Option<Kernel>,
    /// Tracks: subtract each bubble's image in the surface
    #[arg(long)]
    pub dipole: bool,
}

impl CouplingOptions {
    /// The coupling asked for.
    ///
    /// # Errors
    /// An ε out of range.
    pub fn coupling(&self) -> Result<Coupling> {
        let plain = Coupling::default();
        Coupling {
            kernel: self.kernel.unwrap_or(plain.kernel),
            epsilon: self.epsilon.unwrap_or(plain.epsilon),
            dipole: self.dipole,
        }
        .checked()
    }

    /// Refuses them for what has no tracks.
    ///
    /// # Errors
    /// Any that is given.
    pub fn refuse(&self, source: &str) -> Result<()> {
        let given = [
            (self.uncoupled, "--uncoupled"),
            (self.solver.is_some(), "--solver"),
            (self.epsilon.is_some(), "--epsilon"),
            (self.kernel.is_some(), "--kernel"),
            (self.dipole, "--dipole"),
        ];
        match given.iter().find(|given| given.0) {
            Some((_, name)) => {
                bail!("{name} is for files of bubble tracks (.txt, .xz), and `{source}` is none")
            }
            None => Ok(()),
        }
    }
}

/// Renders a file of tracks as [`crate::render::render`] does a scene.
///
/// # Errors
/// What cannot be read, written or solved.
pub fn render(request: &Request, stop: &Arc<AtomicBool>) -> Result<Report> {
    let options = &request.coupling;
    if request.events.is_some() {
        bail!("--events: a file of tracks has no births to log, for it lists them itself");
    }
    if request.board != Board::Desk {
        bail!(
            "--board {}: tracks are rendered with the desk's capacities (leave it out)",
            request.board.name()
        );
    }
    let coupling = options.coupling()?;
    let input = Path::new(&request.source);
    let name = {
        let name = input
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let name = name.strip_suffix(".xz").unwrap_or(&name);
        name.strip_suffix(".txt").unwrap_or(name).to_owned()
    };
    let mut scene = SceneFile {
        title: if options.uncoupled {
            format!("{name}, uncoupled")
        } else {
            name.clone()
        },
        ..SceneFile::default()
    };
    scene.set_all(&request.set)?;
    let path = match &request.output {
        Some(path) if path == Path::new("/dev/stdout") => "-".into(),
        Some(path) => path.clone(),
        None => PathBuf::from(format!("{name}.wav")),
    };
    check_apart(Some(input), &path, request)?;
    if let Some(picture) = &request.spectrogram {
        spectrogram::check_name(picture)?;
        check_writable(picture)?;
    }
    if path != Path::new("-") {
        check_writable(&path)?;
    }

    let begun = Instant::now();
    let tracks = Tracks::open(input, stop)?;
    let frames = frames(request, &tracks)?;
    let method = Method {
        coupling,
        choice: options.solver,
        rate: f64::from(request.rate),
    };
    let ensemble = Ensemble::new(method, options.uncoupled);
    let mut player = TrackPlayer::new(tracks, ensemble, method.rate, request.seed);
    let mut spool = Spool::new();
    let stopped = run(&mut player, &mut spool, frames, request, stop)?;

    // The level is known only now that all was heard.
    let output = output_kind(request);
    let given = request
        .set
        .iter()
        .any(|set| set.trim_start().starts_with("mix.level"));
    let gain_db = if output == Output::Raw || given || spool.peak <= 0.0 {
        0.0
    } else {
        PEAK_DB - 20.0 * spool.peak.log10()
    };
    let mut report = Report {
        output: path.clone(),
        frames: 0,
        rate: request.rate,
        peak: 0.0,
        rms: 0.0,
        voices: player.ensemble().counts().most_sounding,
        stats: Stats::default(),
        stopped,
        interrupted: stopped && stop.load(Ordering::Relaxed),
        cuts: Vec::new(),
        share: None,
        elapsed: begun.elapsed(),
        lines: lines(&player, options, gain_db, given || output == Output::Raw),
    };
    write(request, &scene, spool, gain_db, &mut report)?;
    let counts = player.ensemble().counts();
    report.stats.births = counts.births;
    report.stats.too_high = counts.too_high;
    report.elapsed = begun.elapsed();
    Ok(report)
}

fn frames(request: &Request, tracks: &Tracks) -> Result<Option<u64>> {
    let rate = f64::from(request.rate);
    if let Some(seconds) = request.seconds {
        let frames = (seconds * rate).round();
        if !(1.0..=MAX_FRAMES).contains(&frames) {
            bail!(
                "--seconds {seconds:?}: expected a number above 0, from 1 to {MAX_FRAMES:e} frames"
            );
        }
        return Ok(Some(frames as u64));
    }
    let end = tracks.end();
    if end > LONGEST {
        bail!(
            "{}: the last bubble ends after {end} s; give --seconds if that is meant",
            request.source
        );
    }
    Ok(None)
}

fn run(
    player: &mut TrackPlayer,
    spool: &mut Spool,
    frames: Option<u64>,
    request: &Request,
    stop: &AtomicBool,
) -> Result<bool> {
    let rate = f64::from(request.rate);
    let most = frames.unwrap_or(((player.tracks().end() + TAIL) * rate) as u64 + 1);
    let bar = progress(most, request.rate);
    let mut samples = Vec::new();
    let mut stopped = false;
    while spool.count < most {
        if stop.load(Ordering::Relaxed) {
            stopped = true;
            break;
        }
        if frames.is_none() && player.is_over() {
            break;
        }
        samples.clear();
        player
            .play(&mut samples)
            .with_context(|| request.source.clone())
            .inspect_err(|_| bar.finish_and_clear())?;
        samples.truncate((most - spool.count) as usize);
        spool.push(&samples)?;
        bar.set_position(spool.count);
    }
    bar.finish_and_clear();
    Ok(stopped)
}

/// What the summary says besides.
fn lines(
    player: &TrackPlayer,
    options: &CouplingOptions,
    gain_db: f64,
    level_given: bool,
) -> Vec<String> {
    let counts = player.ensemble().counts();
    let mut lines = vec![format!(
        "tracks    {} bubbles, {} samples",
        player.tracks().tracks.len(),
        player.tracks().samples
    )];
    lines.push(if options.uncoupled {
        "coupled   none (--uncoupled)".into()
    } else {
        format!(
            "coupled   {} at most, {} changes of the matrix",
            counts.most_coupled, counts.solvers
        )
    });
    if !level_given {
        lines.push(format!(
            "level     {gain_db:+.1} dB (--set mix.level=… to choose it)"
        ));
    }
    for sentence in player.tracks().oddities.sentences() {
        lines.push(format!("note      {sentence}"));
    }
    if counts.without_dipole > 0 {
        lines.push(format!(
            "note      {} times the depths were not those under a plane, and the image was left out",
            counts.without_dipole
        ));
    }
    lines
}

fn write(
    request: &Request,
    scene: &SceneFile,
    spool: Spool,
    gain_db: f64,
    report: &mut Report,
) -> Result<()> {
    let output = output_kind(request);
    let format = match output {
        Output::Raw => Format::Float32,
        Output::Bits16 => Format::Int16,
        Output::Bits24 => Format::Int24,
    };
    let count = spool.count;
    let mut wav = WavWriter::create(&report.output, format, request.rate, count)?;
    let mut picture = request
        .spectrogram
        .is_some()
        .then(|| Spectrogram::new(request.rate, count));
    let rate = f64::from(request.rate);
    let value = |index| f64::from(scene.value(index));
    let settings = Settings::new(
        value(param::LEVEL),
        value(param::TONE),
        scene.value(param::LIMITER) == 1.0,
    );
    let mut mix = Mix::new(output, request.seed, &settings, rate);
    let gain = 10f64.powf(gain_db / 20.0);
    let scale = full_scale(output);
    let mut energy = 0.0;
    let mut samples = spool.read_back()?;
    let mut block = [Frame::ZERO; BLOCK];
    while report.frames < count {
        let n = (count - report.frames).min(BLOCK as u64) as usize;
        let mut raw = [0.0; BLOCK];
        for (frame, raw) in block.iter_mut().zip(&mut raw) {
            // Zeros past the end bring out the limiter's last frames.
            *raw = samples.next_sample()?.unwrap_or(0.0);
            let value =
                (*raw * gain * f64::from(PASCAL)).clamp(f64::from(i32::MIN), f64::from(i32::MAX));
            *frame = Frame {
                left: value as i32,
                right: value as i32,
            };
        }
        if output != Output::Raw {
            mix.render(&mut block, &mut report.stats);
        }
        for (frame, raw) in block[..n].iter().zip(&raw) {
            let (left, right) = if output == Output::Raw {
                let value = raw * 10f64.powf(value(param::LEVEL) / 20.0);
                (value, value)
            } else {
                (
                    f64::from(frame.left) / scale,
                    f64::from(frame.right) / scale,
                )
            };
            report.peak = report.peak.max(left.abs()).max(right.abs());
            energy += left * left + right * right;
            if let Some(picture) = &mut picture {
                picture.push(left as f32, right as f32);
            }
            let written = match output {
                Output::Raw => wav.write_float(left as f32, right as f32),
                _ => wav.write_int(frame.left, frame.right),
            };
            match written {
                Err(error) if wav::is_broken_pipe(&error) => {
                    report.stopped = true;
                    return Ok(());
                }
                other => other?,
            }
        }
        report.frames += n as u64;
    }
    report.rms = (energy / (2 * count).max(1) as f64).sqrt();
    match wav.finish() {
        Err(error) if !wav::is_broken_pipe(&error) => return Err(error),
        _ => {}
    }
    match (picture, &request.spectrogram) {
        (Some(picture), Some(path)) => picture.write_png(path, &scene.title),
        _ => Ok(()),
    }
}

/// The sound until its level is known: f32 in pascal, in memory or a temporary file.
struct Spool {
    file: BufWriter<tempfile::SpooledTempFile>,
    count: u64,
    peak: f64,
}

struct Back(BufReader<tempfile::SpooledTempFile>);

impl Spool {
    fn new() -> Self {
        Self {
            file: BufWriter::new(tempfile::SpooledTempFile::new(64 << 20)),
            count: 0,
            peak: 0.0,
        }
    }

    fn push(&mut self, samples: &[f64]) -> Result<()> {
        for sample in samples {
            self.peak = self.peak.max(sample.abs());
            self.file
                .write_all(&(*sample as f32).to_le_bytes())
                .context("cannot write the temporary file of the sound (is the disk full?)")?;
        }
        self.count += samples.len() as u64;
        Ok(())
    }

    fn read_back(self) -> Result<Back> {
        let mut file = self
            .file
            .into_inner()
            .map_err(|error| anyhow!("cannot write the temporary file of the sound: {error}"))?;
        file.rewind()
            .context("cannot read the temporary file of the sound back")?;
        Ok(Back(BufReader::new(file)))
    }
}

impl Back {
    fn next_sample(&mut self) -> Result<Option<f64>> {
        let mut bytes = [0; 4];
        match self.0.read_exact(&mut bytes) {
            Ok(()) => Ok(Some(f64::from(f32::from_le_bytes(bytes)))),
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error).context("cannot read the temporary file of the sound back"),
        }
    }
}
