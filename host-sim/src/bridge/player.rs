//! MIDI bytes to wishes, and the controllers that are to be learnt.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use freshet::param::TABLE;

use super::log::Log;
use super::map_file;
use super::mapping::{CONTROLLERS, FINE, Mapping, Positions};
use super::midi::{Kind, Message, Parser};
use super::queue::Queue;

/// Parameters that wait for a controller, by their index.
#[derive(Clone, Debug, Default)]
pub struct Wanted(Arc<Mutex<VecDeque<usize>>>);

impl Wanted {
    /// One more.
    pub fn push(&self, index: usize) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push_back(index);
    }

    /// The one whose turn it is.
    pub fn first(&self) -> Option<usize> {
        let wanted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        wanted.front().copied()
    }

    fn pop(&self) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop_front();
    }
}

/// What becomes of the bytes of one MIDI input.
pub struct Player {
    parser: Parser,
    mapping: Mapping,
    positions: Positions,
    /// Where what is learnt is kept.
    file: Option<PathBuf>,
    wanted: Wanted,
    /// The controller that was learnt last: it is still moving.
    learnt: Option<(u8, u8)>,
    queue: Arc<Queue>,
    log: Arc<Log>,
}

impl Player {
    /// Plays by `mapping`; learns what is `wanted` into `file`.
    pub fn new(
        mapping: Mapping,
        file: Option<PathBuf>,
        wanted: Wanted,
        queue: Arc<Queue>,
        log: Arc<Log>,
    ) -> Self {
        Self {
            parser: Parser::default(),
            mapping,
            positions: Positions::default(),
            file,
            wanted,
            learnt: None,
            queue,
            log,
        }
    }

    /// Takes bytes as they come.
    pub fn feed(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(message) = self.parser.push(*byte) {
                self.message(message);
            }
        }
    }

    fn message(&mut self, message: Message) {
        if let Kind::Control(cc, _) = message.kind {
            self.learn(message.channel, cc);
        }
        match self.mapping.wishes(message, &mut self.positions) {
            Ok(wishes) if wishes.is_empty() => {}
            Ok(wishes) => {
                if self.queue.push(wishes, None) > 0 {
                    self.log
                        .complain("MIDI: too many at once; some were left out");
                }
            }
            Err(why) => self.log.complain(&format!("MIDI: {why}")),
        }
    }

    fn learn(&mut self, channel: u8, cc: u8) {
        let (Some(index), Some(file)) = (self.wanted.first(), &self.file) else {
            return;
        };
        // Commands to the instrument, and the banks that go before a program.
        let is_value = cc < CONTROLLERS && !matches!(cc, 0 | FINE);
        let is_still_moving = self
            .learnt
            .is_some_and(|(c, known)| c == channel && (known == cc || known + FINE == cc));
        if !is_value || is_still_moving {
            return;
        }
        self.wanted.pop();
        self.learnt = Some((channel, cc));
        let path = TABLE[index].path;
        match map_file::learn(file, channel, cc, index) {
            Ok(mapping) => {
                let shown = file.display();
                let also: Vec<&str> = (mapping.rules.iter())
                    .filter(|rule| rule.cc == cc && rule.param != index)
                    .filter(|rule| rule.channel.is_none_or(|own| own == channel))
                    .map(|rule| TABLE[rule.param].path)
                    .collect();
                let also = if also.is_empty() {
                    String::new()
                } else {
                    format!(" (it also moves {})", also.join(", "))
                };
                self.log.say(&format!(
                    "controller {cc} of channel {channel} moves {path}{also}; kept in {shown}"
                ));
                self.mapping = mapping;
            }
            Err(error) => self.log.say(&format!("{path} was not learnt: {error:#}")),
        }
        if let Some(next) = self.wanted.first() {
            self.log
                .say(&format!("move the controller for {}", TABLE[next].path));
        }
    }
}
