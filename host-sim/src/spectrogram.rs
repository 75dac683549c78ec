//! A picture of a sound: its waveform over its spectrogram, as a PNG, in flat memory whatever the length.
//!
//! Two Hann transforms run over the mid signal: a short one (43 ms) that times the drips, and one four times
//! as long for the rumble. Above some 400 Hz the picture shows the short one; below, the harmonic mean of
//! both, which is small where either of them is: as well timed as the short one, as well tuned as the long one.
//! Each column is the mean power of the transforms whose middles fall in it; when the columns run out,
//! neighbours are merged in pairs.
//!
//! A level is the power in a band as wide as the short transform's (35 Hz), for both transforms, so that noise
//! passes evenly from the one to the other. A sine at full scale reads 0 dB, 2 dB more in the harmonic mean,
//! and a few dB less above 5 kHz, where a row of the picture spans several bins.

use anyhow::{Result, anyhow, bail};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontTransform, register_font};
use realfft::{RealFftPlanner, RealToComplex, num_complex::Complex};
use std::f32::consts::TAU;
use std::path::Path;
use std::sync::Arc;

/// Most columns kept, one for each pixel of the plot's width.
const COLUMNS: usize = 1200;
/// The shortest column, in frames.
const MIN_COLUMN: u64 = 128;
/// Length of the short transform at 48 kHz, in frames; the long one has [`LONG`] times as many.
const SHORT_AT_48K: u64 = 2048;
const LONG: usize = 4;
/// A sound shorter than this many short transforms gets shorter ones, down to a quarter.
const FIT: u64 = 8;
/// Between these, in Hz, the picture goes over from both transforms to the short one.
const BLEND: (f32, f32) = (280.0, 560.0);
/// The ends of the frequency axis, in Hz, unless the sample rate ends it before.
const LOWEST: f32 = 50.0;
const HIGHEST: f32 = 20_000.0;
/// From the loudest cell down to black, in dB.
const SPAN_DB: f32 = 80.0;
/// What silence reads, in dB.
const SILENCE_DB: f32 = -200.0;

/// The family of the pictures' font.
pub(crate) const FONT: &str = "freshet";

/// Makes [`FONT`] known to the drawing.
pub(crate) fn use_font() -> Result<()> {
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| anyhow!("the embedded font cannot be read"))
}

/// Refuses a name that does not end in `.png`.
pub fn check_name(path: &Path) -> Result<()> {
    let is_png = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    if !is_png {
        bail!(
            "cannot write the picture {}: expected a name that ends in .png",
            path.display()
        );
    }
    Ok(())
}

/// Collects a sound and draws it.
pub struct Spectrogram {
    rate: u32,
    pushed: u64,
    /// Frames a column of the spectrogram holds now.
    column: u64,
    short: Bank,
    long: Bank,
    envelope: Envelope,
}

impl Spectrogram {
    /// For a sound of `frames` frames at `rate` Hz. The length only chooses the width of a column: a shorter
    /// or longer sound is drawn whole, too. A rate of 0 counts as 1 Hz.
    pub fn new(rate: u32, frames: u64) -> Self {
        let rate = rate.max(1);
        // The last of the doublings of the first width then fills the picture just about.
        let mut column = frames.div_ceil(COLUMNS as u64).max(MIN_COLUMN);
        while column >= 2 * MIN_COLUMN {
            column = column.div_ceil(2);
        }
        let wanted = u64::from(rate) * SHORT_AT_48K / 48_000;
        let mut size = (wanted.clamp(64, 1 << 16) as usize).next_power_of_two();
        for _ in 0..2 {
            if frames > 0 && size > 64 && frames < FIT * size as u64 {
                size /= 2;
            }
        }
        // Power in a bin of the long transform, as if the bin were as wide as one of the short transform.
        let wider = LONG as f32;
        let highest = HIGHEST.min(rate as f32 / 2.0);
        Spectrogram {
            rate,
            pushed: 0,
            column,
            short: Bank::new(size, rate, highest, column, 1.0),
            long: Bank::new(LONG * size, rate, highest.min(BLEND.1), column, wider),
            envelope: Envelope::new(frames),
        }
    }

    /// Takes the next frame, full scale ±1.0. What is not a finite number counts as 0.
    pub fn push(&mut self, left: f32, right: f32) {
        let mid = 0.5 * left + 0.5 * right;
        // Far beyond full scale, and its square is still far from the largest float.
        let mid = if mid.is_finite() {
            mid.clamp(-1.0e6, 1.0e6)
        } else {
            0.0
        };
        if self.pushed == self.column * COLUMNS as u64 {
            self.column *= 2;
            self.short.halve(self.column);
            self.long.halve(self.column);
        }
        self.pushed += 1;
        self.short.push(mid);
        self.long.push(mid);
        self.envelope.push(mid);
    }

    /// Draws what was pushed, 1400 × 800 pixels, with `title` above it. Silence and nothing at all give a
    /// picture, too.
    ///
    /// # Errors
    /// A name that does not end in `.png`; a path that cannot be written; a full disk.
    pub fn write_png(mut self, path: &Path, title: &str) -> Result<()> {
        check_name(path)?;
        // Before the drawing, whose errors do not tell a missing folder from a wrong one.
        std::fs::File::create(path).map_err(|error| {
            let reason = error.to_string();
            let reason = reason.split(" (os error").next().unwrap_or_default();
            anyhow!(
                "cannot write the picture {}: {reason} (does the folder exist, and may you write to it?)",
                path.display()
            )
        })?;
        let cells = self.cells(plot::HEIGHT as usize);
        // What the drawing says of it is for programmers.
        plot::draw(path, title, &self, &cells).map_err(|_| {
            anyhow!(
                "cannot write the picture {} (is the disk full?)",
                path.display()
            )
        })
    }

    /// The levels, `rows` of them for each column, from low to high pitch in equal ratios.
    fn cells(&mut self, rows: usize) -> Cells {
        self.short.end(self.pushed);
        self.long.end(self.pushed);
        let highest = HIGHEST.min(self.rate as f32 / 2.0);
        let lowest = LOWEST.min(highest / 10.0);
        let mut cells = Cells {
            rows,
            span: self.pushed as f32 / self.column as f32,
            lowest,
            highest,
            db: Vec::new(),
        };
        // The edges of each row, and how much of it is the short transform's.
        let bands: Vec<(f32, f32, f32)> = (0..rows)
            .map(|row| {
                let at = |offset: f32| cells.frequency(row as f32 + offset);
                let way = (at(0.0) / BLEND.0).ln() / (BLEND.1 / BLEND.0).ln();
                let t = way.clamp(0.0, 1.0);
                (at(-0.5), at(0.5), t * t * (3.0 - 2.0 * t))
            })
            .collect();
        for column in 0..self.pushed.div_ceil(self.column) as usize {
            let short = self.short.levels(column);
            let long = self.long.levels(column);
            for &(low, high, blend) in &bands {
                let mut db = self.short.level(&short, low, high);
                if blend < 1.0 {
                    let both = harmonic_mean(db, self.long.level(&long, low, high));
                    db = both + blend * (db - both);
                }
                cells.db.push(db);
            }
        }
        cells
    }

    /// The width in Hz of the band a level is for: that of a Hann window is one and a half bins.
    fn band(&self) -> f32 {
        1.5 * self.short.bin_hz
    }

    fn seconds(&self) -> f64 {
        self.pushed as f64 / f64::from(self.rate)
    }
}

/// Levels in dB, column after column, each from low to high pitch.
struct Cells {
    rows: usize,
    /// The width of the sound in columns; the last one is rarely full.
    span: f32,
    lowest: f32,
    highest: f32,
    db: Vec<f32>,
}

impl Cells {
    /// The pitch in Hz of the middle of a row; a half to either side are its edges.
    fn frequency(&self, row: f32) -> f32 {
        self.lowest * (self.highest / self.lowest).powf((row + 0.5) / self.rows as f32)
    }

    fn columns(&self) -> usize {
        self.db.len() / self.rows.max(1)
    }

    /// The level at a place between the columns, `x` from 0 to 1 over the whole width.
    fn between(&self, x: f32, row: usize) -> f32 {
        let columns = self.columns();
        if columns == 0 {
            return SILENCE_DB;
        }
        let at = (x * self.span - 0.5).clamp(0.0, (columns - 1) as f32);
        let left = at as usize;
        let right = (left + 1).min(columns - 1);
        let (left, right) = (
            self.db[left * self.rows + row],
            self.db[right * self.rows + row],
        );
        left + (right - left) * at.fract()
    }

    fn loudest(&self) -> f32 {
        self.db.iter().copied().fold(SILENCE_DB, f32::max)
    }
}

/// One size of transform, and the power it found, in columns.
struct Bank {
    fft: Arc<dyn RealToComplex<f32>>,
    window: Vec<f32>,
    /// The last `window.len()` frames; the oldest stands at `at`.
    ring: Vec<f32>,
    at: usize,
    input: Vec<f32>,
    output: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
    /// Width of a bin in Hz.
    bin_hz: f32,
    /// From the transform's power to the level's.
    scale: f32,
    /// Bins kept of each transform.
    bins: usize,
    /// Frames that went in, the zeros after the end included.
    pushed: u64,
    /// Middle of the next transform, in frames.
    next: u64,
    hop: u64,
    column: u64,
    /// Sums of power, `bins` a column, and of how many transforms.
    power: Vec<f32>,
    counts: Vec<u32>,
}

impl Bank {
    fn new(size: usize, rate: u32, highest: f32, column: u64, gain: f32) -> Self {
        let fft = RealFftPlanner::<f32>::new().plan_fft_forward(size);
        let bin_hz = rate as f32 / size as f32;
        let mut bank = Bank {
            window: (0..size)
                .map(|i| 0.5 - 0.5 * (TAU * i as f32 / size as f32).cos())
                .collect(),
            ring: vec![0.0; size],
            at: 0,
            input: fft.make_input_vec(),
            output: fft.make_output_vec(),
            scratch: fft.make_scratch_vec(),
            fft,
            bin_hz,
            // A sine of amplitude 1 peaks at a quarter of the window's length.
            scale: gain * (4.0 / size as f32).powi(2),
            // Two more than the picture shows, for the curve between the bins.
            bins: ((highest / bin_hz) as usize + 3).min(size / 2 + 1),
            pushed: 0,
            next: 0,
            hop: 1,
            column,
            power: Vec::new(),
            counts: Vec::new(),
        };
        bank.choose_hop();
        bank.next = bank.hop / 2;
        bank
    }

    /// As many transforms a column as overlap by half, and one at least.
    fn choose_hop(&mut self) {
        self.hop = self.column / self.column.div_ceil(self.window.len() as u64 / 2);
    }

    fn push(&mut self, value: f32) {
        self.ring[self.at] = value;
        // The length is a power of two.
        self.at = (self.at + 1) & (self.ring.len() - 1);
        self.pushed += 1;
        if self.pushed == self.next + self.window.len() as u64 / 2 {
            self.transform();
            self.next += self.hop;
        }
    }

    fn transform(&mut self) {
        let (newer, older) = self.ring.split_at(self.at);
        for ((input, sample), window) in self
            .input
            .iter_mut()
            .zip(older.iter().chain(newer))
            .zip(&self.window)
        {
            *input = sample * window;
        }
        let column = (self.next / self.column) as usize;
        if self.counts.len() <= column {
            self.counts.resize(column + 1, 0);
            self.power.resize((column + 1) * self.bins, 0.0);
        }
        // It only fails for buffers of another length than it made itself.
        let done =
            self.fft
                .process_with_scratch(&mut self.input, &mut self.output, &mut self.scratch);
        if done.is_ok() {
            self.counts[column] += 1;
            let sums = &mut self.power[column * self.bins..];
            for (sum, value) in sums.iter_mut().zip(&self.output) {
                *sum += self.scale * value.norm_sqr();
            }
        }
    }

    /// Merges the columns in pairs; a column holds `column` frames from now on.
    fn halve(&mut self, column: u64) {
        self.column = column;
        self.choose_hop();
        let old = self.counts.len();
        let new = old.div_ceil(2);
        for to in 0..new {
            let (one, two) = (2 * to, 2 * to + 1);
            self.counts[to] = self.counts[one] + self.counts.get(two).copied().unwrap_or(0);
            for bin in 0..self.bins {
                let second = self
                    .power
                    .get(two * self.bins + bin)
                    .copied()
                    .unwrap_or(0.0);
                self.power[to * self.bins + bin] = self.power[one * self.bins + bin] + second;
            }
        }
        self.counts.truncate(new);
        self.power.truncate(new * self.bins);
    }

    /// Brings in the transforms whose middles lie before the end, `frames`, with silence after it.
    fn end(&mut self, frames: u64) {
        if self.counts.is_empty() && frames > 0 {
            // A sound shorter than half a hop; its middle has not gone by yet, for a hop is at most half a
            // transform.
            self.next = self.next.min(frames / 2);
        }
        while self.next < frames {
            self.push(0.0);
        }
    }

    /// The mean power of a column, bin by bin. Of the last column the middle of a transform may not be
    /// reached; it is like the one before then.
    fn levels(&self, column: usize) -> Vec<Level> {
        let filled = self.counts.iter().take(column + 1).rposition(|&n| n > 0);
        let Some(column) = filled else {
            return vec![Level::new(0.0); self.bins];
        };
        let count = self.counts[column] as f32;
        self.power[column * self.bins..(column + 1) * self.bins]
            .iter()
            .map(|sum| Level::new(sum / count))
            .collect()
    }

    /// The level in dB of the band from `low` to `high`, in Hz: on a smooth curve through the bins where the
    /// band is narrower than they are, the mean power over it where it is wider.
    fn level(&self, levels: &[Level], low: f32, high: f32) -> f32 {
        let last = levels.len() - 1;
        let (low, high) = (low / self.bin_hz, high / self.bin_hz);
        if high - low < 1.5 {
            let middle = (0.5 * (low + high)).clamp(0.0, last as f32);
            let bin = middle as usize;
            let db = |offset: usize| levels[(bin + offset).saturating_sub(1).min(last)].db;
            let (a, b, c, d) = (db(0), db(1), db(2), db(3));
            let t = middle.fract();
            // Catmull and Rom's cubic.
            let curve = b + 0.5
                * t
                * ((c - a) + t * ((2.0 * a - 5.0 * b + 4.0 * c - d) + t * (3.0 * (b - c) + d - a)));
            curve.clamp(b.min(c) - 3.0, b.max(c) + 3.0)
        } else {
            // A bin reaches half its width to either side.
            let (mut sum, mut widths) = (0.0, 0.0);
            let first = ((low + 0.5) as usize).min(last);
            let end = ((high + 0.5) as usize).min(last) + 1;
            for (bin, level) in levels.iter().enumerate().take(end).skip(first) {
                let width = (bin as f32 + 0.5).min(high) - (bin as f32 - 0.5).max(low);
                sum += width.max(0.0) * level.power;
                widths += width.max(0.0);
            }
            if widths > 0.0 {
                Level::new(sum / widths).db
            } else {
                levels[last].db
            }
        }
    }
}

/// A power, and the same in dB.
#[derive(Clone, Copy)]
struct Level {
    power: f32,
    db: f32,
}

impl Level {
    fn new(power: f32) -> Self {
        Level {
            power,
            db: (10.0 * power.log10()).max(SILENCE_DB),
        }
    }
}

/// Of two powers, all in dB.
fn harmonic_mean(a: f32, b: f32) -> f32 {
    // From the smaller one up, by 3 dB at most; no power of ten overflows so.
    let ratio = 10.0_f32.powf(-0.1 * (a - b).abs());
    a.min(b) + 10.0 * (2.0 / (1.0 + ratio)).log10()
}

/// Smallest and largest sample, column by column.
struct Envelope {
    column: u64,
    filled: u64,
    ranges: Vec<(f32, f32)>,
}

impl Envelope {
    fn new(frames: u64) -> Self {
        let mut column = frames.div_ceil(COLUMNS as u64).max(1);
        while column >= 32 {
            column = column.div_ceil(2);
        }
        Envelope {
            column,
            filled: 0,
            ranges: Vec::new(),
        }
    }

    fn push(&mut self, value: f32) {
        if self.filled == 0 {
            if self.ranges.len() == COLUMNS {
                let merge = |pair: &[(f32, f32)]| {
                    pair.iter()
                        .fold((f32::INFINITY, f32::NEG_INFINITY), |sum, range| {
                            (sum.0.min(range.0), sum.1.max(range.1))
                        })
                };
                self.ranges = self.ranges.chunks(2).map(merge).collect();
                self.column *= 2;
            }
            self.ranges.push((value, value));
        }
        if let Some(range) = self.ranges.last_mut() {
            *range = (range.0.min(value), range.1.max(value));
        }
        self.filled += 1;
        if self.filled == self.column {
            self.filled = 0;
        }
    }

    fn peak(&self) -> f32 {
        self.ranges
            .iter()
            .fold(0.0, |peak, range| peak.max(-range.0).max(range.1))
    }
}

/// The picture itself.
mod plot {
    use super::*;

    const SIZE: (u32, u32) = (1400, 800);
    const LEFT: i32 = 84;
    const WIDTH: i32 = COLUMNS as i32;
    const RIGHT: i32 = LEFT + WIDTH;
    /// The waveform's strip.
    const STRIP: (i32, i32) = (54, 150);
    /// The spectrogram.
    const TOP: i32 = 164;
    const BOTTOM: i32 = 736;
    /// Rows of the spectrogram.
    pub(super) const HEIGHT: i32 = BOTTOM - TOP;
    const BAR: (i32, i32) = (RIGHT + 18, RIGHT + 36);

    const INK: RGBColor = RGBColor(38, 42, 50);
    const FAINT: RGBColor = RGBColor(224, 227, 232);
    const PAPER: RGBColor = RGBColor(255, 255, 255);
    const WAVE: RGBColor = RGBColor(74, 60, 132);

    type Area<'a> = DrawingArea<BitMapBackend<'a>, plotters::coord::Shift>;

    pub(super) fn draw(path: &Path, title: &str, sound: &Spectrogram, cells: &Cells) -> Result<()> {
        // A font of our own: a board or a build machine may have none.
        use_font()?;
        let root = BitMapBackend::new(path, SIZE).into_drawing_area();
        root.fill(&PAPER)?;
        headline(&root, title, sound)?;
        let seconds = if sound.pushed == 0 {
            1.0
        } else {
            sound.seconds()
        };
        waveform(&root, sound, seconds)?;
        let loudest = cells.loudest();
        let top = if loudest > SILENCE_DB {
            loudest.ceil()
        } else {
            0.0
        };
        for x in 0..WIDTH {
            for y in 0..HEIGHT {
                let row = (HEIGHT - 1 - y) as usize;
                let db = cells.between((x as f32 + 0.5) / WIDTH as f32, row);
                root.draw_pixel((LEFT + x, TOP + y), &colour(1.0 + (db - top) / SPAN_DB))?;
            }
        }
        frequencies(&root, cells)?;
        times(&root, seconds)?;
        colour_bar(&root, top, sound.band())?;
        frame(&root, (LEFT, STRIP.0), (RIGHT, STRIP.1))?;
        frame(&root, (LEFT, TOP), (RIGHT, BOTTOM))?;
        root.present()?;
        ends_whole(path)
    }

    /// The encoder does not hear of the disk filling up under its last bytes.
    fn ends_whole(path: &Path) -> Result<()> {
        use std::io::{Read, Seek, SeekFrom};
        let mut end = [0; 8];
        let mut file = std::fs::File::open(path)?;
        file.seek(SeekFrom::End(-8))?;
        file.read_exact(&mut end)?;
        if &end[..4] != b"IEND" {
            bail!("the file ends too early");
        }
        Ok(())
    }

    fn text_style(size: i32, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
        TextStyle::from((FONT, size).into_font())
            .color(&INK)
            .pos(Pos::new(horizontal, vertical))
    }

    fn headline(root: &Area, title: &str, sound: &Spectrogram) -> Result<()> {
        let peak = sound.envelope.peak();
        let level = if peak > 0.0 {
            format!("peak {} dB", signed(20.0 * peak.log10(), 1))
        } else {
            "silence".to_owned()
        };
        let facts = format!(
            "{} kHz  ·  {:.3} s  ·  {level}",
            f64::from(sound.rate) / 1000.0,
            sound.seconds()
        );
        let small = text_style(18, HPos::Right, VPos::Center);
        let taken = root.estimate_text_size(&facts, &small)?.0 as i32;
        root.draw_text(&facts, &small, (RIGHT, 30))?;

        let large = text_style(26, HPos::Left, VPos::Center);
        let room = WIDTH - taken - 30;
        let mut text: String = title
            .chars()
            .take(200)
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        let mut shown = text.clone();
        while root.estimate_text_size(&shown, &large)?.0 as i32 > room && text.pop().is_some() {
            shown = format!("{}…", text.trim_end());
        }
        root.draw_text(&shown, &large, (LEFT, 28))?;
        Ok(())
    }

    fn waveform(root: &Area, sound: &Spectrogram, seconds: f64) -> Result<()> {
        let envelope = &sound.envelope;
        let middle = (STRIP.0 + STRIP.1) / 2;
        let half = (STRIP.1 - STRIP.0) / 2 - 5;
        let peak = envelope.peak();
        let scale = if peak > 0.0 { peak } else { 1.0 };
        let (step, _) = time_step(seconds);
        for tick in 1..=(seconds / step) as i32 {
            let x = LEFT + (f64::from(tick) * step / seconds * f64::from(WIDTH)) as i32;
            line(root, (x, STRIP.0), (x, STRIP.1), &FAINT)?;
        }
        line(root, (LEFT, middle), (RIGHT, middle), &FAINT)?;
        let y = |value: f32| middle - (value / scale * half as f32).round() as i32;
        let columns = sound.pushed as f64 / envelope.column as f64;
        let mut before: Option<(i32, i32)> = None;
        for x in 0..WIDTH {
            let first = f64::from(x) / f64::from(WIDTH) * columns;
            let last = f64::from(x + 1) / f64::from(WIDTH) * columns;
            let end = ((last.ceil() as usize).max(first as usize + 1)).min(envelope.ranges.len());
            let Some(ranges) = envelope.ranges.get(first as usize..end) else {
                break;
            };
            let low = ranges
                .iter()
                .fold(f32::INFINITY, |low, range| low.min(range.0));
            let high = ranges
                .iter()
                .fold(f32::NEG_INFINITY, |high, range| high.max(range.1));
            if low > high {
                break;
            }
            let (mut upper, mut lower) = (y(high), y(low));
            let here = (upper, lower);
            // Joined to the neighbour, so that a few samples are a line and not a row of dots.
            if let Some((before_upper, before_lower)) = before {
                upper = upper.min(before_lower);
                lower = lower.max(before_upper);
            }
            before = Some(here);
            line(root, (LEFT + x, upper), (LEFT + x, lower), &WAVE)?;
        }
        let style = text_style(15, HPos::Right, VPos::Center);
        for (value, at) in [
            (scale, middle - half),
            (0.0, middle),
            (-scale, middle + half),
        ] {
            root.draw_text(&amplitude(value), &style, (LEFT - 10, at + 2))?;
        }
        Ok(())
    }

    fn frequencies(root: &Area, cells: &Cells) -> Result<()> {
        let style = text_style(17, HPos::Right, VPos::Center);
        let octaves = (cells.highest / cells.lowest).ln();
        for decade in [0.1, 1.0, 10.0, 100.0, 1_000.0, 10_000.0_f32] {
            for digit in 1..=9_u8 {
                let hertz = decade * f32::from(digit);
                let way = (hertz / cells.lowest).ln() / octaves;
                if !(-0.001..=1.001).contains(&way) {
                    continue;
                }
                let y = BOTTOM - (way * HEIGHT as f32).round() as i32;
                if matches!(digit, 1 | 2 | 5) {
                    line(root, (LEFT - 6, y), (LEFT, y), &INK)?;
                    if y > TOP + 1 && y < BOTTOM - 1 {
                        line(root, (LEFT, y), (RIGHT, y), &WHITE.mix(0.13))?;
                    }
                    let label = if hertz >= 1000.0 {
                        format!("{}k", (hertz / 1000.0).round())
                    } else {
                        format!("{hertz}")
                    };
                    root.draw_text(&label, &style, (LEFT - 10, y + 2))?;
                } else {
                    line(root, (LEFT - 3, y), (LEFT, y), &INK)?;
                }
            }
        }
        let turned = TextStyle::from((FONT, 17).into_font().transform(FontTransform::Rotate270))
            .color(&INK)
            .pos(Pos::new(HPos::Center, VPos::Center));
        root.draw_text("frequency (Hz)", &turned, (22, (TOP + BOTTOM) / 2))?;
        Ok(())
    }

    /// Seconds from one label to the next, 1, 2 or 5 times a power of ten, and the decimals it needs.
    fn time_step(seconds: f64) -> (f64, usize) {
        let rough = (seconds / 12.0).max(1.0e-7);
        let power = rough.log10().floor();
        let decade = 10.0_f64.powf(power);
        let (digit, carry) = match rough / decade {
            r if r <= 1.0 => (1.0, 0.0),
            r if r <= 2.0 => (2.0, 0.0),
            r if r <= 5.0 => (5.0, 0.0),
            _ => (10.0, 1.0),
        };
        (digit * decade, (-(power + carry)).max(0.0) as usize)
    }

    fn times(root: &Area, seconds: f64) -> Result<()> {
        let style = text_style(17, HPos::Center, VPos::Center);
        let (step, decimals) = time_step(seconds);
        for tick in 0..=(seconds / step + 1.0e-9) as i32 {
            let time = f64::from(tick) * step;
            let x = LEFT + (time / seconds * f64::from(WIDTH)).round() as i32;
            line(root, (x, BOTTOM), (x, BOTTOM + 6), &INK)?;
            root.draw_text(&format!("{time:.decimals$}"), &style, (x, BOTTOM + 18))?;
        }
        root.draw_text("time (s)", &style, ((LEFT + RIGHT) / 2, BOTTOM + 44))?;
        Ok(())
    }

    fn colour_bar(root: &Area, top: f32, band: f32) -> Result<()> {
        let y_of = |db: f32| TOP + ((top - db) / SPAN_DB * HEIGHT as f32).round() as i32;
        for y in 0..HEIGHT {
            let shade = colour(1.0 - (y as f32 + 0.5) / HEIGHT as f32);
            line(root, (BAR.0, TOP + y), (BAR.1 - 1, TOP + y), &shade)?;
        }
        frame(root, (BAR.0, TOP), (BAR.1, BOTTOM))?;
        let style = text_style(17, HPos::Left, VPos::Center);
        let mut db = (top / 10.0).floor() * 10.0;
        while db >= top - SPAN_DB {
            let y = y_of(db);
            line(root, (BAR.1, y), (BAR.1 + 5, y), &INK)?;
            root.draw_text(&signed(db, 0), &style, (BAR.1 + 9, y + 2))?;
            db -= 10.0;
        }
        let unit = format!("dB in {band:.0} Hz");
        root.draw_text(&unit, &style, (BAR.0, TOP - 12))?;
        Ok(())
    }

    fn frame(root: &Area, from: (i32, i32), to: (i32, i32)) -> Result<()> {
        root.draw(&Rectangle::new(
            [(from.0 - 1, from.1 - 1), to],
            INK.stroke_width(1),
        ))?;
        Ok(())
    }

    fn line(root: &Area, from: (i32, i32), to: (i32, i32), colour: &impl Color) -> Result<()> {
        root.draw(&PathElement::new([from, to], colour.stroke_width(1)))?;
        Ok(())
    }

    /// With a minus that is as wide as a digit, and none before 0.
    fn signed(value: f32, decimals: usize) -> String {
        let text = format!("{value:.decimals$}");
        match text.strip_prefix('-') {
            Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
            Some(rest) => format!("−{rest}"),
            None => text,
        }
    }

    /// An amplitude to two or three digits.
    fn amplitude(value: f32) -> String {
        let size = value.abs();
        if size != 0.0 && !(0.001..1000.0).contains(&size) {
            return format!("{value:.0e}").replace('-', "−");
        }
        let decimals = match size {
            s if s >= 10.0 => 0,
            s if s >= 0.1 || s == 0.0 => 2,
            s if s >= 0.01 => 3,
            _ => 4,
        };
        if size == 0.0 {
            "0".to_owned()
        } else {
            signed(value, decimals)
        }
    }

    /// The map "magma" by van der Walt and Smith (CC0), at ninths: it brightens evenly, in grey, too.
    const MAGMA: [[f32; 3]; 10] = [
        [0.0, 0.0, 4.0],
        [24.0, 15.0, 62.0],
        [69.0, 16.0, 119.0],
        [114.0, 31.0, 129.0],
        [158.0, 47.0, 127.0],
        [205.0, 64.0, 113.0],
        [241.0, 96.0, 93.0],
        [253.0, 149.0, 103.0],
        [254.0, 201.0, 141.0],
        [252.0, 253.0, 191.0],
    ];

    /// From 0, the darkest, to 1.
    fn colour(brightness: f32) -> RGBColor {
        let at = brightness.clamp(0.0, 1.0) * (MAGMA.len() - 1) as f32;
        let low = (at as usize).min(MAGMA.len() - 2);
        let mix = |channel: usize| {
            let (from, to) = (MAGMA[low][channel], MAGMA[low + 1][channel]);
            (from + (to - from) * (at - low as f32)).round() as u8
        };
        RGBColor(mix(0), mix(1), mix(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    struct Scratch(PathBuf);

    impl Scratch {
        fn new(name: &str) -> Self {
            Scratch(
                std::env::temp_dir().join(format!("freshet-picture-{}-{name}", std::process::id())),
            )
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    fn sine(rate: u32, frames: u64, hertz: f64) -> Spectrogram {
        let mut sound = Spectrogram::new(rate, frames);
        for i in 0..frames {
            let turns = (i as f64 * hertz / f64::from(rate)).fract();
            let value = (turns * std::f64::consts::TAU).sin() as f32;
            sound.push(value, value);
        }
        sound
    }

    fn noise(frames: u64, promised: u64) -> Spectrogram {
        let mut sound = Spectrogram::new(48_000, promised);
        let mut seed = 1_u64;
        for _ in 0..frames {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let value = (seed >> 40) as f32 / (1 << 23) as f32 - 1.0;
            sound.push(value, value);
        }
        sound
    }

    /// Frequency and level of the loudest row of the middle column.
    fn loudest(mut sound: Spectrogram) -> (f32, f32) {
        let cells = sound.cells(500);
        let middle = cells.columns() / 2;
        let column = &cells.db[middle * 500..(middle + 1) * 500];
        let row = (0..500)
            .max_by(|&a, &b| column[a].total_cmp(&column[b]))
            .unwrap();
        (cells.frequency(row as f32), column[row])
    }

    fn mean_level(cells: &Cells, low: f32, high: f32) -> f32 {
        let rows =
            (0..cells.rows).filter(|&row| (low..high).contains(&cells.frequency(row as f32)));
        let mut sum = (0.0, 0.0);
        for row in rows {
            for column in 0..cells.columns() {
                sum.0 += 10.0_f32.powf(0.1 * cells.db[column * cells.rows + row]);
                sum.1 += 1.0;
            }
        }
        10.0 * (sum.0 / sum.1).log10()
    }

    #[test]
    fn a_sine_is_loudest_within_three_percent_of_its_pitch_at_its_level() {
        for rate in [44_100, 48_000, 96_000] {
            for hertz in [90.0, 300.0, 1_000.0, 8_000.0] {
                let (found, level) = loudest(sine(rate, u64::from(rate), hertz));
                let off = found / hertz as f32 - 1.0;
                assert!(off.abs() < 0.03, "{hertz} Hz at {rate} Hz: {found} Hz");
                assert!(
                    (-5.0..3.0).contains(&level),
                    "{hertz} Hz at {rate} Hz: {level} dB"
                );
            }
        }
    }

    #[test]
    fn noise_passes_evenly_from_the_long_transform_to_the_short_one() {
        let cells = noise(48_000 * 60, 48_000 * 60).cells(500);
        let below = mean_level(&cells, 80.0, 250.0);
        let above = mean_level(&cells, 700.0, 2_000.0);
        assert!(
            (below - above).abs() < 1.0,
            "{below} dB below, {above} dB above"
        );
    }

    #[test]
    fn memory_stays_flat_and_the_level_true_whatever_length_was_promised() {
        let expected = mean_level(&noise(480_000, 480_000).cells(100), 1_000.0, 4_000.0);
        for promised in [0, 100_000, 480_001, 1 << 40, u64::MAX] {
            let mut sound = noise(480_000, promised);
            let cells = sound.cells(100);
            assert!(
                (500..=COLUMNS).contains(&cells.columns()),
                "{}",
                cells.columns()
            );
            assert!(sound.envelope.ranges.len() <= COLUMNS);
            let level = mean_level(&cells, 1_000.0, 4_000.0);
            assert!(
                (level - expected).abs() < 0.5,
                "{promised}: {level} dB, not {expected} dB"
            );
        }
    }

    #[test]
    fn a_click_stands_where_it_was() {
        for frames in [4_800, 48_000, 480_000] {
            let mut sound = Spectrogram::new(48_000, frames);
            for i in 0..frames {
                let value = if i == frames / 3 { 1.0 } else { 0.0 };
                sound.push(value, value);
            }
            let cells = sound.cells(100);
            let total = |column: usize| -> f32 {
                let levels = &cells.db[column * 100..(column + 1) * 100];
                levels.iter().map(|db| 10.0_f32.powf(0.1 * db)).sum()
            };
            let column = (0..cells.columns())
                .max_by(|&a, &b| total(a).total_cmp(&total(b)))
                .unwrap();
            let place = (column as f32 + 0.5) / cells.span;
            assert!(
                (place - 1.0 / 3.0).abs() < 1.5 / cells.span + 0.005,
                "{frames}: {place}"
            );
        }
    }

    #[test]
    fn silence_nothing_a_few_frames_and_odd_numbers_all_give_a_picture() {
        for (name, rate, frames, value) in [
            ("nothing.png", 48_000, 0, 0.0),
            ("silence.png", 48_000, 1_000, 0.0),
            ("one.PNG", 48_000, 1, 1.0),
            ("seven.png", 48_000, 7, -0.5),
            ("nan.png", 8_000, 5_000, f32::NAN),
            ("huge.png", 48_000, 5_000, f32::MAX),
            ("slow.png", 0, 300, 0.1),
            ("fast.png", u32::MAX, 300, 0.1),
        ] {
            let path = Scratch::new(name);
            let mut sound = Spectrogram::new(rate, frames);
            for _ in 0..frames {
                sound.push(value, value);
            }
            sound
                .write_png(&path.0, "a\ntitle \u{1F4A7} of any kind")
                .unwrap();
            let bytes = std::fs::read(&path.0).unwrap();
            assert!(bytes.starts_with(b"\x89PNG"), "{name}");
            // Width and height.
            assert_eq!(bytes[16..24], [0, 0, 5, 120, 0, 0, 3, 32], "{name}");
        }
    }

    #[test]
    fn a_picture_that_cannot_be_written_is_named_with_what_to_do() {
        let folder = std::env::temp_dir().join("no-such-folder");
        let refusal = |path: &Path| {
            let error = Spectrogram::new(48_000, 0).write_png(path, "").unwrap_err();
            format!("{error:#}")
        };
        let text = refusal(&folder.join("x.png"));
        assert!(
            text.contains("x.png") && text.contains("does the folder exist"),
            "{text}"
        );
        assert!(!text.contains("os error"), "{text}");
        let text = refusal(Path::new("x.wav"));
        assert!(text.contains("expected a name that ends in .png"), "{text}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_reported() {
        let path = Scratch::new("full.png");
        std::os::unix::fs::symlink("/dev/full", &path.0).unwrap();
        let error = Spectrogram::new(48_000, 0)
            .write_png(&path.0, "")
            .unwrap_err();
        assert!(error.to_string().contains("is the disk full?"), "{error}");
    }
}
