//! Talking to a board over its serial line.

use std::time::Duration;

use emulated_board::{Board, Setup};
use freshet::scene::Scene;

use super::board;

pub const SECOND: Duration = Duration::from_secs(1);
pub const MS: Duration = Duration::from_millis(1);

/// A board and who talks to it.
pub struct Talk {
    /// The board.
    pub board: Board,
    /// What it said and was not taken yet.
    pub heard: Vec<u8>,
}

impl Talk {
    /// A board that plays the first of `scenes`, and has said who it is.
    pub fn new(scenes: &[(&str, Scene)], seed: u64, setup: Setup) -> Self {
        let mut talk = Self {
            board: board(scenes, seed, setup),
            heard: Vec::new(),
        };
        talk.start();
        talk
    }

    /// Waits for the greeting.
    pub fn start(&mut self) {
        let greeting = self.wait(2 * SECOND, |line| line.starts_with("freshet "));
        let last = greeting.last().expect("it says something");
        assert!(last.contains("board=f407"), "{greeting:?}");
    }

    /// Takes the power away and gives it back.
    pub fn restart(&mut self) {
        self.board.power_cycle().expect("it starts");
        self.board.serial_take();
        self.heard.clear();
        self.start();
    }

    /// What is said until a line is the last one.
    pub fn wait(&mut self, limit: Duration, last: impl Fn(&str) -> bool) -> Vec<String> {
        let mut lines = Vec::new();
        let begun = self.board.now();
        loop {
            self.heard.extend(self.board.serial_take());
            while let Some(end) = self.heard.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.heard.drain(..=end).collect();
                let line = std::str::from_utf8(&line[..end]).expect("text").to_owned();
                let done = last(&line);
                lines.push(line);
                if done {
                    return lines;
                }
            }
            assert!(self.board.now() - begun < limit, "only {lines:?}");
            self.board.run(MS).expect("it runs");
        }
    }

    pub fn send(&mut self, line: &str) {
        (self.board.serial_send(format!("{line}\n").as_bytes())).expect("sent");
    }

    /// Asks, and waits for all of the answer.
    pub fn ask(&mut self, line: &str) -> Vec<String> {
        self.send(line);
        self.wait(3 * SECOND, |line| {
            line.starts_with("ok ") || line.starts_with("error ")
        })
    }

    /// Asks, and takes all that is said until nothing more is.
    pub fn ask_all(&mut self, line: &str) -> String {
        const QUIET: Duration = Duration::from_millis(100);
        self.send(line);
        let mut said = Vec::new();
        let mut since = self.board.now();
        loop {
            self.board.run(MS).expect("it runs");
            let more = self.board.serial_take();
            if !more.is_empty() {
                said.extend(more);
                since = self.board.now();
            }
            let lines = said.split(|byte| *byte == b'\n');
            let pauses = lines
                .rev()
                .find(|line| !line.is_empty())
                .is_some_and(|line| line.starts_with(b"pause of"));
            if self.board.now() - since > if pauses { 2 * SECOND } else { QUIET } {
                return String::from_utf8(said).expect("text");
            }
        }
    }

    /// A counter of the status.
    pub fn count(&mut self, name: &str) -> f64 {
        let lines = self.ask("status");
        let start = format!("{name} = ");
        let line = lines.iter().find_map(|line| line.strip_prefix(&start));
        let number = line.and_then(|line| line.split(' ').next());
        number
            .and_then(|number| number.parse().ok())
            .unwrap_or_else(|| panic!("{name}: {lines:?}"))
    }
}
