//! A bank: what the desk prepares and the board keeps in flash, read in place and never trusted.
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | magic `FSHT` |
//! | 4 | 2 | version |
//! | 6 | 2 | number of sections |
//! | 8 | 4 | length of the whole bank |
//! | 12 | 4 | CRC-32 (ISO-HDLC) of bytes 0–11 and of everything after this word |
//! | 16 | 12 a section | its kind, its offset in the bank, its length |
//!
//! Numbers are little-endian. Sections: 1 is the [`Boot`] record, 2 the scenes as [`SceneRecord`]s one after another;
//! both in postcard. Kinds a reader does not know are left alone.

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::param;
use crate::scene::{CURVES, IntensityCurve, POINTS, Scene, VALUES};

/// The first four bytes.
pub const MAGIC: [u8; 4] = *b"FSHT";
/// The version this reader knows.
pub const VERSION: u16 = 1;
/// Bytes before the table of sections.
pub const HEADER: usize = 16;
/// Bytes of a section's row.
pub const ROW: usize = 12;
/// The section that holds the [`Boot`] record.
pub const BOOT: u32 = 1;
/// The section that holds the scenes.
pub const SCENES: u32 = 2;
/// Longest name of a scene, bytes.
pub const NAME: usize = 32;

/// By a table of 1 kB: bit by bit would be eight times slower at boot.
static CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// What a board does when it is switched on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Boot {
    /// Index of the scene.
    pub scene: u16,
    /// Seed of its sound; none: the chip's own number, so that no two boxes sound alike.
    pub seed: Option<u64>,
}

/// A scene as a bank holds it: parameters by their stable ids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord<'a> {
    /// Name on the command line.
    pub name: &'a str,
    /// `(id, value)`.
    pub values: Vec<(u16, f32), VALUES>,
    /// `(id, points)`.
    pub curves: Vec<CurveRecord, CURVES>,
}

/// What the intensity moves: a parameter's id and its points `(intensity, value)`.
pub type CurveRecord = (u16, Vec<(f32, f32), POINTS>);

/// Why bytes are not a bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BankError {
    /// The magic is missing: there is no bank here.
    NoBank,
    /// Written by another version of freshet.
    Version(u16),
    /// The length in the header is not that of a bank, or more than there is.
    Length(u32),
    /// The checksum is wrong: damaged, or only written in part.
    Checksum,
    /// This section lies outside the bank.
    Section(u32),
    /// The boot record cannot be read, or names a scene that is not there.
    Boot,
    /// This scene, from 0, cannot be read.
    Scene(u16),
    /// This scene, from 0, has a parameter or a value that this version does not know.
    Param(u16),
    /// There is no scene.
    Empty,
}

impl core::fmt::Display for BankError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoBank => f.write_str("no bank here (expected the magic FSHT)"),
            Self::Version(v) => write!(f, "a bank of version {v}, expected {VERSION}"),
            Self::Length(n) => write!(f, "a length of {n} bytes, more or less than there is"),
            Self::Checksum => f.write_str("the checksum is wrong: damaged, or written in part"),
            Self::Section(kind) => write!(f, "section {kind} lies outside the bank"),
            Self::Boot => f.write_str("the boot record is wrong"),
            Self::Scene(i) => write!(f, "scene {i} cannot be read"),
            Self::Param(i) => write!(f, "scene {i} has a parameter or value unknown here"),
            Self::Empty => f.write_str("no scene in the bank"),
        }
    }
}

impl core::error::Error for BankError {}

/// A bank that has been checked through and through; its scenes are decoded when they are asked for.
#[derive(Clone, Copy, Debug)]
pub struct Bank<'a> {
    scenes: &'a [u8],
    count: u16,
    boot: Boot,
}

impl<'a> Bank<'a> {
    /// Checks the bank that begins at the first of `bytes`; more may follow it.
    pub fn open(bytes: &'a [u8]) -> Result<Self, BankError> {
        let bytes = whole(bytes)?;
        let boot = section(bytes, BOOT)?.map_or(Ok(Boot::default()), |bytes| {
            postcard::from_bytes(bytes).map_err(|_| BankError::Boot)
        })?;
        let scenes = section(bytes, SCENES)?.unwrap_or(&[]);
        let mut count = 0;
        let mut rest = scenes;
        while !rest.is_empty() {
            (_, rest) = take_scene(rest, count)?;
            count = count.checked_add(1).ok_or(BankError::Scene(count))?;
        }
        if count == 0 {
            return Err(BankError::Empty);
        }
        if boot.scene >= count {
            return Err(BankError::Boot);
        }
        Ok(Self {
            scenes,
            count,
            boot,
        })
    }

    /// What to do when switched on.
    pub fn boot(&self) -> Boot {
        self.boot
    }

    /// How many scenes there are; at least one.
    pub fn scenes(&self) -> u16 {
        self.count
    }

    /// Name and scene of number `index`, from 0.
    pub fn scene(&self, index: u16) -> Option<(&'a str, Scene)> {
        let mut rest = self.scenes;
        for i in 0..self.count {
            let (scene, after) = take_scene(rest, i).ok()?;
            if i == index {
                return Some(scene);
            }
            rest = after;
        }
        None
    }
}

/// The CRC of a bank whose header begins `head` (bytes 0–11) and goes on after the checksum with `body`.
pub fn checksum(head: &[u8], body: &[u8]) -> u32 {
    let mut digest = CRC.digest();
    digest.update(head);
    digest.update(body);
    digest.finalize()
}

/// The bytes of the bank itself, its header and checksum checked.
fn whole(bytes: &[u8]) -> Result<&[u8], BankError> {
    if bytes.get(..4) != Some(&MAGIC) {
        return Err(BankError::NoBank);
    }
    let version = u16_at(bytes, 4).ok_or(BankError::NoBank)?;
    if version != VERSION {
        return Err(BankError::Version(version));
    }
    let length = u32_at(bytes, 8).ok_or(BankError::NoBank)?;
    let bytes = bytes
        .get(..length as usize)
        .filter(|bytes| bytes.len() >= HEADER)
        .ok_or(BankError::Length(length))?;
    if u32_at(bytes, 12) != Some(checksum(&bytes[..12], &bytes[HEADER..])) {
        return Err(BankError::Checksum);
    }
    Ok(bytes)
}

/// The bytes of the first section of `kind`.
fn section(bytes: &[u8], kind: u32) -> Result<Option<&[u8]>, BankError> {
    let count = u16_at(bytes, 6).unwrap_or(0);
    for i in 0..usize::from(count) {
        let row = HEADER + i * ROW;
        let word = |n: usize| u32_at(bytes, row + 4 * n).ok_or(BankError::Section(kind));
        if word(0)? == kind {
            let (start, length) = (word(1)? as usize, word(2)? as usize);
            return start
                .checked_add(length)
                .and_then(|end| bytes.get(start..end))
                .map(Some)
                .ok_or(BankError::Section(kind));
        }
    }
    Ok(None)
}

/// A scene with its name.
type Named<'a> = (&'a str, Scene);

/// The scene at the beginning of `bytes`, number `index` of its bank, and the bytes after it.
fn take_scene(bytes: &[u8], index: u16) -> Result<(Named<'_>, &[u8]), BankError> {
    let (record, rest) =
        postcard::take_from_bytes::<SceneRecord>(bytes).map_err(|_| BankError::Scene(index))?;
    let scene = record.scene().ok_or(BankError::Param(index))?;
    Ok(((record.name, scene), rest))
}

impl<'a> SceneRecord<'a> {
    /// The record of a scene.
    pub fn new(name: &'a str, scene: &Scene) -> Self {
        let id = |index: usize| param::TABLE[index].id;
        Self {
            name,
            values: scene
                .values
                .iter()
                .map(|(i, value)| (id(*i), *value))
                .collect(),
            curves: scene
                .curves
                .iter()
                .map(|curve| (id(curve.param), curve.points.clone()))
                .collect(),
        }
    }

    /// The scene of a record. None where it has a parameter, a value or a curve that the table does not allow.
    fn scene(&self) -> Option<Scene> {
        if self.name.is_empty() || self.name.len() > NAME {
            return None;
        }
        let allowed = |id: u16, value: f32| {
            let index = param::index_of_id(id)?;
            param::TABLE[index].accepts(value).then_some(index)
        };
        let mut scene = Scene::default();
        for &(id, value) in &self.values {
            scene.values.push((allowed(id, value)?, value)).ok()?;
        }
        for (id, points) in &self.curves {
            let rising = points.windows(2).all(|pair| pair[0].0 < pair[1].0);
            let inside = points.iter().all(|point| (0.0..=1.0).contains(&point.0));
            if points.is_empty() || !rising || !inside {
                return None;
            }
            for point in points {
                allowed(*id, point.1)?;
            }
            let curve = IntensityCurve {
                param: param::index_of_id(*id)?,
                points: points.clone(),
            };
            scene.curves.push(curve).ok()?;
        }
        Some(scene)
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let bytes = bytes.get(at..at + 2)?;
    Some(u16::from_le_bytes([bytes[0], bytes[1]]))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}
