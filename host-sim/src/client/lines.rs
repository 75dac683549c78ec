//! The other door: lines of text over a link.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::{Error, Hello, Link};

/// Longest line that is kept, bytes.
const LONGEST: usize = 4096;
/// Silence after which nothing more belongs to what was said before.
const SILENCE: Duration = Duration::from_millis(60);
/// How each frame begins, see [`freshet::protocol`].
const MARK: u8 = 1;

/// Lines to a board and back, for what speaks no frames: recordings, and boards of another version.
pub struct Lines {
    link: Box<dyn Link>,
    line: Vec<u8>,
    found: VecDeque<String>,
}

impl Lines {
    /// On a link; what was said before is let go.
    pub fn over(link: impl Link + 'static) -> Result<Self, Error> {
        let mut lines = Self {
            link: Box::new(link),
            line: Vec::new(),
            found: VecDeque::new(),
        };
        // Ends whatever another program has left there half said.
        lines.write(b"\0")?;
        while lines.next(SILENCE)?.is_some() {}
        lines.line.clear();
        Ok(lines)
    }

    /// What the port is called.
    pub fn port(&self) -> &str {
        self.link.name()
    }

    /// Says a line.
    pub fn say(&mut self, line: &str) -> Result<(), Error> {
        self.write(line.trim().as_bytes())?;
        self.write(b"\n")
    }

    /// The next line, without its end; none where none comes within `timeout`.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<String>, Error> {
        let until = Instant::now() + timeout;
        loop {
            if let Some(line) = self.found.pop_front() {
                return Ok(Some(line));
            }
            let mut buffer = [0; 1024];
            let left = until.saturating_duration_since(Instant::now());
            let read = self.link.read(&mut buffer, left);
            let count = read.map_err(|error| self.gone(&error))?;
            for byte in &buffer[..count] {
                self.push(*byte);
            }
            if self.found.is_empty() && Instant::now() >= until {
                return Ok(None);
            }
        }
    }

    /// Says a line and hands each line of the answer to `each`; true where it ends with `ok`.
    ///
    /// # Errors
    /// [`Error::Timeout`] where the answer has no end, [`Error::Gone`].
    pub fn ask(
        &mut self,
        line: &str,
        timeout: Duration,
        mut each: impl FnMut(&str),
    ) -> Result<bool, Error> {
        self.say(line)?;
        let (mut within, mut heard, mut refused) = (timeout, 0, false);
        loop {
            // After a refusal nothing may come, or more refusals, or what was done nevertheless.
            let wait = if refused { SILENCE } else { within };
            match self.next(wait)? {
                None if refused => return Ok(false),
                None => {
                    return Err(Error::Timeout {
                        port: self.port().to_owned(),
                        within,
                        heard,
                    });
                }
                Some(line) => {
                    heard += line.len();
                    each(&line);
                    if line == "ok" || line.starts_with("ok ") {
                        return Ok(true);
                    }
                    refused |= line.starts_with("error ");
                    if let Some(ms) = pause(&line) {
                        within = timeout + 4 * Duration::from_millis(ms.into());
                    }
                }
            }
        }
    }

    /// Starts the board again; returns the lines with which it does: what it plays, and its greeting.
    pub fn restart(&mut self, timeout: Duration) -> Result<Vec<String>, Error> {
        self.say("restart")?;
        let mut lines = Vec::new();
        let until = Instant::now() + timeout;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let Some(line) = self.next(left)? else {
                return Err(Error::Timeout {
                    port: self.port().to_owned(),
                    within: timeout,
                    heard: lines.iter().map(String::len).sum(),
                });
            };
            if line.starts_with("ok ") {
                lines.clear();
                continue;
            }
            if let Some(words) = line.strip_prefix("error ") {
                return Err(Error::Refused(words.to_owned()));
            }
            let last = Hello::parse(&line).is_some();
            lines.push(line);
            if last {
                return Ok(lines);
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let written = self.link.write(bytes);
        written.map_err(|error| self.gone(&error))
    }

    fn push(&mut self, byte: u8) {
        match (byte, self.line.first()) {
            // The end of a frame, or of noise.
            (0, _) => self.line.clear(),
            (b'\n', first) if first != Some(&MARK) => {
                let line = String::from_utf8_lossy(&self.line);
                let line = line.trim_end_matches('\r');
                if !line.is_empty() {
                    self.found.push_back(line.to_owned());
                }
                self.line.clear();
            }
            _ if self.line.len() == LONGEST => self.line.clear(),
            _ => self.line.push(byte),
        }
    }

    fn gone(&self, error: &std::io::Error) -> Error {
        Error::Gone {
            port: self.port().to_owned(),
            reason: error.to_string(),
        }
    }
}

/// How long the sound is said to pause, ms.
fn pause(line: &str) -> Option<u32> {
    let (ms, _) = line
        .strip_prefix("pause of about ")?
        .split_once(" ms at ")?;
    ms.parse().ok()
}
