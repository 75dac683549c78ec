//! `freshet record`: a session with a board, from its start, as a file that `freshet replay` plays again.

use std::fs::File;
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Result;
use clap::Args;

use crate::talk::Port;
use crate::wav::write_error;

/// Time a board may take to start.
const START: Duration = Duration::from_secs(10);
/// How often the keyboard is looked at.
const LOOK: Duration = Duration::from_millis(10);
/// Silence after the last line, by which all is said.
const SILENCE: Duration = Duration::from_secs(1);

/// What `freshet record` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// Where the board is
    #[command(flatten)]
    pub port: Port,
    /// Where the session goes
    pub file: PathBuf,
}

/// Starts the board again, then passes lines from the standard input to it until they end or until `stop`. What comes
/// back goes to the file and to `show`.
pub fn record(request: &Request, stop: &AtomicBool, mut show: impl FnMut(&str)) -> Result<()> {
    let mut lines = request.port.lines()?;
    let start = lines.restart(START)?;
    let mut file = Recording::create(&request.file)?;
    for line in &start {
        file.write(line)?;
        show(line);
    }
    let typed = typed();
    let mut ended: Option<Instant> = None;
    while !stop.load(Ordering::Relaxed) {
        if let Some(line) = lines.next(LOOK)? {
            file.write(&line)?;
            show(&line);
            ended = ended.map(|_| Instant::now());
            continue;
        }
        match (typed.try_recv(), ended) {
            (Ok(line), _) => lines.say(&line)?,
            (Err(TryRecvError::Empty), _) => {}
            (Err(TryRecvError::Disconnected), None) => ended = Some(Instant::now()),
            (Err(TryRecvError::Disconnected), Some(since)) => {
                if since.elapsed() > SILENCE {
                    break;
                }
            }
        }
    }
    Ok(())
}

/// Lines of the standard input, until it ends.
fn typed() -> Receiver<String> {
    let (send, receive) = channel();
    thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if send.send(line).is_err() {
                break;
            }
        }
    });
    receive
}

/// A file to which each line goes at once.
struct Recording<'a> {
    path: &'a Path,
    file: File,
}

impl<'a> Recording<'a> {
    fn create(path: &'a Path) -> Result<Self> {
        let file = File::create(path).map_err(|error| write_error(path.display(), &error))?;
        Ok(Self { path, file })
    }

    fn write(&mut self, line: &str) -> Result<()> {
        (self.file.write_all(format!("{line}\n").as_bytes()))
            .map_err(|error| write_error(self.path.display(), &error))
    }
}
