//! Reads bubbles from CSV, one bubble a row, in flat memory however many there are.
//!
//! ```csv
//! # comments and blank lines are skipped
//! time,radius_mm,amplitude,rise_factor
//! 0.0125,1.5,0.02,0
//! ```
//!
//! | column | unit | range |
//! |---|---|---|
//! | `time` | s | from 0, never decreasing |
//! | `radius_m` or `radius_mm` | m or mm | 0.15 mm to 150 mm |
//! | `amplitude` | Pa at 1 m | −8 to 8 |
//! | `rise_factor` (may be absent: 0) | 1 | 0 to 100 |
//!
//! Columns stand in any order, and others are ignored.

use anyhow::{Result, anyhow};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use crate::scene_file::cannot_read;

/// Largest amplitude a bubble may have, in Pa at 1 m: what the bus between sources and mixer holds.
const MAX_AMPLITUDE: f64 = freshet::fixed::BUBBLE_MAX_PA as f64;
const MIN_RADIUS_MM: f64 = 0.15;
const MAX_RADIUS_MM: f64 = 150.0;
const MAX_RISE_FACTOR: f64 = 100.0;

/// A limit written by another program, in another unit or in single precision, may be off by its last digit.
const SLACK: f64 = 1.0e-7;

/// Longest line read, in bytes; what is longer is no table of bubbles and must not fill the memory.
const MAX_LINE_BYTES: usize = 1 << 16;

const BUFFER_BYTES: usize = 1 << 17;

/// One bubble that starts to ring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BubbleEvent {
    /// When it starts, in s from the beginning of the scene.
    pub time: f64,
    /// Equilibrium radius in m.
    pub radius: f64,
    /// Initial amplitude in Pa at 1 m; the sign is that of the first swing.
    pub amplitude: f64,
    /// How fast the pitch rises, without unit; 0 does not rise.
    pub rise_factor: f64,
    /// Line of the file, counted from 1.
    pub line: u64,
}

/// The bubbles of one file in the order of their times: an iterator of `Result<BubbleEvent>` that ends after
/// the first error.
pub struct BubbleEvents {
    lines: Lines,
    columns: Columns,
    /// Time and line of the row before.
    last: (f64, u64),
    ended: bool,
}

impl BubbleEvents {
    /// Opens the file and reads as far as its header.
    ///
    /// # Errors
    /// A file that cannot be read, is empty or not UTF-8; a header that lacks a column, has one twice or has
    /// both radius columns. Every message names the file, and the line where there is one.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| cannot_read(path, &error))?;
        Self::read(path, Box::new(file))
    }

    fn read(path: &Path, source: Box<dyn Read + Send>) -> Result<Self> {
        let mut lines = Lines {
            path: path.to_owned(),
            reader: BufReader::with_capacity(BUFFER_BYTES, source),
            text: String::new(),
            number: 0,
            complete: true,
        };
        if !lines.advance()? {
            return Err(anyhow!(
                "{}: the file is empty; expected a header line such as `time,radius_mm,amplitude,rise_factor`",
                path.display()
            ));
        }
        let columns = Columns::find(&lines)?;
        Ok(BubbleEvents {
            lines,
            columns,
            last: (0.0, 0),
            ended: false,
        })
    }

    fn row(&mut self) -> Result<Option<BubbleEvent>> {
        if !self.lines.advance()? {
            return Ok(None);
        }
        let lines = &self.lines;
        let columns = &self.columns;
        let mut values = Values::default();
        let mut count = 0;
        let unquoted;
        if lines.quoted() {
            unquoted = lines.unquoted()?;
            for field in &unquoted {
                values.take(columns, count, field);
                count += 1;
            }
        } else {
            for field in fields(lines.text()) {
                values.take(columns, count, field);
                count += 1;
            }
        }
        if count != columns.names.len() {
            return Err(lines.error(format_args!(
                "expected {} fields ({}), got {count}{}",
                columns.names.len(),
                columns.names.join(","),
                if count > columns.names.len() {
                    " (decimals are written with a point, and a text with a comma in it stands in quotes)"
                } else if lines.complete {
                    " (is the row cut off?)"
                } else {
                    " (the file ends in the middle of this row: was it copied whole?)"
                }
            )));
        }

        let time = lines.number("time", values.time, &TIME)?;
        let (radius_name, radius_range, per_metre) = if columns.millimetres {
            ("radius_mm", &RADIUS_MM, 1000.0)
        } else {
            ("radius_m", &RADIUS_M, 1.0)
        };
        let radius = lines.number(radius_name, values.radius, radius_range)? / per_metre;
        let amplitude = lines.number("amplitude", values.amplitude, &AMPLITUDE)?;
        let rise_factor = match columns.rise_factor {
            Some(_) => lines.number("rise_factor", values.rise_factor, &RISE_FACTOR)?,
            None => 0.0,
        };
        let (last_time, last_line) = self.last;
        if time < last_time {
            return Err(lines.error(format_args!(
                "column `time`: {time} s comes after {last_time} s in line {last_line}, but times must not \
                 decrease (sort the file by time)"
            )));
        }
        self.last = (time, lines.number);
        Ok(Some(BubbleEvent {
            time,
            radius,
            amplitude,
            rise_factor,
            line: lines.number,
        }))
    }
}

impl Iterator for BubbleEvents {
    type Item = Result<BubbleEvent>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let row = self.row().transpose();
        self.ended = !matches!(row, Some(Ok(_)));
        row
    }
}

/// Numbers a column may hold, and how a person is told.
struct Range {
    min: f64,
    max: f64,
    expected: &'static str,
    hint: &'static str,
}

const TIME: Range = Range {
    min: 0.0,
    max: f64::MAX,
    expected: "a number from 0 (seconds)",
    hint: "",
};
const RADIUS_MM: Range = Range {
    min: MIN_RADIUS_MM * (1.0 - SLACK),
    max: MAX_RADIUS_MM * (1.0 + SLACK),
    expected: "a number from 0.15 to 150 (millimetres)",
    hint: " (is the column in millimetres? metres are called `radius_m`)",
};
const RADIUS_M: Range = Range {
    min: MIN_RADIUS_MM / 1000.0 * (1.0 - SLACK),
    max: MAX_RADIUS_MM / 1000.0 * (1.0 + SLACK),
    expected: "a number from 0.00015 to 0.15 (metres)",
    hint: " (is the column in metres? millimetres are called `radius_mm`)",
};
const AMPLITUDE: Range = Range {
    min: -MAX_AMPLITUDE,
    max: MAX_AMPLITUDE,
    expected: "a number from -8 to 8 (Pa at 1 m)",
    hint: " (8 Pa is the most that the mixing bus holds: scale the whole column down)",
};
const RISE_FACTOR: Range = Range {
    min: 0.0,
    max: MAX_RISE_FACTOR,
    expected: "a number from 0 to 100",
    hint: "",
};

/// The fields of one row that mean something, still as text.
#[derive(Default)]
struct Values<'a> {
    time: &'a str,
    radius: &'a str,
    amplitude: &'a str,
    rise_factor: &'a str,
}

impl<'a> Values<'a> {
    fn take(&mut self, columns: &Columns, index: usize, field: &'a str) {
        if index == columns.time {
            self.time = field;
        } else if index == columns.radius {
            self.radius = field;
        } else if index == columns.amplitude {
            self.amplitude = field;
        } else if Some(index) == columns.rise_factor {
            self.rise_factor = field;
        }
    }
}

/// Which column stands where.
struct Columns {
    names: Vec<String>,
    time: usize,
    radius: usize,
    millimetres: bool,
    amplitude: usize,
    rise_factor: Option<usize>,
}

impl Columns {
    fn find(lines: &Lines) -> Result<Self> {
        let names: Vec<String> = if lines.quoted() {
            lines.unquoted()?.iter().map(name).collect()
        } else {
            fields(lines.text()).map(name).collect()
        };
        if names.iter().all(|name| name.parse::<f64>().is_ok()) {
            return Err(lines.error(format_args!(
                "expected a header that names the columns, got the numbers `{}` (put a line such as \
                 `time,radius_mm,amplitude,rise_factor` above them, without `#`)",
                shortened(lines.text())
            )));
        }
        let position = |wanted: &str| -> Result<Option<usize>> {
            let mut found = (0..names.len()).filter(|&index| names[index] == wanted);
            let first = found.next();
            match found.next() {
                None => Ok(first),
                Some(_) => Err(lines.error(format_args!(
                    "column `{wanted}` stands twice in the header; expected it once (rename or remove one)"
                ))),
            }
        };
        let missing = |wanted: &str| {
            let wanted_names: Vec<&str> = wanted.split(" or ").collect();
            let near = names
                .iter()
                .find(|name| wanted_names.iter().any(|w| w.eq_ignore_ascii_case(name)));
            let hint = if let Some(near) = near {
                format!(" (`{near}` must be written in lower case)")
            } else if names.len() == 1 && names[0].contains([';', '\t']) {
                " (columns are separated by commas)".to_owned()
            } else {
                String::new()
            };
            lines.error(format_args!(
                "expected a column `{}` in the header, got `{}`{hint}",
                wanted_names.join("` or `"),
                shortened(&names.join(","))
            ))
        };

        let time = position("time")?;
        let metres = position("radius_m")?;
        let millimetres = position("radius_mm")?;
        let amplitude = position("amplitude")?;
        let rise_factor = position("rise_factor")?;
        let radius = match (metres, millimetres) {
            (Some(_), Some(_)) => {
                return Err(lines.error(format_args!(
                    "expected one of the columns `radius_m` and `radius_mm`, got both (remove one)"
                )));
            }
            (metres, millimetres) => metres.or(millimetres),
        };
        Ok(Columns {
            time: time.ok_or_else(|| missing("time"))?,
            radius: radius.ok_or_else(|| missing("radius_m or radius_mm"))?,
            millimetres: millimetres.is_some(),
            amplitude: amplitude.ok_or_else(|| missing("amplitude"))?,
            rise_factor,
            names,
        })
    }
}

/// The text between the commas. Byte by byte: for numbers this short the library's search is slower.
fn fields(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let comma = text.bytes().position(|byte| byte == b',');
        rest = comma.map(|at| &text[at + 1..]);
        Some(comma.map_or(text, |at| &text[..at]))
    })
}

fn name(field: &str) -> String {
    field.trim_ascii().to_owned()
}

/// The lines that carry something, one at a time.
///
/// Not the CSV reader's own lines: it numbers a row by where the comments and blank lines before it begin,
/// and holds a line of any length in memory.
struct Lines {
    path: PathBuf,
    reader: BufReader<Box<dyn Read + Send>>,
    text: String,
    /// Counted from 1; 0 before the first.
    number: u64,
    /// Whether the line ends with a line feed; only the last one of a file may not.
    complete: bool,
}

impl Lines {
    /// Reads the next line that is neither blank nor a comment; `false` at the end of the file.
    fn advance(&mut self) -> Result<bool> {
        loop {
            let mut bytes = std::mem::take(&mut self.text).into_bytes();
            bytes.clear();
            let length = self
                .reader
                .by_ref()
                .take(MAX_LINE_BYTES as u64 + 1)
                .read_until(b'\n', &mut bytes)
                .map_err(|error| cannot_read(&self.path, &error))?;
            if length == 0 {
                return Ok(false);
            }
            self.number += 1;
            self.complete = bytes.last() == Some(&b'\n');
            if bytes.len() > MAX_LINE_BYTES {
                return Err(self.error(format_args!(
                    "expected a row of a few numbers, got a line of more than {MAX_LINE_BYTES} bytes (is this a \
                     CSV file?)"
                )));
            }
            self.text = String::from_utf8(bytes).map_err(|_| {
                self.error(format_args!(
                    "expected text in UTF-8, got other bytes (save the file as CSV in UTF-8)"
                ))
            })?;
            if self.number == 1 && self.text.starts_with('\u{feff}') {
                self.text.remove(0);
            }
            let text = self.text();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(true);
            }
        }
    }

    fn text(&self) -> &str {
        self.text.trim_ascii()
    }

    fn quoted(&self) -> bool {
        self.text.as_bytes().contains(&b'"')
    }

    /// The fields of a line with quotes in it, which is rare: only a column that is ignored needs them.
    fn unquoted(&self) -> Result<csv::StringRecord> {
        let mut record = csv::StringRecord::new();
        let quotes = self.text.bytes().filter(|&byte| byte == b'"').count();
        let read = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(self.text().as_bytes())
            .read_record(&mut record);
        if quotes % 2 != 0 || read.is_err() {
            return Err(self.error(format_args!(
                "a text in quotes does not end in this line (close it with `\"`; it cannot hold a line break)"
            )));
        }
        Ok(record)
    }

    fn number(&self, column: &str, field: &str, range: &Range) -> Result<f64> {
        let field = field.trim_ascii();
        match field.parse::<f64>().ok() {
            // Neither NaN nor an infinity is in any range.
            Some(value) if (range.min..=range.max).contains(&value) => Ok(value),
            Some(value) => Err(self.error(format_args!(
                "column `{column}`: expected {}, got `{}`{}",
                range.expected,
                shortened(field),
                if value.is_finite() { range.hint } else { "" }
            ))),
            None if field.is_empty() => Err(self.error(format_args!(
                "column `{column}`: expected {}, got nothing (every row needs a value)",
                range.expected
            ))),
            None => Err(self.error(format_args!(
                "column `{column}`: expected {}, got `{}`",
                range.expected,
                shortened(field)
            ))),
        }
    }

    #[cold]
    fn error(&self, message: std::fmt::Arguments<'_>) -> anyhow::Error {
        anyhow!("{}:{}: {message}", self.path.display(), self.number)
    }
}

/// What was read, for a message: one line of it, harmless to a terminal.
fn shortened(text: &str) -> String {
    const MOST: usize = 60;
    let mut short: String = text
        .chars()
        .take(MOST)
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    if text.chars().nth(MOST).is_some() {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    const HEADER: &str = "time,radius_mm,amplitude,rise_factor\n";

    struct Scratch(PathBuf);

    impl Scratch {
        fn new(content: impl AsRef<[u8]>) -> Self {
            static COUNT: AtomicU32 = AtomicU32::new(0);
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let path = std::env::temp_dir()
                .join(format!("freshet-events-{}-{count}.csv", std::process::id()));
            std::fs::write(&path, content).unwrap();
            Scratch(path)
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    fn events(content: impl AsRef<[u8]>) -> Vec<BubbleEvent> {
        let file = Scratch::new(content);
        BubbleEvents::open(&file.0)
            .unwrap()
            .map(|event| event.unwrap())
            .collect()
    }

    /// The message for `content`, which has to name the file.
    fn refusal(content: impl AsRef<[u8]>) -> String {
        let file = Scratch::new(content);
        let error = match BubbleEvents::open(&file.0) {
            Err(error) => error,
            Ok(mut events) => {
                let error = events.find_map(|event| event.err()).expect("no error");
                assert!(events.next().is_none(), "goes on after an error");
                error
            }
        };
        let text = format!("{error:#}");
        let name = file.0.display().to_string();
        assert!(text.starts_with(&name), "{text}");
        text[name.len()..].to_owned()
    }

    fn row_refusal(row: &str) -> String {
        refusal(format!("{HEADER}{row}\n"))
    }

    #[test]
    fn columns_stand_in_any_order_and_others_are_ignored() {
        let read = events(
            "note, amplitude ,time,id,rise_factor,radius_m\n\
             \"big, \"\"round\"\"\",-0.5, 0.25 ,7,1e-1,0.0015\n\
             plain,8,0.25,,100,.15\n",
        );
        let first = BubbleEvent {
            time: 0.25,
            radius: 0.0015,
            amplitude: -0.5,
            rise_factor: 0.1,
            line: 2,
        };
        assert_eq!(read[0], first);
        assert_eq!((read[1].radius, read[1].amplitude), (0.15, 8.0));
        assert_eq!(read.len(), 2);
    }

    #[test]
    fn millimetres_become_metres_and_an_absent_rise_factor_is_zero() {
        let read = events("time,radius_mm,amplitude\n0,1.5,0.02\n");
        assert_eq!(read[0].radius, 0.0015);
        assert_eq!(read[0].rise_factor, 0.0);
    }

    #[test]
    fn byte_order_mark_windows_lines_comments_and_blank_lines_keep_the_line_numbers_true() {
        let read = events(
            "\u{feff}# made by hand, \"quoted\r\n\r\n\"time\",\"radius_mm\",\"amplitude\"\r\n# a comment\r\n \r\n\
             0,1,0.1\r\n\r\n  # another\r\n1,1,0.1",
        );
        assert_eq!(read.iter().map(|e| e.line).collect::<Vec<_>>(), [6, 9]);
        assert_eq!(read[1].time, 1.0);
    }

    #[test]
    fn a_header_alone_is_a_file_without_bubbles() {
        assert!(events(HEADER).is_empty());
        assert!(events(HEADER.trim_end()).is_empty());
    }

    #[test]
    fn an_empty_file_is_refused_with_the_header_it_needs() {
        for content in ["", "\n\n", "# only a comment\n"] {
            let text = refusal(content);
            assert!(text.contains("the file is empty"), "{text}");
            assert!(
                text.contains("time,radius_mm,amplitude,rise_factor"),
                "{text}"
            );
        }
    }

    #[test]
    fn a_file_without_a_header_is_refused() {
        let text = refusal("\n0,1.5,0.02,0\n");
        assert!(text.starts_with(":2: expected a header"), "{text}");
        assert!(text.contains("`0,1.5,0.02,0`"), "{text}");
    }

    #[test]
    fn a_missing_column_is_named() {
        let text = refusal("radius_mm,amplitude\n");
        assert!(text.starts_with(":1: expected a column `time`"), "{text}");
        let text = refusal("time,radius,amplitude\n");
        assert!(
            text.contains("expected a column `radius_m` or `radius_mm`"),
            "{text}"
        );
        assert!(text.contains("got `time,radius,amplitude`"), "{text}");
        let text = refusal("time,radius_mm\n");
        assert!(text.contains("expected a column `amplitude`"), "{text}");
        let text = refusal("Time,radius_mm,amplitude\n");
        assert!(
            text.contains("`Time` must be written in lower case"),
            "{text}"
        );
        let text = refusal("time;radius_mm;amplitude\n0;1;1\n");
        assert!(text.contains("columns are separated by commas"), "{text}");
    }

    #[test]
    fn a_column_that_stands_twice_and_both_radius_columns_are_refused() {
        let text = refusal("time,radius_mm,amplitude,time\n");
        assert!(text.starts_with(":1: column `time` stands twice"), "{text}");
        let text = refusal("time,radius_mm,amplitude,radius_m\n");
        assert!(
            text.contains("`radius_m` and `radius_mm`, got both"),
            "{text}"
        );
    }

    #[test]
    fn a_row_with_too_few_or_too_many_fields_is_refused() {
        let text = row_refusal("0,1");
        assert!(
            text.starts_with(":2: expected 4 fields (time,radius_mm,"),
            "{text}"
        );
        assert!(text.contains("got 2 (is the row cut off?)"), "{text}");
        let text = row_refusal("0,1,1,0,");
        assert!(
            text.contains("expected 4 fields") && text.contains("got 5"),
            "{text}"
        );
        let text = refusal(format!("{HEADER}0,1,1,0\n0,1"));
        assert!(
            text.starts_with(":3: ") && text.contains("was it copied whole?"),
            "{text}"
        );
    }

    #[test]
    fn what_is_no_number_is_refused_with_column_and_range() {
        let text = row_refusal("0,abc,1,0");
        assert!(
            text.starts_with(":2: column `radius_mm`: expected a number from 0.15 to 150"),
            "{text}"
        );
        assert!(text.contains("got `abc`"), "{text}");
        for odd in ["NaN", "inf", "-inf", "1e999", "0x10", "1_000", "5 mm", "١"] {
            for (column, row) in [
                ("time", format!("{odd},1,1,0")),
                ("radius_mm", format!("0,{odd},1,0")),
                ("amplitude", format!("0,1,{odd},0")),
                ("rise_factor", format!("0,1,1,{odd}")),
            ] {
                let text = row_refusal(&row);
                assert!(
                    text.starts_with(&format!(":2: column `{column}`: expected")),
                    "{text}"
                );
                assert!(text.contains(&format!("got `{odd}`")), "{text}");
            }
        }
        let text = row_refusal("0,,1,0");
        assert!(
            text.contains("column `radius_mm`") && text.contains("got nothing"),
            "{text}"
        );
    }

    #[test]
    fn numbers_out_of_range_are_refused_with_what_to_do() {
        let text = row_refusal("-0.1,1,1,0");
        assert!(
            text.contains("column `time`: expected a number from 0"),
            "{text}"
        );
        for radius in ["0.149", "151", "0", "-1"] {
            let text = row_refusal(&format!("0,{radius},1,0"));
            assert!(text.contains("is the column in millimetres?"), "{text}");
        }
        let text = refusal("time,radius_m,amplitude\n0,1.5,1\n");
        assert!(
            text.contains("from 0.00015 to 0.15 (metres), got `1.5`"),
            "{text}"
        );
        for amplitude in ["8.01", "-9"] {
            let text = row_refusal(&format!("0,1,{amplitude},0"));
            assert!(
                text.contains("column `amplitude`: expected a number from -8 to 8"),
                "{text}"
            );
            assert!(
                text.contains("bus") && text.contains("scale the whole column"),
                "{text}"
            );
        }
        for rise in ["-0.1", "101"] {
            let text = row_refusal(&format!("0,1,1,{rise}"));
            assert!(
                text.contains("column `rise_factor`: expected a number from 0 to 100"),
                "{text}"
            );
        }
    }

    #[test]
    fn the_limits_themselves_are_accepted_with_a_last_digit_of_slack() {
        let read = events(format!(
            "{HEADER}0,0.15,8,0\n0,150,-8,100\n0,0.14999999999,0,0\n0,150.00000001,0,0\n"
        ));
        assert_eq!(read.len(), 4);
        assert_eq!(
            events("time,radius_m,amplitude\n0,0.00015,1\n0,0.15,1\n").len(),
            2
        );
    }

    #[test]
    fn times_that_decrease_are_refused_with_both_lines() {
        let text = refusal(format!(
            "{HEADER}0.5,1,1,0\n# note\n0.5,1,1,0\n0.25,1,1,0\n"
        ));
        assert!(
            text.starts_with(":5: column `time`: 0.25 s comes after 0.5 s in line 4"),
            "{text}"
        );
        assert!(text.contains("sort the file by time"), "{text}");
    }

    #[test]
    fn what_is_not_utf8_is_refused_with_its_line() {
        let text = refusal(b"time,radius_mm,amplitude\n0,1,1\n0,1\xb5,1\n");
        assert!(text.starts_with(":3: expected text in UTF-8"), "{text}");
        let text = refusal(b"\xff\xfet\0i\0m\0e\0");
        assert!(text.starts_with(":1: expected text in UTF-8"), "{text}");
    }

    #[test]
    fn a_quote_that_is_left_open_is_refused() {
        let text = refusal("time,radius_mm,amplitude,note\n0,1,1,\"open\n0,1,1,x\n");
        assert!(
            text.starts_with(":2: a text in quotes does not end"),
            "{text}"
        );
    }

    #[test]
    fn an_endless_line_is_refused_and_not_kept() {
        let text = refusal(vec![b'x'; 1 << 20]);
        assert!(text.contains("is this a CSV file?"), "{text}");
    }

    #[test]
    fn a_path_that_cannot_be_read_is_named() {
        let folder = std::env::temp_dir();
        let missing = folder.join("no-such-folder").join("rain.csv");
        let error = BubbleEvents::open(&missing).err().unwrap().to_string();
        assert!(
            error.contains("cannot read ") && error.contains("rain.csv"),
            "{error}"
        );
        assert!(error.contains("is the path right?"), "{error}");
        let error = BubbleEvents::open(&folder).err().unwrap().to_string();
        assert!(error.contains("cannot read "), "{error}");
    }

    #[test]
    fn arbitrary_bytes_are_read_or_refused_but_never_a_panic() {
        let mut seed = 1_u64;
        let alphabet = b"0123456789.,-e\"#\r\n \t\xef\xbb\xbfx";
        for _ in 0..300 {
            let mut content = HEADER.as_bytes().to_vec();
            for _ in 0..200 {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                content.push(alphabet[(seed >> 33) as usize % alphabet.len()]);
            }
            content.drain(..(seed >> 40) as usize % 60);
            let file = Scratch::new(content);
            if let Ok(events) = BubbleEvents::open(&file.0) {
                events.for_each(drop);
            }
        }
    }
}
