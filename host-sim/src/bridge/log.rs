//! Messages for people, and never more of them than can be read.

use std::io::Write;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Most lines about inputs in a second.
const LINES: u32 = 10;

/// So many in a second, no more.
#[derive(Debug)]
pub struct Limit {
    most: u32,
    left: u32,
    since: Option<Instant>,
    /// How many there were too many.
    over: u64,
}

impl Limit {
    /// `most` a second.
    pub fn new(most: u32) -> Self {
        Self {
            most,
            left: most,
            since: None,
            over: 0,
        }
    }

    /// Whether one more may be; where it may, how many before it might not.
    pub fn take(&mut self) -> Option<u64> {
        let now = Instant::now();
        let old = |since: Instant| now.duration_since(since) >= Duration::from_secs(1);
        if self.since.is_none_or(old) {
            (self.since, self.left) = (Some(now), self.most);
        }
        if self.left == 0 {
            self.over += 1;
            return None;
        }
        self.left -= 1;
        Some(std::mem::take(&mut self.over))
    }
}

type Sink = Box<dyn FnMut(&str) + Send>;

/// Where messages go.
pub struct Log {
    inner: Mutex<(Limit, Sink)>,
}

impl Log {
    /// To the standard error, whether or not anybody reads it.
    pub fn stderr() -> Self {
        Self::new(|line| {
            let _ = writeln!(std::io::stderr(), "{line}");
        })
    }

    /// To `sink`, a line each.
    pub fn new(sink: impl FnMut(&str) + Send + 'static) -> Self {
        Self {
            inner: Mutex::new((Limit::new(LINES), Box::new(sink))),
        }
    }

    /// What always has to be said.
    pub fn say(&self, line: &str) {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        (inner.1)(&plain(line));
    }

    /// What inputs can cause as often as they like.
    pub fn complain(&self, line: &str) {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        match inner.0.take() {
            None => {}
            Some(0) => (inner.1)(&plain(line)),
            Some(over) => {
                (inner.1)(&format!("({over} more like these were left out)"));
                (inner.1)(&plain(line));
            }
        }
    }
}

/// What came from outside does not steer the terminal.
fn plain(line: &str) -> String {
    line.chars()
        .map(|c| if c.is_control() { '·' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_flood_is_a_few_lines() {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&lines);
        let log = Log::new(move |line| sink.lock().unwrap().push(line.to_owned()));
        for _ in 0..1000 {
            log.complain("no such\x1b[2J address");
        }
        let lines = lines.lock().unwrap();
        assert!(lines.len() <= 2 * LINES as usize, "{}", lines.len());
        assert_eq!(lines[0], "no such·[2J address");
    }
}
