//! Finds lines and frames in a stream of bytes, whatever else is in it.

use heapless::Vec;

use super::frame::FRAME_MAX;

/// Longest line, bytes.
pub const LINE_MAX: usize = 256;
const LONGEST: usize = if LINE_MAX > FRAME_MAX {
    LINE_MAX
} else {
    FRAME_MAX
};

/// How each frame begins: COBS makes that of the two zeros at the head of its payload, and no line begins so.
const MARK: u8 = 1;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item<'a> {
    /// A line of text without its end; never empty.
    Line(&'a str),
    /// The bytes between two delimiters, still in COBS.
    Frame(&'a [u8]),
    /// Neither: too long, or a line with something else in it than text.
    Garbage,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Kind {
    /// Nothing yet.
    #[default]
    Empty,
    Line,
    Frame,
    /// To be thrown away, up to the next end of a line or frame.
    Garbage,
}

/// Collects bytes until a delimiter. Lines end with a line feed, a carriage return or both; frames with a zero. A zero
/// ends anything; after a delimiter all begins anew.
#[derive(Clone, Debug, Default)]
pub struct Splitter {
    kind: Kind,
    bytes: Vec<u8, LONGEST>,
    /// The item was given out; its bytes go with the next one.
    given: bool,
}

impl Splitter {
    /// At the beginning of a line.
    pub const fn new() -> Self {
        Self {
            kind: Kind::Empty,
            bytes: Vec::new(),
            given: false,
        }
    }

    /// Takes a byte; with the last one of an item returns it.
    pub fn push(&mut self, byte: u8) -> Option<Item<'_>> {
        if core::mem::take(&mut self.given) {
            self.bytes.clear();
        }
        match (self.kind, byte) {
            (_, 0) => return self.end(),
            (Kind::Empty, MARK) => self.kind = Kind::Frame,
            // Told from a line that begins with noise by its second byte.
            (Kind::Frame, _) if self.bytes.len() == 1 && byte != MARK => {
                self.kind = Kind::Garbage;
                return self.push(byte);
            }
            (Kind::Frame, _) => {}
            (_, b'\n' | b'\r') => return self.end(),
            (Kind::Empty | Kind::Line, b' '..=b'~' | b'\t') => self.kind = Kind::Line,
            // What a terminal's keys send to correct a typing error.
            (Kind::Line, 0x08 | 0x7f) => {
                self.bytes.pop();
                return None;
            }
            (Kind::Empty | Kind::Line | Kind::Garbage, _) => self.kind = Kind::Garbage,
        }
        if self.kind == Kind::Garbage || self.bytes.push(byte).is_err() {
            self.kind = Kind::Garbage;
        }
        None
    }

    /// The line has been silent for so long that nothing more belongs to a frame begun before.
    pub fn pause(&mut self) {
        if self.kind == Kind::Frame {
            self.kind = Kind::Empty;
            self.bytes.clear();
        }
    }

    fn end(&mut self) -> Option<Item<'_>> {
        self.given = true;
        match core::mem::take(&mut self.kind) {
            Kind::Empty => None,
            Kind::Frame => Some(Item::Frame(&self.bytes)),
            // A zero at the end of a line is as good as a line feed; bytes are ASCII.
            Kind::Line => match core::str::from_utf8(&self.bytes).map(str::trim) {
                Ok("") => None,
                Ok(line) => Some(Item::Line(line)),
                Err(_) => Some(Item::Garbage),
            },
            Kind::Garbage => Some(Item::Garbage),
        }
    }
}
