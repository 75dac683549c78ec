//! Replies that own what they say.

use freshet::protocol::{self, Reply, Slot};

/// Who is there.
#[derive(Clone, Debug, PartialEq)]
pub struct Hello {
    /// Version of freshet on the board.
    pub version: String,
    /// The board, as `render --board` calls it.
    pub board: String,
    /// True sample rate, Hz.
    pub rate: f32,
    /// Seed of the sound.
    pub seed: u64,
    /// See [`freshet::param::SCHEMA`].
    pub schema: u32,
    /// The frame from which on what is set now is heard.
    pub at: u64,
    /// The scene that plays.
    pub scene: String,
}

impl From<&protocol::Hello<'_>> for Hello {
    fn from(hello: &protocol::Hello<'_>) -> Self {
        Self {
            version: hello.version.to_owned(),
            board: hello.board.to_owned(),
            rate: hello.rate,
            seed: hello.seed,
            schema: hello.schema,
            at: hello.at,
            scene: hello.scene.to_owned(),
        }
    }
}

impl Hello {
    /// Reads the line that a board says at its start and in answer to `version`; none where it is another line.
    ///
    /// ```
    /// # use freshet_host::client::Hello;
    /// let line = "freshet version=0.1.0 board=f407 rate=48000 seed=7 schema=21f3a0c5 at=128 scene=brook";
    /// let hello = Hello::parse(line).unwrap();
    /// assert_eq!((hello.board.as_str(), hello.at), ("f407", 128));
    /// ```
    pub fn parse(line: &str) -> Option<Self> {
        let (words, scene) = line.strip_prefix("freshet ")?.split_once(" scene=")?;
        let word = |key: &str| {
            let mut words = words.split_ascii_whitespace();
            words.find_map(|word| word.strip_prefix(key)?.strip_prefix('='))
        };
        Some(Self {
            version: word("version")?.to_owned(),
            board: word("board")?.to_owned(),
            rate: word("rate")?.parse().ok()?,
            seed: word("seed")?.parse().ok()?,
            schema: u32::from_str_radix(word("schema")?, 16).ok()?,
            at: word("at")?.parse().ok()?,
            scene: scene.trim().to_owned(),
        })
    }
}

/// A parameter, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Stable number.
    pub id: u16,
    /// Name, such as `water.rate`.
    pub path: String,
    /// Unit; empty for plain numbers.
    pub unit: String,
    /// Lowest and highest value.
    pub range: (f32, f32),
    /// Value where a scene says nothing.
    pub default: f32,
    /// The lowest value above 0 of a logarithmic slider; none: linear.
    pub log: Option<f32>,
    /// Time a change takes, s.
    pub ramp: f32,
    /// Whether it takes whole numbers only.
    pub whole: bool,
    /// The names of its values from 0 on, where they have names.
    pub choices: Vec<String>,
    /// What it does.
    pub about: String,
    /// Where it is now.
    pub value: f32,
    /// Where it is in the settings stored last, if any were.
    pub stored: Option<f32>,
}

impl From<&protocol::Row<'_>> for Row {
    fn from(row: &protocol::Row<'_>) -> Self {
        Self {
            id: row.id,
            path: row.path.to_owned(),
            unit: row.unit.to_owned(),
            range: row.range,
            default: row.default,
            log: row.log,
            ramp: row.ramp,
            whole: row.whole,
            choices: row.choices.iter().map(|name| (*name).to_owned()).collect(),
            about: row.about.to_owned(),
            value: row.value,
            stored: row.stored,
        }
    }
}

/// A scene of the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneInfo {
    /// From 0.
    pub number: u16,
    /// Its name.
    pub name: String,
    /// Whether it plays.
    pub plays: bool,
}

impl SceneInfo {
    pub(super) fn new(reply: &Reply<'_>) -> Option<Self> {
        match reply {
            Reply::Scene {
                number,
                name,
                plays,
            } => Some(Self {
                number: *number,
                name: (*name).to_owned(),
                plays: *plays,
            }),
            _ => None,
        }
    }
}

/// A preset on the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PresetInfo {
    /// Where it is kept; 0: the settings stored last.
    pub slot: Slot,
    /// Its name; may be empty.
    pub name: String,
    /// The scene it is over.
    pub scene: String,
}

impl PresetInfo {
    pub(super) fn new(reply: &Reply<'_>) -> Option<Self> {
        match reply {
            Reply::Preset { slot, name, scene } => Some(Self {
                slot: *slot,
                name: (*name).to_owned(),
                scene: (*scene).to_owned(),
            }),
            _ => None,
        }
    }
}

/// How things stand; owns what [`protocol::Status`] borrows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    numbers: protocol::Status<'static>,
    cause: String,
    panic: String,
}

impl Report {
    /// All of it: counters, load, faults. Its `Display` is what the command `status` says.
    pub fn status(&self) -> protocol::Status<'_> {
        protocol::Status {
            cause: &self.cause,
            panic: &self.panic,
            ..self.numbers
        }
    }
}

impl From<&protocol::Status<'_>> for Report {
    fn from(status: &protocol::Status<'_>) -> Self {
        Self {
            numbers: protocol::Status {
                cause: "",
                panic: "",
                ..*status
            },
            cause: status.cause.to_owned(),
            panic: status.panic.to_owned(),
        }
    }
}

/// Something that a board says unasked.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// How things stand, as [`Client::subscribe`](super::Client::subscribe) asked for.
    Status(Report),
    /// The board has started anew: nothing is as it was, and no report comes until it is asked for again.
    Started(Hello),
    /// Another line of text.
    Line(String),
}
