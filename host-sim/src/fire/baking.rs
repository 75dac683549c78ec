//! Baking a fire: its rows in parallel, with a file beside the output that an interrupted bake goes on from.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rayon::prelude::*;

use super::fire_file::Fire;
use super::picture;
use super::row::{Plan, Row};
use super::sound::{centroid, rms};
use super::texture::{self, Loops};
use crate::bake::{Report, Request};
use crate::wav::write_error;

/// How often a row is kept.
const KEEP: Duration = Duration::from_secs(15);
/// Steps between looks at the clock.
const LOOK: usize = 64;
/// Of what is kept: another one is begun anew.
const VERSION: u32 = 1;

/// Bakes the fire in `text`; `name` is for messages.
///
/// # Errors
/// A fire that says something wrong; files that cannot be written.
pub fn bake(request: &Request, name: &str, text: &str, stop: &AtomicBool) -> Result<Report> {
    let fire = Fire::parse(name, text)?;
    let output = &request.output;
    let failed = |error: &io::Error| write_error(output.display(), error);
    // Before the work, not after it.
    if output.is_dir() {
        return Err(failed(&io::ErrorKind::IsADirectory.into()));
    }
    let kept = Kept::beside(output, &fire)?;
    let start = Instant::now();
    let (rows, resumed) = rows(&fire, &kept, stop)?;
    let done: Vec<Row> = rows.into_iter().filter(Row::is_done).collect();
    if done.len() < fire.speeds.len() {
        return Ok(Report {
            summary: format!(
                "{}  stopped with {} of {} rows done; the same command goes on from {}",
                output.display(),
                done.len(),
                fire.speeds.len(),
                kept.folder.display()
            ),
            interrupted: true,
        });
    }
    let loops = loops(&fire, &done);
    let bytes = texture::write(&loops, fire.seconds, fire.bits)?;
    replace(output, &bytes).map_err(|error| failed(&error))?;
    if let Some(path) = &request.slice {
        picture::slice(path, &fire, done.last())?;
    }
    if let Some(path) = &request.energy {
        picture::energy(path, &fire, &done)?;
    }
    if let Some(path) = &request.spectrogram {
        picture::sound(path, &fire, &loops)?;
    }
    kept.remove();
    Ok(Report {
        summary: summary(
            request,
            &fire,
            &done,
            &loops,
            &bytes,
            start.elapsed(),
            resumed,
        )?,
        interrupted: false,
    })
}

/// The sounds of finished rows.
pub fn loops(fire: &Fire, rows: &[Row]) -> Vec<Loops> {
    let all = fire.speeds.iter().zip(rows);
    all.map(|(&speed, row)| Loops {
        speed,
        sounds: fire.receivers.iter().map(|way| row.sound(*way)).collect(),
    })
    .collect()
}

/// All rows, as far as they come before `stop`, and whether any goes on from before.
pub fn rows(fire: &Fire, kept: &Kept, stop: &AtomicBool) -> Result<(Vec<Row>, bool)> {
    let steps: usize = fire
        .speeds
        .iter()
        .map(|u| Plan::new(fire, *u).steps())
        .sum();
    let bar = ProgressBar::with_draw_target(Some(steps as u64), ProgressDrawTarget::stderr());
    let style =
        ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed} passed, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    let resumed = AtomicBool::new(false);
    // One by one, the fastest first: they take longest.
    let mut rows = (0..fire.speeds.len())
        .rev()
        .par_bridge()
        .map(|index| {
            let mut row = Row::new(fire, fire.speeds[index], index);
            if kept.load(index, &mut row) {
                resumed.store(true, Ordering::Relaxed);
                let done = row.progress.settling.len() + row.progress.moments.len();
                bar.inc(done as u64);
            }
            let mut last = Instant::now();
            while !row.is_done() && !stop.load(Ordering::Relaxed) {
                for _ in 0..LOOK {
                    if row.is_done() {
                        break;
                    }
                    row.step();
                    bar.inc(1);
                }
                if last.elapsed() > KEEP {
                    kept.save(index, &row)?;
                    last = Instant::now();
                }
            }
            kept.save(index, &row)?;
            Ok((index, row))
        })
        .collect::<Result<Vec<_>>>()?;
    bar.finish_and_clear();
    rows.sort_by_key(|(index, _)| *index);
    let rows = rows.into_iter().map(|(_, row)| row).collect();
    Ok((rows, resumed.into_inner()))
}

/// Where rows are kept while others are computed.
pub struct Kept {
    folder: PathBuf,
    /// What they are rows of.
    key: Vec<u8>,
}

impl Kept {
    /// A folder beside the output, for a fire.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn beside(output: &Path, fire: &Fire) -> Result<Self> {
        let mut name = output.as_os_str().to_owned();
        name.push(".rows");
        let folder = PathBuf::from(name);
        match fs::create_dir(&folder) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                return Err(write_error(folder.display(), &error));
            }
            _ => {}
        }
        // Receivers and bits come after the flow: other ones take what is kept.
        let Fire {
            width,
            cells,
            perturbation,
            eddy,
            confinement,
            viscosity,
            speeds,
            seconds,
            seed,
            ..
        } = fire;
        let flow = (width, cells, perturbation, eddy, confinement, viscosity);
        let version = (VERSION, env!("CARGO_PKG_VERSION"));
        let key = postcard::to_stdvec(&(version, flow, speeds, seconds, seed))?;
        Ok(Self { folder, key })
    }

    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("row-{index}"))
    }

    /// Goes on where the row was; false where nothing was kept, or of another fire.
    fn load(&self, index: usize, row: &mut Row) -> bool {
        let Ok(bytes) = fs::read(self.path(index)) else {
            return false;
        };
        let state = bytes.strip_prefix(&self.key[..]);
        let state = state.and_then(|state| postcard::from_bytes(state).ok());
        state.is_some_and(|state| row.resume(state))
    }

    fn save(&self, index: usize, row: &Row) -> Result<()> {
        let path = self.path(index);
        let bytes = postcard::to_extend(&row.state(), self.key.clone())?;
        replace(&path, &bytes).map_err(|error| write_error(path.display(), &error))
    }

    fn remove(&self) {
        // What is left over does no harm: it is of this fire.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Writes a file, all or nothing.
fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    let new = PathBuf::from(name);
    let mut file = File::create(&new)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&new, path)
}

fn summary(
    request: &Request,
    fire: &Fire,
    rows: &[Row],
    loops: &[Loops],
    bytes: &[u8],
    elapsed: Duration,
    resumed: bool,
) -> Result<String> {
    let mut lines = vec![format!(
        "{}  {} bytes: {} rows of {} s, {} variants, {} bits (quantisation noise {:.1} dB re the sound)",
        request.output.display(),
        bytes.len(),
        rows.len(),
        fire.seconds,
        fire.receivers.len(),
        fire.bits,
        texture::quantisation_db(loops, bytes)?
    )];
    lines.push(format!(
        "{:>8} {:>8} {:>9} {:>12} {:>12} {:>9} {:>12}",
        "m/s", "samples", "rate Hz", "rms Pa", "centroid Hz", "steady", "divergence"
    ));
    for (row, sound) in rows.iter().zip(loops) {
        let rate = row.plan.samples as f64 / fire.seconds;
        let steady = match row.settled_after() {
            Some(crossings) => format!("{crossings}"),
            None => "never".into(),
        };
        lines.push(format!(
            "{:>8} {:>8} {:>9.1} {:>12.2e} {:>12.1} {:>9} {:>12.1e}",
            sound.speed,
            row.plan.samples,
            rate,
            rms(&sound.sounds),
            centroid(&sound.sounds, rate),
            steady,
            row.progress.divergence
        ));
    }
    lines.push("steady    after so many flow-throughs".into());
    if let Some(row) = rows.iter().position(|row| row.settled_after().is_none()) {
        let speed = fire.speeds[row];
        lines.push(format!(
            "note      at {speed} m/s the flow was not steady when it was recorded"
        ));
    }
    lines.push(time(rows, elapsed, resumed));
    Ok(lines.join("\n"))
}

/// Where the time went.
fn time(rows: &[Row], elapsed: Duration, resumed: bool) -> String {
    let mut parts = [
        ("advection", Duration::ZERO),
        ("projection", Duration::ZERO),
        ("vorticity and forces", Duration::ZERO),
        ("inflow", Duration::ZERO),
        ("source", Duration::ZERO),
    ];
    for row in rows {
        let (spent, source) = row.spent();
        let each = [
            spent.advection,
            spent.projection,
            spent.forces,
            spent.inflow,
            source,
        ];
        for (part, each) in parts.iter_mut().zip(each) {
            part.1 += each;
        }
    }
    let all: f64 = parts.iter().map(|part| part.1.as_secs_f64()).sum();
    let share = |part: &(&str, Duration)| {
        format!(
            "{} {:.0} %",
            part.0,
            100.0 * part.1.as_secs_f64() / all.max(1e-9)
        )
    };
    let parts: Vec<String> = parts.iter().map(share).collect();
    format!(
        "time      {:.0} s{} on {} threads: {}",
        elapsed.as_secs_f64(),
        if resumed { " since it went on" } else { "" },
        rayon::current_num_threads(),
        parts.join(", ")
    )
}
