//! A sound texture Q(u, t): vortex sound over the speed of a flow and time, baked by the desk and read in place (VS §5).
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | magic `FTEX` |
//! | 4 | 2 | version |
//! | 6 | 1 | bytes of a sample: 1 or 2 |
//! | 7 | 1 | variants: receivers kept apart, at least 1 |
//! | 8 | 4 | rows, one a speed, at least 1 |
//! | 12 | 4 | f32: period of the loop of every row, s |
//! | 16 | 4 | length of the whole texture |
//! | 20 | 4 | CRC-32 (ISO-HDLC) of bytes 0–19 and of everything after this word |
//! | 24 | 16 a row | f32 speed, m/s, rising from row to row; f32 [`scale`](Row::scale); samples of a loop; offset of the first |
//!
//! At a row's offset lie its variants one after another, each a loop of as many signed samples. Numbers are
//! little-endian, nothing need be aligned. Each row has the rate that its bandwidth asks for, but all loops last equally
//! long: one phase, a fraction of the period, places a source in every row.
#![forbid(unsafe_code)]

use crate::bank;

/// The first four bytes.
pub const MAGIC: [u8; 4] = *b"FTEX";
/// The version this reader knows.
pub const VERSION: u16 = 1;
/// Bytes before the table of rows.
pub const HEADER: usize = 24;
/// Bytes of a row's entry in it.
pub const ENTRY: usize = 16;
/// Most rows.
pub const ROWS: usize = 64;
/// Most samples of a loop.
pub const SAMPLES: usize = 1 << 24;

/// Why bytes are not a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureError {
    /// The magic is missing: there is no texture here.
    NoTexture,
    /// Written by another version of freshet.
    Version(u16),
    /// The length in the header is more than there is, or too short for a texture.
    Length(u32),
    /// The checksum is wrong: damaged, or only written in part.
    Checksum,
    /// The header holds a number no texture has.
    Header,
    /// This row, from 0, has a number no row has, or lies outside the texture.
    Row(u32),
}

impl core::fmt::Display for TextureError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoTexture => f.write_str("no texture here (expected the magic FTEX)"),
            Self::Version(v) => write!(f, "a texture of version {v}, expected {VERSION}"),
            Self::Length(n) => write!(f, "a length of {n} bytes, more or less than there is"),
            Self::Checksum => f.write_str("the checksum is wrong: damaged, or written in part"),
            Self::Header => f.write_str("the header holds a number that no texture has"),
            Self::Row(row) => write!(f, "row {row} is wrong"),
        }
    }
}

impl core::error::Error for TextureError {}

/// A texture that has been checked through and through.
#[derive(Clone, Copy, Debug)]
pub struct Texture<'a> {
    bytes: &'a [u8],
    width: usize,
    variants: usize,
    rows: usize,
    seconds: f32,
}

/// The row of one speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<'a> {
    /// Mean speed of the flow, m/s.
    pub speed: f32,
    /// Pressure of one step of a sample, Pa at 1 m.
    pub scale: f32,
    width: usize,
    samples: usize,
    bytes: &'a [u8],
}

/// One loop of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples<'a> {
    /// Each is an `i8`.
    Bytes(&'a [u8]),
    /// Each is a little-endian `i16`.
    Words(&'a [[u8; 2]]),
}

impl<'a> Texture<'a> {
    /// Checks the texture that begins at the first of `bytes`; more may follow it.
    pub fn open(bytes: &'a [u8]) -> Result<Self, TextureError> {
        use TextureError::{Checksum, Header, Length, NoTexture, Version};
        if bytes.get(..4) != Some(&MAGIC) {
            return Err(NoTexture);
        }
        let head: &[u8; HEADER] = bytes.first_chunk().ok_or(NoTexture)?;
        let version = u16::from_le_bytes([head[4], head[5]]);
        if version != VERSION {
            return Err(Version(version));
        }
        let length = word(head, 16);
        let bytes = bytes
            .get(..length as usize)
            .filter(|bytes| bytes.len() >= HEADER)
            .ok_or(Length(length))?;
        if word(head, 20) != bank::checksum(&head[..20], &bytes[HEADER..]) {
            return Err(Checksum);
        }
        let texture = Self {
            bytes,
            width: usize::from(head[6]),
            variants: usize::from(head[7]),
            rows: word(head, 8) as usize,
            seconds: f32::from_bits(word(head, 12)),
        };
        let counts = (1..=2).contains(&texture.width)
            && texture.variants > 0
            && (1..=ROWS).contains(&texture.rows);
        if !counts || !is_positive(texture.seconds) {
            return Err(Header);
        }
        let mut last = 0.0;
        for i in 0..texture.rows {
            let row = texture
                .row(i)
                .filter(|row| is_positive(row.scale) && is_positive(row.speed) && row.speed > last);
            last = row.ok_or(TextureError::Row(i as u32))?.speed;
        }
        Ok(texture)
    }

    /// How many rows there are; at least one.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// How many receivers were kept apart; at least one.
    pub fn variants(&self) -> usize {
        self.variants
    }

    /// Period of every loop, s.
    pub fn seconds(&self) -> f32 {
        self.seconds
    }

    /// Row `index`, from 0, slowest first.
    pub fn row(&self, index: usize) -> Option<Row<'a>> {
        if index >= self.rows {
            return None;
        }
        let entry: &[u8; ENTRY] = self.bytes.get(HEADER + index * ENTRY..)?.first_chunk()?;
        let (samples, start) = (word(entry, 8) as usize, word(entry, 12) as usize);
        if !(1..=SAMPLES).contains(&samples) {
            return None;
        }
        // At most 2²⁴ · 255 · 2: no product of a texture that fits its bytes overflows.
        let length = samples
            .checked_mul(self.width)?
            .checked_mul(self.variants)?;
        Some(Row {
            speed: f32::from_bits(word(entry, 0)),
            scale: f32::from_bits(word(entry, 4)),
            width: self.width,
            samples,
            bytes: self.bytes.get(start..start.checked_add(length)?)?,
        })
    }
}

impl<'a> Row<'a> {
    /// Samples of a loop.
    pub fn len(&self) -> usize {
        self.samples
    }

    /// Never: a loop has a sample at least.
    pub fn is_empty(&self) -> bool {
        self.samples == 0
    }

    /// The loop of receiver `variant`, from 0.
    pub fn variant(&self, variant: usize) -> Option<Samples<'a>> {
        let size = self.samples * self.width;
        let start = variant.checked_mul(size)?;
        let bytes = self.bytes.get(start..start.checked_add(size)?)?;
        Some(match self.width {
            1 => Samples::Bytes(bytes),
            _ => Samples::Words(bytes.as_chunks().0),
        })
    }
}

impl Samples<'_> {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.len(),
            Self::Words(words) => words.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample `index`, in steps of the row's scale.
    pub fn get(&self, index: usize) -> Option<i32> {
        match self {
            Self::Bytes(bytes) => bytes.get(index).map(|byte| i32::from(*byte as i8)),
            Self::Words(words) => words
                .get(index)
                .map(|word| i32::from(i16::from_le_bytes(*word))),
        }
    }
}

fn is_positive(x: f32) -> bool {
    x.is_finite() && x > 0.0
}

/// The word at `at`, which lies inside.
fn word<const N: usize>(bytes: &[u8; N], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
