//! What can be rendered: a scene by name, a scene file, or a file of bubble events.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use freshet::bubble::Bubble;
use freshet::param;
use freshet::voices::{Pitch, Strike};

use crate::bubble_events::{BubbleEvent, BubbleEvents};
use crate::built_in::{self, SCENES};
use crate::scene_file::{SceneFile, nearest, put};

/// Something to render.
#[derive(Clone, Debug)]
pub struct Source {
    /// Short name, for output files and titles.
    pub name: String,
    /// The file it was read from; none for a scene that travels with the command.
    pub path: Option<PathBuf>,
    /// The scene; for a file of events one that makes no bubble of its own.
    pub scene: SceneFile,
    /// Where the events are.
    pub events: Option<EventFile>,
}

/// A checked file of bubble events.
#[derive(Clone, Debug)]
pub struct EventFile {
    path: PathBuf,
    /// Rows.
    pub count: u64,
    /// When the last bubble has rung out, s.
    pub end: f64,
}

impl Source {
    /// Finds what `name` means: a scene that travels with the command, a `.toml` or a `.csv`.
    pub fn find(name: &str) -> Result<Self> {
        Self::find_until(name, &AtomicBool::new(false))
    }

    /// The same; `stop` ends the reading of a long file of events early.
    pub fn find_until(name: &str, stop: &AtomicBool) -> Result<Self> {
        let path = Path::new(name);
        let stem = || {
            path.file_stem()
                .map_or(name.into(), |stem| stem.to_string_lossy())
        };
        let is = |kind: &str| {
            path.extension()
                .is_some_and(|end| end.eq_ignore_ascii_case(kind))
        };
        if is("toml") {
            Ok(Self {
                name: stem().into_owned(),
                path: Some(path.to_owned()),
                scene: SceneFile::open(path)?,
                events: None,
            })
        } else if is("csv") {
            Self::events(stem().into_owned(), path, stop)
        } else {
            Self::built_in(name)
        }
    }

    /// A scene that travels with the command.
    pub fn built_in(name: &str) -> Result<Self> {
        let plain = name.to_lowercase().replace([' ', '_'], "-");
        match built_in::scene(&plain) {
            Some(scene) => Ok(Self {
                name: plain,
                path: None,
                scene: scene?,
                events: None,
            }),
            None if Path::new(name).exists() => {
                bail!(
                    "{name}: expected a scene (.toml), bubble events (.csv) or bubble tracks (.txt, .xz)"
                )
            }
            None => match nearest(&plain, SCENES.iter().map(|scene| scene.0)) {
                Some(near) => {
                    bail!("no scene `{name}`; did you mean `{near}`? (`freshet list` shows all)")
                }
                None => bail!(
                    "no scene `{name}` (`freshet list` shows all; files end in .toml or .csv)"
                ),
            },
        }
    }

    /// A file of bubble events, read once through so that a fault is found before anything is written.
    fn events(name: String, path: &Path, stop: &AtomicBool) -> Result<Self> {
        // A pipe has nothing left for the second time.
        if fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir()) {
            bail!(
                "cannot read {}: expected a file on the disk, for it is read twice (save it there first)",
                path.display()
            );
        }
        let mut file = EventFile {
            path: path.to_owned(),
            count: 0,
            end: 0.0,
        };
        for event in BubbleEvents::open(path)? {
            let event = event?;
            if stop.load(Ordering::Relaxed) {
                break;
            }
            file.count += 1;
            file.end = file.end.max(event.time + ring_time(event.radius));
        }
        let mut scene = SceneFile {
            title: name.clone(),
            ..SceneFile::default()
        };
        put(&mut scene.scene, param::RATE, 0.0);
        Ok(Self {
            name,
            path: Some(path.to_owned()),
            scene,
            events: Some(file),
        })
    }
}

impl EventFile {
    /// The events as strikes at `rate` Hz, in order of time.
    pub fn strikes(&self, rate: u32) -> Result<Strikes> {
        Ok(Strikes {
            events: BubbleEvents::open(&self.path)?,
            next: None,
            rate: f64::from(rate),
        })
    }
}

/// Time until a bubble of `radius` metres is 103 dB down, s.
fn ring_time(radius: f64) -> f64 {
    f64::ln(141_000.0) / Bubble::new(radius).beta
}

/// A stream of strikes out of a file.
pub struct Strikes {
    events: BubbleEvents,
    next: Option<BubbleEvent>,
    rate: f64,
}

impl Strikes {
    /// The next strike of those born before frame `end`, counted from frame `start`.
    pub fn next_before(&mut self, start: u64, end: u64) -> Result<Option<Strike>> {
        if self.next.is_none() {
            self.next = self
                .events
                .next()
                .transpose()
                .context("the file changed while it was read")?;
        }
        let Some(event) = &self.next else {
            return Ok(None);
        };
        let at = event.time * self.rate;
        if at >= end as f64 {
            return Ok(None);
        }
        let gain = (event.amplitude * f64::from(1 << 28)).round();
        let pitch = Pitch::new(event.radius as f32, event.rise_factor as f32, self.rate);
        let strike = Strike::new(pitch, at - start as f64, [gain as i32; 2]);
        self.next = None;
        Ok(Some(strike))
    }
}
