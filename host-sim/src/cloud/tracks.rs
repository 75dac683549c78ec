//! Reads bubble tracks (`trackedBubInfo.txt` of FluidSound and BubbleGym), plain or `.xz`, as a stream.
//!
//! ```text
//! Bub <id> <radius>
//!   Start: <N|M|S> <time> [parents]
//!   <time> <frequency Hz> <x> <y> <z> [pressure] [depth]
//!   End: <M|S|C> <time> [children]
//! ```
//!
//! SI units, y up; N entrained, M merged, S split, C collapsed. Blank lines and comments (`#`) are skipped. A bubble goes
//! on in the largest of its children, or in what it merges into where it is the largest part, as in CB's own code: one
//! oscillator, struck anew.
//!
//! Samples go to a spool (in memory up to [`IN_MEMORY`], then a temporary file) in 28 bytes each; what stays in memory is
//! some 100 bytes a bubble. What is odd but can be read is counted in [`Oddities`] with its first lines; what cannot be
//! understood is refused with its line.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, anyhow, bail};

use super::coupling::Place;
use super::forcing::Cause;
use super::step::Tone;
use crate::scene_file::cannot_read;

/// Bytes of samples kept in memory before they go to a temporary file.
pub const IN_MEMORY: usize = 64 << 20;
/// Longest line read, bytes.
const MAX_LINE: u64 = 1 << 16;
/// Lines named of each oddity.
const NAMED: usize = 3;
/// Bytes of a sample in the spool.
const RECORD: usize = 28;
/// Pitches of a file that are believed, Hz.
const BELIEVED: std::ops::RangeInclusive<f64> = 1.0..=1e6;
/// Life of a bubble of which no file says when it ends, s.
const UNSAID_LIFE: f64 = 1e-3;

/// Whether a name is that of a file of tracks.
pub fn is_tracks(path: &Path) -> bool {
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().to_lowercase());
    name.is_some_and(|name| name.ends_with(".txt") || name.ends_with(".xz"))
}

/// Something in a file that is not as it should be, and what is done about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Oddity {
    /// A bubble without an `End`.
    NoEnd,
    /// An `End` before the `Start`.
    EndsBeforeStart,
    /// An `End` at the `Start`.
    EndsAtStart,
    /// No samples at all.
    NoSamples,
    /// One sample only.
    OneSample,
    /// A sample in a line above the `Start:`.
    SampleAboveStart,
    /// A sample earlier than the `Start`.
    SampleBeforeStart,
    /// A sample after the `End`.
    SampleAfterEnd,
    /// Samples not in order of time.
    Unordered,
    /// A frequency no bubble has.
    NoFrequency,
    /// A pressure that is no number.
    NoPressure,
    /// A depth above the surface.
    Above,
    /// More columns than are known.
    MoreColumns,
    /// A parent that the file does not have.
    NoParent,
    /// A child that the file does not have.
    NoChild,
    /// Parent and child do not agree.
    OneSided,
    /// A child that starts before its parent.
    BeforeParent,
    /// A bubble that descends from itself.
    Cycle,
    /// A merger of fewer than two.
    LoneMerger,
    /// A split into fewer than two, or a merger not into one.
    OddChildren,
    /// An entrained bubble with parents.
    EntrainedParents,
    /// Times below 0.
    Negative,
}

impl Oddity {
    /// For a sentence that begins with how many.
    pub fn text(self) -> &'static str {
        match self {
            Self::NoEnd => "bubbles have no End and end at their last sample",
            Self::EndsBeforeStart => "bubbles end before they start and sound alone",
            Self::EndsAtStart => "bubbles end as they start and sound alone",
            Self::NoSamples => {
                "bubbles have no samples: pitch from the radius, and they sound alone"
            }
            Self::OneSample => "bubbles have one sample only, which holds for their whole life",
            Self::SampleAboveStart => "samples stand above the Start of their bubble and are kept",
            Self::SampleBeforeStart => "samples come before the Start and are kept",
            Self::SampleAfterEnd => "samples come after the End and are kept",
            Self::Unordered => "bubbles have samples out of order, which were sorted",
            Self::NoFrequency => "samples have no usable frequency and take that of the radius",
            Self::NoPressure => "samples have a pressure that is no number (it is not used)",
            Self::Above => "samples have a depth below 0, taken as 0",
            Self::MoreColumns => "samples have more than 7 columns, which are not used",
            Self::NoParent => "parents are not in the file and are left out",
            Self::NoChild => "children are not in the file and are left out",
            Self::OneSided => "links are named by one end only and are kept",
            Self::BeforeParent => "children start before their parent and are bubbles of their own",
            Self::Cycle => "bubbles descend from themselves; their links are cut",
            Self::LoneMerger => "mergers name fewer than two known parents; equal halves are taken",
            Self::OddChildren => "Ends name too few or too many children",
            Self::EntrainedParents => "entrained bubbles name parents, which are left out",
            Self::Negative => "bubbles start before time 0; the sound starts with the first",
        }
    }
}

/// What was odd in a file: how often, and in which lines at first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Oddities(BTreeMap<Oddity, (u64, Vec<u64>)>);

impl Oddities {
    fn note(&mut self, oddity: Oddity, line: u64) {
        let (count, lines) = self.0.entry(oddity).or_default();
        *count += 1;
        if lines.len() < NAMED {
            lines.push(line);
        }
    }

    /// How often.
    pub fn count(&self, oddity: Oddity) -> u64 {
        self.0.get(&oddity).map_or(0, |entry| entry.0)
    }

    /// The lines named of it.
    pub fn lines(&self, oddity: Oddity) -> &[u64] {
        self.0.get(&oddity).map_or(&[], |entry| &entry.1)
    }

    /// One sentence each.
    pub fn sentences(&self) -> Vec<String> {
        self.0
            .iter()
            .map(|(oddity, (count, lines))| {
                let lines: Vec<String> = lines.iter().map(u64::to_string).collect();
                let more = if *count > NAMED as u64 { ", …" } else { "" };
                let plural = if lines.len() > 1 { "lines" } else { "line" };
                format!(
                    "{count} {} ({plural} {}{more})",
                    oddity.text(),
                    lines.join(", ")
                )
            })
            .collect()
    }
}

/// A bubble at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// s.
    pub time: f64,
    /// Undamped frequency, Hz.
    pub hertz: f32,
    /// m, y up.
    pub at: [f32; 3],
    /// m below the surface; NaN where the file does not say.
    pub depth: f32,
}

/// One bubble.
#[derive(Clone, Debug)]
pub struct Track {
    /// The file's number.
    pub id: u64,
    /// m.
    pub radius: f64,
    /// s, counted from the file's time 0.
    pub start: f64,
    /// s, at least `start`.
    pub end: f64,
    /// How it came to be.
    pub cause: Cause,
    /// The bubble in which it goes on.
    pub next: Option<u32>,
    /// The bubble that goes on in it.
    pub before: Option<u32>,
    first: u64,
    count: u32,
    line: u64,
}

/// All bubbles of a file, in order of their starts.
pub struct Tracks {
    /// In order of `start`.
    pub tracks: Vec<Track>,
    /// What was odd.
    pub oddities: Oddities,
    /// Samples read.
    pub samples: u64,
    /// Highest y of any sample: the surface, where no depth is given.
    pub surface: f64,
    /// What is added to the file's times so that none is below 0, s.
    offset: f64,
    spool: tempfile::SpooledTempFile,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    Entrained,
    Merged,
    Split,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Merged,
    Split,
    Collapsed,
}

/// A bubble while links are still numbers.
struct Raw {
    track: Track,
    start: Start,
    end: Option<End>,
    /// Parents, then children, in `links`.
    parents: (u32, u32),
    children: (u32, u32),
}

struct Reader<'a> {
    path: PathBuf,
    input: Box<dyn BufRead + 'a>,
    /// Out of an .xz.
    packed: bool,
    text: Vec<u8>,
    line: u64,
    oddities: Oddities,
    links: Vec<u64>,
    raw: Vec<Raw>,
    ids: HashMap<u64, u64>,
    open: Option<Raw>,
    samples: Vec<Sample>,
    spool: BufWriter<tempfile::SpooledTempFile>,
    written: u64,
    surface: f64,
}

impl Tracks {
    /// Reads a whole file; `stop` ends that early, as an error.
    ///
    /// # Errors
    /// A file that cannot be read, is no file of tracks, or says something that cannot be understood, with its line.
    pub fn open(path: &Path, stop: &AtomicBool) -> Result<Self> {
        let file = File::open(path).map_err(|error| cannot_read(path, &error))?;
        Self::read(path, file, stop)
    }

    /// The same from anywhere; `path` is what messages call it. A stream that starts as `.xz` does is unpacked.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn read(path: &Path, source: impl Read, stop: &AtomicBool) -> Result<Self> {
        let mut source = BufReader::with_capacity(1 << 17, source);
        let head = source
            .fill_buf()
            .map_err(|error| cannot_read(path, &error))?;
        let packed = head.starts_with(&[0xfd, b'7', b'z', b'X', b'Z']);
        let input: Box<dyn BufRead + '_> = if packed {
            Box::new(BufReader::with_capacity(
                1 << 17,
                lzma_rust2::XzReader::new(source, true),
            ))
        } else {
            Box::new(source)
        };
        let mut reader = Reader {
            path: path.to_owned(),
            input,
            packed,
            text: Vec::new(),
            line: 0,
            oddities: Oddities::default(),
            links: Vec::new(),
            raw: Vec::new(),
            ids: HashMap::new(),
            open: None,
            samples: Vec::new(),
            spool: BufWriter::new(tempfile::SpooledTempFile::new(IN_MEMORY)),
            written: 0,
            surface: f64::NEG_INFINITY,
        };
        while reader.advance()? {
            if reader.line.is_multiple_of(4096) && stop.load(Ordering::Relaxed) {
                bail!("stopped while reading {}", path.display());
            }
            reader.take()?;
        }
        reader.close()?;
        reader.finish()
    }

    /// The samples of a bubble, in order of time.
    ///
    /// # Errors
    /// A temporary file that cannot be read back.
    pub fn samples_of(&mut self, track: usize) -> Result<Vec<Sample>> {
        let track = &self.tracks[track];
        let mut bytes = vec![0; track.count as usize * RECORD];
        self.spool
            .seek(SeekFrom::Start(track.first * RECORD as u64))
            .and_then(|_| self.spool.read_exact(&mut bytes))
            .context("cannot read the temporary file of samples back")?;
        let (records, _) = bytes.as_chunks::<RECORD>();
        let mut samples: Vec<Sample> = records.iter().map(Sample::unpacked).collect();
        samples
            .iter_mut()
            .for_each(|sample| sample.time += self.offset);
        Ok(samples)
    }

    /// When the last bubble ends, s.
    pub fn end(&self) -> f64 {
        self.tracks
            .iter()
            .map(|track| track.end)
            .fold(0.0, f64::max)
    }

    /// Line of a bubble in the file.
    pub fn line(&self, track: usize) -> u64 {
        self.tracks[track].line
    }
}

impl Sample {
    fn packed(&self) -> [u8; RECORD] {
        let mut bytes = [0; RECORD];
        bytes[..8].copy_from_slice(&self.time.to_le_bytes());
        let rest = [self.hertz, self.at[0], self.at[1], self.at[2], self.depth];
        for (to, value) in bytes[8..].as_chunks_mut::<4>().0.iter_mut().zip(rest) {
            *to = value.to_le_bytes();
        }
        bytes
    }

    fn unpacked(bytes: &[u8; RECORD]) -> Self {
        let mut time = [0; 8];
        time.copy_from_slice(&bytes[..8]);
        let (words, _) = bytes[8..].as_chunks::<4>();
        let word = |i: usize| f32::from_le_bytes(words[i]);
        Self {
            time: f64::from_le_bytes(time),
            hertz: word(0),
            at: [word(1), word(2), word(3)],
            depth: word(4),
        }
    }
}

/// A bubble's place and tone at a time, between its samples; before the first and after the last, as there.
pub fn at_time(samples: &[Sample], radius: f64, surface: f64, time: f64) -> (Place, Tone) {
    let Some(last) = samples.len().checked_sub(1) else {
        let place = Place {
            at: [0.0; 3],
            radius,
            depth: 0.0,
        };
        return (place, Tone::of_radius(radius));
    };
    let after = samples
        .partition_point(|sample| sample.time <= time)
        .min(last);
    let (a, b) = (&samples[after.saturating_sub(1)], &samples[after]);
    let way = if b.time > a.time {
        ((time - a.time) / (b.time - a.time)).clamp(0.0, 1.0)
    } else {
        1.0
    };
    let mix = |a: f32, b: f32| f64::from(a) + (f64::from(b) - f64::from(a)) * way;
    let at = [0, 1, 2].map(|axis| mix(a.at[axis], b.at[axis]));
    let depth = mix(a.depth, b.depth);
    let place = Place {
        at,
        radius,
        depth: if depth.is_nan() {
            (surface - at[1]).max(0.0)
        } else {
            depth
        },
    };
    (place, Tone::of_frequency(radius, mix(a.hertz, b.hertz)))
}

impl Reader<'_> {
    /// The next line that says something; false at the end.
    fn advance(&mut self) -> Result<bool> {
        loop {
            self.text.clear();
            let length = self
                .input
                .by_ref()
                .take(MAX_LINE + 1)
                .read_until(b'\n', &mut self.text)
                .map_err(|error| match (self.packed, error.kind()) {
                    (false, _) => cannot_read(&self.path, &error),
                    (true, std::io::ErrorKind::UnexpectedEof) => anyhow!(
                        "cannot unpack {}: it ends in the middle (was it copied whole?)",
                        self.path.display()
                    ),
                    (true, _) => anyhow!(
                        "cannot unpack {}: {error} (`xz -t` tests whether it is whole)",
                        self.path.display()
                    ),
                })?;
            if length == 0 {
                return Ok(false);
            }
            self.line += 1;
            if length as u64 > MAX_LINE {
                return Err(self.error("expected a line of a few words, got one of more than 65536 bytes (is this a file of bubble tracks?)"));
            }
            if self.line == 1 && self.text.starts_with(b"\xef\xbb\xbf") {
                self.text.drain(..3);
            }
            let text = self.text.trim_ascii();
            if !text.is_empty() && text[0] != b'#' {
                return Ok(true);
            }
        }
    }

    fn error(&self, message: impl std::fmt::Display) -> anyhow::Error {
        anyhow!("{}:{}: {message}", self.path.display(), self.line)
    }

    fn take(&mut self) -> Result<()> {
        let bytes = std::mem::take(&mut self.text);
        let result = match std::str::from_utf8(&bytes) {
            Ok(text) => self.take_line(text.trim_ascii()),
            Err(_) => {
                Err(self.error("expected text, got other bytes (is this a file of bubble tracks?)"))
            }
        };
        self.text = bytes;
        result
    }

    fn take_line(&mut self, text: &str) -> Result<()> {
        // A comment may also end a line.
        let text = match text.bytes().position(|byte| byte == b'#') {
            Some(end) => &text[..end],
            None => text,
        };
        let mut words = text.split_ascii_whitespace();
        let Some(first) = words.next() else {
            return Ok(());
        };
        match first {
            "Bub" => self.begin(words),
            "Start:" => self.start(words),
            "End:" => self.end(words),
            _ if first.starts_with(|c: char| c.is_ascii_alphabetic()) && !matches!(first, "nan" | "NaN" | "inf" | "Inf" | "infinity") => {
                Err(self.error(format_args!(
                    "expected `Bub`, `Start:`, `End:` or a sample that begins with a time, got `{}`",
                    shortened(first)
                )))
            }
            _ => self.sample(first, words),
        }
    }

    fn begin<'w>(&mut self, mut words: impl Iterator<Item = &'w str>) -> Result<()> {
        self.close()?;
        let id = self.whole("the bubble's number", words.next())?;
        let radius = self.number(
            "the radius",
            words.next(),
            1e-7,
            1.0,
            "in metres, from 1e-7 to 1",
        )?;
        self.none_left(words)?;
        if let Some(before) = self.ids.insert(id, self.line) {
            return Err(self.error(format_args!(
                "bubble {id} was there already, in line {before} (every bubble needs a number of its own)"
            )));
        }
        self.open = Some(Raw {
            track: Track {
                id,
                radius,
                start: f64::NAN,
                end: f64::NAN,
                cause: Cause::Entrained,
                next: None,
                before: None,
                first: self.written,
                count: 0,
                line: self.line,
            },
            start: Start::Entrained,
            end: None,
            parents: (0, 0),
            children: (0, 0),
        });
        Ok(())
    }

    fn start<'w>(&mut self, mut words: impl Iterator<Item = &'w str>) -> Result<()> {
        let kind = match words.next() {
            Some("N") => Start::Entrained,
            Some("M") => Start::Merged,
            Some("S") => Start::Split,
            other => {
                return Err(self.error(format_args!(
                    "expected how the bubble starts (N entrained, M merged, S split), got `{}`",
                    shortened(other.unwrap_or_default())
                )));
            }
        };
        let time = self.time("the start", words.next())?;
        let parents = self.numbers("a parent", words)?;
        match &mut self.open {
            Some(raw) if raw.track.start.is_nan() => {
                raw.track.start = time;
                raw.start = kind;
                raw.parents = parents;
                Ok(())
            }
            Some(_) => Err(self.error(
                "a second `Start:` for the same bubble (is a `Bub` line missing before it?)",
            )),
            None => Err(self
                .error("a `Start:` without a bubble: expected `Bub <number> <radius>` before it")),
        }
    }

    fn end<'w>(&mut self, mut words: impl Iterator<Item = &'w str>) -> Result<()> {
        let kind = match words.next() {
            Some("M") => End::Merged,
            Some("S") => End::Split,
            Some("C") => End::Collapsed,
            other => {
                return Err(self.error(format_args!(
                    "expected how the bubble ends (M merges, S splits, C collapses), got `{}`",
                    shortened(other.unwrap_or_default())
                )));
            }
        };
        let time = self.time("the end", words.next())?;
        let children = self.numbers("a child", words)?;
        match &mut self.open {
            Some(raw) if !raw.track.start.is_nan() => {
                raw.track.end = time;
                raw.end = Some(kind);
                raw.children = children;
                self.close()
            }
            Some(_) => Err(self.error("an `End:` before the bubble's `Start:`")),
            None => Err(self
                .error("an `End:` without a bubble: expected `Bub <number> <radius>` before it")),
        }
    }

    fn sample<'w>(&mut self, first: &str, mut words: impl Iterator<Item = &'w str>) -> Result<()> {
        let Some(raw) = &self.open else {
            return Err(self
                .error("a sample outside any bubble: expected `Bub <number> <radius>` before it"));
        };
        if raw.track.start.is_nan() {
            self.oddities.note(Oddity::SampleAboveStart, self.line);
        }
        let radius = raw.track.radius;
        let time = self.time("the time", Some(first))?;
        let frequency = self.any_number("the frequency", words.next())?;
        let mut at = [0.0f32; 3];
        for (at, name) in at.iter_mut().zip(["x", "y", "z"]) {
            *at = self.number(name, words.next(), -1e6, 1e6, "in metres, from -1e6 to 1e6")? as f32;
        }
        let hertz = if BELIEVED.contains(&frequency) {
            frequency
        } else {
            self.oddities.note(Oddity::NoFrequency, self.line);
            Tone::of_radius(radius).omega0 / std::f64::consts::TAU
        };
        if let Some(pressure) = words.next()
            && !decimal(pressure).is_some_and(f64::is_finite)
        {
            self.oddities.note(Oddity::NoPressure, self.line);
        }
        let depth = match words.next() {
            None => f64::NAN,
            Some(word) => {
                let depth = self.number(
                    "the depth",
                    Some(word),
                    -1e6,
                    1e6,
                    "in metres, from -1e6 to 1e6",
                )?;
                if depth < 0.0 {
                    self.oddities.note(Oddity::Above, self.line);
                }
                depth.max(0.0)
            }
        };
        if words.next().is_some() {
            self.oddities.note(Oddity::MoreColumns, self.line);
        }
        self.surface = self.surface.max(f64::from(at[1]));
        self.samples.push(Sample {
            time,
            hertz: hertz as f32,
            at,
            depth: depth as f32,
        });
        Ok(())
    }

    /// The bubble that is being read is complete.
    fn close(&mut self) -> Result<()> {
        let Some(mut raw) = self.open.take() else {
            return Ok(());
        };
        let line = raw.track.line;
        if raw.track.start.is_nan() {
            return Err(anyhow!(
                "{}:{line}: bubble {} has no `Start:` line (is the file cut off?)",
                self.path.display(),
                raw.track.id
            ));
        }
        let mut note = |oddity| self.oddities.note(oddity, line);
        let sorted = self.samples.is_sorted_by(|a, b| a.time <= b.time);
        if !sorted {
            note(Oddity::Unordered);
            self.samples.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        match self.samples.len() {
            0 => note(Oddity::NoSamples),
            1 => note(Oddity::OneSample),
            _ => {}
        }
        let start = raw.track.start;
        if raw.end.is_none() {
            note(Oddity::NoEnd);
            let last = self.samples.last().map(|sample| sample.time);
            raw.track.end = last.unwrap_or(start + UNSAID_LIFE).max(start);
        } else if raw.track.end < start {
            note(Oddity::EndsBeforeStart);
            raw.track.end = start;
        } else if raw.track.end == start {
            note(Oddity::EndsAtStart);
        }
        if start < 0.0 {
            note(Oddity::Negative);
        }
        // Times are often written with fewer digits in one place than in another.
        let slack = 1e-6 * (1.0 + start.abs());
        for sample in &self.samples {
            if sample.time < start - slack {
                self.oddities.note(Oddity::SampleBeforeStart, line);
            }
            if sample.time > raw.track.end + slack {
                self.oddities.note(Oddity::SampleAfterEnd, line);
            }
            self.spool
                .write_all(&sample.packed())
                .context("cannot write the temporary file of samples (is the disk full?)")?;
        }
        raw.track.count = u32::try_from(self.samples.len())
            .map_err(|_| self.error("a bubble with more than 4294967295 samples"))?;
        self.written += self.samples.len() as u64;
        self.samples.clear();
        self.raw.push(raw);
        Ok(())
    }

    /// Sorts, and finds who goes on in whom.
    fn finish(mut self) -> Result<Tracks> {
        if self.raw.is_empty() {
            bail!(
                "{}: no bubbles in it; expected lines such as `Bub 0 0.001`, `  Start: N 0.0`, a sample, `  End: C 0.1`",
                self.path.display()
            );
        }
        let mut raw = std::mem::take(&mut self.raw);
        raw.sort_by(|a, b| a.track.start.total_cmp(&b.track.start));
        self.ids.clear();
        for (index, raw) in raw.iter().enumerate() {
            self.ids.insert(raw.track.id, index as u64);
        }
        let links = Links::new(&raw, &self.links, &self.ids, &mut self.oddities);
        let mut tracks: Vec<Track> = raw.iter().map(|raw| raw.track.clone()).collect();
        for (index, raw) in raw.iter().enumerate() {
            let line = raw.track.line;
            tracks[index].cause = match raw.start {
                Start::Entrained => Cause::Entrained,
                Start::Split => Cause::Split,
                Start::Merged => {
                    let mut radii: Vec<f64> = links
                        .parents(index)
                        .map(|parent| tracks[parent].radius)
                        .collect();
                    radii.sort_by(|a, b| b.total_cmp(a));
                    match radii[..] {
                        [first, second, ..] => Cause::Merged([first, second]),
                        _ => {
                            self.oddities.note(Oddity::LoneMerger, line);
                            let half = raw.track.radius / 2f64.cbrt();
                            Cause::Merged([half; 2])
                        }
                    }
                }
            };
        }
        for (index, raw) in raw.iter().enumerate() {
            let mut children: Vec<usize> = match raw.end {
                Some(End::Merged) => links.children(index).take(1).collect(),
                Some(End::Split) => links.children(index).collect(),
                _ => continue,
            };
            children.sort_by(|&a, &b| tracks[b].radius.total_cmp(&tracks[a].radius));
            let heir = children.into_iter().find(|&child| {
                // Only forward, so that no line of heirs comes back to itself.
                child > index
                    && tracks[child].before.is_none()
                    && links.largest_parent(child, &tracks) == Some(index)
            });
            if let Some(heir) = heir {
                tracks[index].next = Some(heir as u32);
                tracks[heir].before = Some(index as u32);
            }
        }
        let mut spool = self
            .spool
            .into_inner()
            .map_err(|error| anyhow!("cannot write the temporary file of samples: {error}"))?;
        spool
            .flush()
            .context("cannot write the temporary file of samples")?;
        let offset = -tracks[0].start.min(0.0);
        for track in &mut tracks {
            track.start += offset;
            track.end += offset;
        }
        Ok(Tracks {
            tracks,
            oddities: self.oddities,
            samples: self.written,
            surface: self.surface,
            offset,
            spool,
        })
    }

    fn none_left<'w>(&self, mut words: impl Iterator<Item = &'w str>) -> Result<()> {
        match words.next() {
            None => Ok(()),
            Some(word) => Err(self.error(format_args!(
                "expected the end of the line, got `{}`",
                shortened(word)
            ))),
        }
    }

    fn whole(&self, what: &str, word: Option<&str>) -> Result<u64> {
        let word = word.unwrap_or_default();
        word.parse().map_err(|_| {
            self.error(format_args!(
                "{what}: expected a whole number, got `{}`",
                shortened(word)
            ))
        })
    }

    /// A list of numbers to the end of the line, in `links`.
    fn numbers<'w>(
        &mut self,
        what: &str,
        words: impl Iterator<Item = &'w str>,
    ) -> Result<(u32, u32)> {
        let place =
            |n: usize| u32::try_from(n).map_err(|_| self.error("more than 4294967295 links"));
        let first = place(self.links.len())?;
        let mut found = Vec::new();
        for word in words {
            found.push(self.whole(what, Some(word))?);
        }
        self.links.extend(found);
        let last = u32::try_from(self.links.len())
            .map_err(|_| self.error("more than 4294967295 links"))?;
        Ok((first, last))
    }

    fn time(&self, what: &str, word: Option<&str>) -> Result<f64> {
        self.number(what, word, -1e6, 1e6, "in seconds, from -1e6 to 1e6")
    }

    fn any_number(&self, what: &str, word: Option<&str>) -> Result<f64> {
        let text = word.unwrap_or_default();
        decimal(text).ok_or_else(|| {
            self.error(format_args!(
                "{what}: expected a number, got `{}`",
                shortened(text)
            ))
        })
    }

    fn number(
        &self,
        what: &str,
        word: Option<&str>,
        low: f64,
        high: f64,
        range: &str,
    ) -> Result<f64> {
        let text = word.unwrap_or_default();
        match decimal(text) {
            Some(value) if (low..=high).contains(&value) => Ok(value),
            _ if text.is_empty() => Err(self.error(format_args!(
                "{what}: expected a number {range}, got nothing (is the line cut off?)"
            ))),
            _ => Err(self.error(format_args!(
                "{what}: expected a number {range}, got `{}`",
                shortened(text)
            ))),
        }
    }
}

/// A number as [`str::parse`] reads it, to the last bit. These files are little else than numbers of a few digits: one
/// whose digits fit an f64 is a whole number over a power of ten, both exact, so their quotient is rounded once.
fn decimal(word: &str) -> Option<f64> {
    const POWERS: [f64; 16] = [
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
    ];
    let slowly = || word.parse().ok();
    let digits = word.strip_prefix('-').unwrap_or(word).as_bytes();
    // A point and 15 digits stay below 2^53.
    if !(2..=16).contains(&digits.len()) {
        return slowly();
    }
    let (mut whole, mut after) = (0u64, None);
    for byte in digits {
        match byte {
            b'0'..=b'9' => {
                whole = 10 * whole + u64::from(byte - b'0');
                after = after.map(|n: usize| n + 1);
            }
            b'.' if after.is_none() => after = Some(0),
            _ => return slowly(),
        }
    }
    let value = match after {
        Some(after) => whole as f64 / POWERS[after],
        // 16 digits may not fit.
        None => return slowly(),
    };
    Some(if digits.len() < word.len() {
        -value
    } else {
        value
    })
}

/// Who comes from whom, by index.
struct Links {
    /// Parent, child; in order of parents.
    down: Vec<(u32, u32)>,
    /// Child, parent; in order of children.
    up: Vec<(u32, u32)>,
}

impl Links {
    fn new(raw: &[Raw], links: &[u64], ids: &HashMap<u64, u64>, odd: &mut Oddities) -> Self {
        // The last entry: 1 the child says so, 2 the parent.
        let mut edges: Vec<(u32, u32, u8)> = Vec::new();
        let named = |range: (u32, u32)| &links[range.0 as usize..range.1 as usize];
        for (index, raw) in raw.iter().enumerate() {
            let line = raw.track.line;
            let me = index as u32;
            let parents = named(raw.parents);
            if raw.start == Start::Entrained && !parents.is_empty() {
                odd.note(Oddity::EntrainedParents, line);
            } else {
                for parent in parents {
                    match ids.get(parent) {
                        Some(&parent) => edges.push((parent as u32, me, 1)),
                        None => odd.note(Oddity::NoParent, line),
                    }
                }
            }
            let children = named(raw.children);
            let fits = match raw.end {
                Some(End::Merged) => children.len() == 1,
                Some(End::Split) => children.len() >= 2,
                Some(End::Collapsed) | None => children.is_empty(),
            };
            if !fits {
                odd.note(Oddity::OddChildren, line);
            }
            for child in children {
                match ids.get(child) {
                    Some(&child) => edges.push((me, child as u32, 2)),
                    None => odd.note(Oddity::NoChild, line),
                }
            }
        }
        edges.sort_unstable();
        edges.dedup_by(|later, first| {
            let same = (later.0, later.1) == (first.0, first.1);
            if same {
                first.2 |= later.2;
            }
            same
        });
        for &(parent, child, said) in &edges {
            let (parent, child) = (&raw[parent as usize].track, &raw[child as usize].track);
            if said != 3 {
                let teller = if said == 1 { child } else { parent };
                odd.note(Oddity::OneSided, teller.line);
            }
            if child.start < parent.start {
                odd.note(Oddity::BeforeParent, child.line);
            }
        }
        let mut down: Vec<(u32, u32)> = edges.iter().map(|edge| (edge.0, edge.1)).collect();
        let cyclic = cyclic(raw.len(), &down);
        if cyclic.iter().any(|&cyclic| cyclic) {
            for (index, _) in cyclic.iter().enumerate().filter(|cyclic| *cyclic.1) {
                odd.note(Oddity::Cycle, raw[index].track.line);
            }
            down.retain(|&(a, b)| !(cyclic[a as usize] && cyclic[b as usize]));
        }
        let mut up: Vec<(u32, u32)> = down.iter().map(|&(a, b)| (b, a)).collect();
        up.sort_unstable();
        Self { down, up }
    }

    fn children(&self, of: usize) -> impl Iterator<Item = usize> {
        Self::ends(&self.down, of)
    }

    fn parents(&self, of: usize) -> impl Iterator<Item = usize> {
        Self::ends(&self.up, of)
    }

    fn ends(edges: &[(u32, u32)], of: usize) -> impl Iterator<Item = usize> {
        let first = edges.partition_point(|edge| (edge.0 as usize) < of);
        let run = edges[first..]
            .iter()
            .take_while(move |edge| edge.0 as usize == of);
        run.map(|edge| edge.1 as usize)
    }

    fn largest_parent(&self, of: usize, tracks: &[Track]) -> Option<usize> {
        self.parents(of).reduce(|a, b| {
            if tracks[b].radius > tracks[a].radius {
                b
            } else {
                a
            }
        })
    }
}

/// Which nodes lie on a cycle, or on a way from one cycle to another: whoever is left when ends are taken off.
fn cyclic(nodes: usize, edges: &[(u32, u32)]) -> Vec<bool> {
    let mut left = vec![true; nodes];
    for reversed in [false, true] {
        let mut ways: Vec<(u32, u32)> = edges
            .iter()
            .map(|&(a, b)| if reversed { (b, a) } else { (a, b) })
            .collect();
        ways.sort_unstable();
        let mut entering = vec![0u32; nodes];
        for &(a, b) in &ways {
            if left[a as usize] && left[b as usize] {
                entering[b as usize] += 1;
            }
        }
        let mut free: Vec<usize> = (0..nodes)
            .filter(|&n| left[n] && entering[n] == 0)
            .collect();
        while let Some(node) = free.pop() {
            left[node] = false;
            for next in Links::ends(&ways, node) {
                if left[next] {
                    entering[next] -= 1;
                    if entering[next] == 0 {
                        free.push(next);
                    }
                }
            }
        }
    }
    left
}

/// What was read, for a message: short and harmless to a terminal.
fn shortened(text: &str) -> String {
    let mut short: String = text
        .chars()
        .take(40)
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    if text.chars().nth(40).is_some() {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::Random;
    use super::*;

    #[test]
    fn decimals_are_read_to_the_last_bit() {
        let mut random = Random::new(1);
        let mut words: Vec<String> = [
            "", ".", "-", "-.", "5.", ".5", "-0.0", "1.5.2", "nan", "1e3", "+1.5", "--1.0",
        ]
        .map(String::from)
        .into();
        for _ in 0..100_000 {
            let digits = (random.bits() % 12) as usize;
            let value = random.between(-1.0, 1.0) * 10f64.powi((random.bits() % 9) as i32 - 2);
            words.push(format!("{value:.digits$}"));
        }
        for word in &words {
            let wanted = word.parse::<f64>().ok().map(f64::to_bits);
            assert_eq!(decimal(word).map(f64::to_bits), wanted, "{word}");
        }
    }
}
