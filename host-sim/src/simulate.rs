//! `freshet simulate`: a board's twin behind a pseudo-terminal, in real time.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
#[cfg(unix)]
use std::sync::{Arc, Mutex};

use anyhow::Result;
use clap::Args;

use crate::board::Board;
use crate::source::Source;
use crate::twin::{Kept, Setup, Twin};
use crate::{built_in, keep};

/// What `freshet simulate` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// Whose twin
    #[arg(long, value_enum, default_value = "f407")]
    pub board: Board,
    /// What it plays at the start, where no `boot` was kept
    #[arg(long, value_name = "NAME", default_value = "brook")]
    pub scene: String,
    /// The same seed gives the same sound
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Keep presets in this file; without it they are gone with the twin
    #[arg(long, value_name = "FILE")]
    pub keep: Option<PathBuf>,
    /// Play it on the sound card (with the feature `play`)
    #[arg(long)]
    pub play: bool,
}

impl Request {
    /// The twin that is asked for, at `rate` Hz.
    pub fn twin(&self, rate: u32) -> Result<Twin> {
        let scenes = built_in::named()?;
        let wanted = Source::built_in(&self.scene)?.name;
        let first = scenes.iter().position(|(name, _)| *name == wanted);
        let kept = self.keep.as_deref().map(keep::load).transpose()?;
        if let (Some(path), Some(kept)) = (&self.keep, &kept) {
            // What cannot be written is found out before anything is to be kept.
            keep::save(path, kept)?;
        }
        Ok(Twin::with(Setup {
            board: self.board,
            rate,
            seed: self.seed,
            scenes,
            first: first.unwrap_or(0) as u16,
            kept: kept.unwrap_or_default(),
            output: freshet::mix::Output::Bits24,
        }))
    }
}

/// Saves what a twin keeps, when that changes.
pub struct Keeper<'a> {
    path: Option<&'a Path>,
    saved: Kept,
}

impl<'a> Keeper<'a> {
    /// For what `twin` keeps in the file of `request`, if there is one.
    pub fn new(request: &'a Request, twin: &Twin) -> Self {
        Self {
            path: request.keep.as_deref(),
            saved: twin.kept().clone(),
        }
    }

    /// Saves it where it has changed.
    pub fn look(&mut self, twin: &Twin) -> Result<()> {
        match self.path {
            Some(path) if *twin.kept() != self.saved => {
                self.saved.clone_from(twin.kept());
                keep::save(path, &self.saved)
            }
            _ => Ok(()),
        }
    }
}

/// Runs a twin until `stop`; `tell` is told the path of its port, and then what else a person should know.
#[cfg(unix)]
pub fn simulate(
    request: &Request,
    stop: &AtomicBool,
    mut tell: impl FnMut(Told<'_>) -> Result<()>,
) -> Result<()> {
    use std::sync::PoisonError;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    use freshet::{Frame, TICK};

    use crate::pty::Pty;

    /// Ticks rendered before the line is looked at again.
    const STRETCH: usize = 16;
    /// Time by which the sound may be late before it is let go.
    const LATE: Duration = Duration::from_millis(500);

    let mut pty = Pty::open()?;
    let (twin, card) = voice(request)?;
    let mut keeper = Keeper::new(request, &lock(&twin));
    tell(Told::Port(pty.path()))?;
    let tick = lock(&twin).tick_time();
    let mut due = Instant::now();
    let mut late = false;
    let mut waiting = Vec::new();
    let mut buffer = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        if let Some(card) = &card {
            card.check()?;
        }
        let left = due.saturating_duration_since(Instant::now()).min(tick);
        let count = pty.read(&mut buffer, left)?;
        let mut twin = twin.lock().unwrap_or_else(PoisonError::into_inner);
        twin.receive(&buffer[..count]);
        if card.is_some() {
            due = Instant::now() + tick;
        } else {
            for _ in 0..STRETCH {
                if due > Instant::now() {
                    break;
                }
                twin.render(&mut [Frame::ZERO; TICK]);
                due += tick;
            }
            if due.elapsed() > LATE {
                due = Instant::now();
                if !std::mem::replace(&mut late, true) {
                    tell(Told::Late)?;
                }
            }
        }
        if waiting.is_empty() {
            waiting.resize(buffer.len(), 0);
            let count = twin.take_into(&mut waiting);
            waiting.truncate(count);
        }
        keeper.look(&twin)?;
        drop(twin);
        // What does not fit waits, and what does not fit then the twin counts as dropped.
        let count = pty.write(&waiting)?;
        waiting.drain(..count);
    }
    Ok(())
}

/// What a person should know.
#[derive(Clone, Copy, Debug)]
pub enum Told<'a> {
    /// It runs; the path of its port.
    Port(&'a str),
    /// This machine cannot keep up.
    Late,
}

/// Says that it cannot be done here.
#[cfg(not(unix))]
pub fn simulate(
    _request: &Request,
    _stop: &AtomicBool,
    _tell: impl FnMut(Told<'_>) -> Result<()>,
) -> Result<()> {
    anyhow::bail!(
        "this system has no pseudo-terminals: `freshet simulate` runs on Linux and macOS (on Windows in WSL)"
    )
}

#[cfg(unix)]
fn lock(twin: &Mutex<Twin>) -> std::sync::MutexGuard<'_, Twin> {
    twin.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The twin, and the sound card that plays it where that is wanted.
#[cfg(all(unix, feature = "play"))]
fn voice(request: &Request) -> Result<(Arc<Mutex<Twin>>, Option<crate::play::Playing>)> {
    if !request.play {
        return Ok((Arc::new(Mutex::new(request.twin(RATE)?)), None));
    }
    let card = crate::play::Card::find()?;
    let twin = Arc::new(Mutex::new(request.twin(card.rate())?));
    let source = Arc::clone(&twin);
    let playing = card.play(move |out| lock(&source).render(out))?;
    Ok((twin, Some(playing)))
}

/// Nothing plays here.
#[cfg(all(unix, not(feature = "play")))]
enum Playing {}

#[cfg(all(unix, not(feature = "play")))]
impl Playing {
    fn check(&self) -> Result<()> {
        match *self {}
    }
}

#[cfg(all(unix, not(feature = "play")))]
fn voice(request: &Request) -> Result<(Arc<Mutex<Twin>>, Option<Playing>)> {
    if request.play {
        anyhow::bail!(
            "this freshet was built without a sound card; build it with `cargo run --release -p freshet-host --features play -- simulate --play` \
             (on Debian and Ubuntu that needs the package libasound2-dev)"
        );
    }
    Ok((Arc::new(Mutex::new(request.twin(RATE)?)), None))
}

/// Sample rate of a board, Hz.
#[cfg(unix)]
const RATE: u32 = 48_000;
