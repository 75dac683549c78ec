//! The mapping as a TOML file, read and, where a controller is learnt, written.
//!
//! ```toml
//! [[cc]]
//! channel = 1              # any, where nothing is said
//! cc = 74
//! param = "water.rate"
//! range = [10, 5000]       # the parameter's own, where nothing is said
//! curve = "log"            # or "linear"; the parameter's own, where nothing is said
//! fine = true              # the controller 32 above has the finer half
//!
//! [program]                # or `program = false`
//! channel = 10
//! scenes = ["brook", "surf"]
//!
//! [notes]                  # or `notes = false`
//! channel = 10
//! pressure = [0.01, 1]     # Pa at 1 m, softest and hardest touch
//! rise_factor = 0          # or "drops": as the parameter drops.rise_factor says
//! ```

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use freshet::param::{self, Curve, Kind, TABLE};
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value};

use super::mapping::{CONTROLLERS, FINE, Mapping, Notes, Programs, Rule};
use crate::scene_file::{Reader, cannot_read, expectation, nearest, unknown_path};

/// Longest file read.
const MAX_BYTES: u64 = 1 << 20;
/// What a new file begins with.
const HEADER: &str =
    "# MIDI controllers of `freshet bridge --map`; docs/bridge.md says what may stand here.\n";

/// Reads a mapping file.
pub fn open(path: &Path) -> Result<Mapping> {
    parse(&path.display().to_string(), &text_of(path)?)
}

/// The same, but a file that is not there yet is a mapping with what it has by default.
pub fn open_or_new(path: &Path) -> Result<Mapping> {
    if is_there(path) {
        open(path)
    } else {
        parse(&path.display().to_string(), HEADER)
    }
}

fn is_there(path: &Path) -> bool {
    !matches!(fs::metadata(path), Err(error) if error.kind() == io::ErrorKind::NotFound)
}

fn text_of(path: &Path) -> Result<String> {
    let name = path.display();
    let mut bytes = Vec::new();
    fs::File::open(path)
        .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
        .map_err(|error| cannot_read(path, &error))?;
    if bytes.len() as u64 > MAX_BYTES {
        bail!("{name}: expected a mapping, got more than {MAX_BYTES} bytes (is this a TOML file?)");
    }
    String::from_utf8(bytes)
        .map_err(|_| anyhow!("{name}: expected text in UTF-8, got other bytes (save it in UTF-8)"))
}

/// Reads a mapping from `text`; `name` is for messages. What is not named is as in [`Mapping::default`], but for the
/// controllers: those of the file are all there are.
pub fn parse(name: &str, text: &str) -> Result<Mapping> {
    let reader = Reader { name, text };
    let table = DeTable::parse(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        reader.error(at, format!("not valid TOML: {}", error.message()))
    })?;
    let file = File(reader);
    let mut mapping = Mapping {
        rules: Vec::new(),
        ..Mapping::default()
    };
    for (key, value) in table.get_ref() {
        match (key.get_ref().as_ref(), value.get_ref()) {
            ("cc", DeValue::Array(rules)) => {
                for rule in rules.iter() {
                    mapping.rules.push(file.rule(rule)?);
                }
            }
            ("cc", _) => return Err(file.0.error(value.span().start, "cc: expected [[cc]]")),
            ("program", DeValue::Boolean(on)) => {
                mapping.programs = on.then(Programs::default);
            }
            ("program", _) => mapping.programs = Some(file.programs(value)?),
            ("notes", DeValue::Boolean(on)) => mapping.notes = on.then(Notes::default),
            ("notes", _) => mapping.notes = Some(file.notes(value)?),
            (other, _) => {
                return Err(file.unknown(other, key.span().start, &["cc", "program", "notes"]));
            }
        }
    }
    Ok(mapping)
}

/// An entry of a table: what it is called, where, and what it is.
type Entry<'a, 'b> = (&'a str, usize, &'a Spanned<DeValue<'b>>);

struct File<'a>(Reader<'a>);

impl File<'_> {
    fn unknown(&self, key: &str, at: usize, known: &[&str]) -> anyhow::Error {
        let known_names = known.join(", ");
        match nearest(key, known.iter().copied()) {
            Some(near) => (self.0).error(at, format!("no field `{key}`; did you mean `{near}`?")),
            None => (self.0).error(at, format!("no field `{key}`; there are {known_names}")),
        }
    }

    fn wrong(&self, entry: Entry<'_, '_>, expected: &str) -> anyhow::Error {
        let (key, _, value) = entry;
        (self.0).error(value.span().start, format!("{key}: expected {expected}"))
    }

    fn table<'a, 'b>(
        &self,
        value: &'a Spanned<DeValue<'b>>,
        what: &str,
    ) -> Result<Vec<Entry<'a, 'b>>> {
        let DeValue::Table(table) = value.get_ref() else {
            return Err((self.0).error(value.span().start, format!("expected {what}")));
        };
        let entries = table.iter();
        Ok(entries
            .map(|(key, value)| (key.get_ref().as_ref(), key.span().start, value))
            .collect())
    }

    fn rule(&self, value: &Spanned<DeValue<'_>>) -> Result<Rule> {
        const FIELDS: &[&str] = &["channel", "cc", "param", "range", "curve", "fine"];
        let start = value.span().start;
        let entries = self.table(value, "a table such as { cc = 74, param = \"water.rate\" }")?;
        if let Some((key, at, _)) = entries.iter().find(|(key, ..)| !FIELDS.contains(key)) {
            return Err(self.unknown(key, *at, FIELDS));
        }
        let entry = |name: &str| entries.iter().copied().find(|(key, ..)| *key == name);
        let needed = |name: &str| {
            let missing = || (self.0).error(start, format!("{name}: missing from this [[cc]]"));
            entry(name).ok_or_else(missing)
        };
        let cc = needed("cc")?;
        let top = u16::from(CONTROLLERS - 1);
        let number = self.whole(cc, 0, top)? as u8;
        let path = needed("param")?;
        let DeValue::String(name) = path.2.get_ref() else {
            return Err(self.wrong(path, "a path in quotes, such as \"water.rate\""));
        };
        let at = path.2.span().start;
        let unknown = || (self.0).error(at, format!("param: {}", unknown_path(name)));
        let index = param::index_of(name).ok_or_else(unknown)?;
        let channel = entry("channel").map(|entry| self.channel(entry));
        let mut rule = Rule::whole(channel.transpose()?, number, index);
        if let Some(entry) = entry("range") {
            let param = &TABLE[index];
            let expected = format!("two values, each {}", expectation(param));
            let value = |value: &Spanned<DeValue<'_>>| match (value.get_ref(), param.kind) {
                (DeValue::String(name), Kind::Choice(names)) => {
                    (names.iter().position(|known| *known == name)).map(|index| index as f32)
                }
                (value, _) => number_of(value),
            };
            let good = |number: &f32| param.accepts(*number);
            rule.range = match entry.2.get_ref() {
                DeValue::Array(ends) if ends.len() == 2 => {
                    let [from, to] = [&ends[0], &ends[1]].map(|end| value(end).filter(good));
                    from.zip(to)
                }
                _ => None,
            }
            .ok_or_else(|| self.wrong(entry, &expected))?;
        }
        if let Some(entry) = entry("curve") {
            rule.curve = match entry.2.get_ref() {
                DeValue::String(name) if name == "linear" => Curve::Linear,
                DeValue::String(name) if name == "log" => self.logarithmic(&rule, entry)?,
                _ => return Err(self.wrong(entry, "\"linear\" or \"log\"")),
            };
        }
        if let Some(entry) = entry("fine") {
            let DeValue::Boolean(fine) = *entry.2.get_ref() else {
                return Err(self.wrong(entry, "true or false"));
            };
            if fine && number >= FINE {
                return Err(self.wrong(entry, "false: only controllers 0 to 31 have a finer half"));
            }
            rule.fine = fine;
        }
        Ok(rule)
    }

    fn logarithmic(&self, rule: &Rule, entry: Entry<'_, '_>) -> Result<Curve> {
        let param = &TABLE[rule.param];
        let (from, to) = rule.range;
        match param.curve {
            Curve::Log(_) => Ok(param.curve),
            Curve::Linear if from.min(to) > 0.0 => Ok(Curve::Log(from.min(to))),
            Curve::Linear => {
                let expected = format!(
                    "\"linear\": equal ratios need a range above 0, and this one is {from} to {to}"
                );
                Err(self.wrong(entry, &expected))
            }
        }
    }

    fn programs(&self, value: &Spanned<DeValue<'_>>) -> Result<Programs> {
        let mut programs = Programs::default();
        let what = "a table, or program = false";
        for entry in self.table(value, what)? {
            match (entry.0, entry.2.get_ref()) {
                ("channel", _) => programs.channel = Some(self.channel(entry)?),
                ("scenes", DeValue::Array(names)) => {
                    for name in names.iter() {
                        let DeValue::String(name) = name.get_ref() else {
                            return Err(self.wrong(entry, "names of scenes in quotes"));
                        };
                        programs.scenes.push(name.to_string());
                    }
                }
                ("scenes", _) => return Err(self.wrong(entry, "a list of names of scenes")),
                (key, _) => return Err(self.unknown(key, entry.1, &["channel", "scenes"])),
            }
        }
        Ok(programs)
    }

    fn notes(&self, value: &Spanned<DeValue<'_>>) -> Result<Notes> {
        let mut notes = Notes::default();
        let what = "a table, or notes = false";
        for entry in self.table(value, what)? {
            match (entry.0, entry.2.get_ref()) {
                ("channel", _) => notes.channel = Some(self.channel(entry)?),
                ("pressure", value) => {
                    let possible = |number: &f32| *number > 0.0 && *number <= 8.0;
                    let end =
                        |end: &Spanned<DeValue<'_>>| number_of(end.get_ref()).filter(possible);
                    notes.pressure = match value {
                        DeValue::Array(ends) if ends.len() == 2 => end(&ends[0]).zip(end(&ends[1])),
                        _ => None,
                    }
                    .ok_or_else(|| self.wrong(entry, "two pressures above 0 and up to 8 Pa"))?;
                }
                ("rise_factor", DeValue::String(word)) if word == "drops" => {
                    notes.rise_factor = None;
                }
                ("rise_factor", value) => {
                    let factor = number_of(value).filter(|factor| (0.0..=20.0).contains(factor));
                    let wrong = || self.wrong(entry, "a number from 0 to 20, or \"drops\"");
                    notes.rise_factor = Some(factor.ok_or_else(wrong)?);
                }
                (key, _) => {
                    let known = &["channel", "pressure", "rise_factor"];
                    return Err(self.unknown(key, entry.1, known));
                }
            }
        }
        Ok(notes)
    }

    fn channel(&self, entry: Entry<'_, '_>) -> Result<u8> {
        Ok(self.whole(entry, 1, 16)? as u8)
    }

    fn whole(&self, entry: Entry<'_, '_>, least: u16, most: u16) -> Result<u16> {
        let number = match entry.2.get_ref() {
            DeValue::Integer(number) => u16::from_str_radix(number.as_str(), number.radix()).ok(),
            _ => None,
        };
        let number = number.filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| self.wrong(entry, &format!("a whole number from {least} to {most}")))
    }
}

fn number_of(value: &DeValue<'_>) -> Option<f32> {
    match value {
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .ok()
            .map(|number| number as f32),
        DeValue::Float(number) => number.as_str().replace('_', "").parse().ok(),
        DeValue::Boolean(on) => Some(f32::from(*on)),
        _ => None,
    }
}

/// Binds the controller `cc` of `channel` to the parameter at `index` in the file at `path`, and returns the mapping as
/// it is then. An entry of that parameter keeps its range and curve; comments stay; the file is never half written.
pub fn learn(path: &Path, channel: u8, cc: u8, index: usize) -> Result<Mapping> {
    let name = path.display().to_string();
    let text = if is_there(path) {
        text_of(path)?
    } else {
        HEADER.to_owned()
    };
    // What cannot be read is not touched.
    parse(&name, &text)?;
    let text = bound(&text, channel, cc, index).with_context(|| name.clone())?;
    let mapping = parse(&name, &text)?;
    replace(path, &text).with_context(|| format!("cannot write {name}"))?;
    Ok(mapping)
}

/// `text` with that controller.
fn bound(text: &str, channel: u8, cc: u8, index: usize) -> Result<String> {
    let mut document: DocumentMut = text.parse()?;
    // Comments that nothing follows yet stay above what comes.
    let above = document.is_empty().then(|| {
        let above = document.trailing().as_str().unwrap_or_default().to_owned();
        document.set_trailing("");
        above
    });
    let param = TABLE[index].path;
    let rules = document
        .entry("cc")
        .or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
    let (channel, cc_value) = (i64::from(channel), i64::from(cc));
    let old = match rules {
        Item::ArrayOfTables(tables) => (tables.iter_mut())
            .find(|table| is_of(table.get("param"), param))
            .map(|table| table as &mut dyn toml_edit::TableLike),
        Item::Value(Value::Array(array)) => (array.iter_mut())
            .filter_map(Value::as_inline_table_mut)
            .find(|table| is_of(table.get("param").cloned().map(Item::Value).as_ref(), param))
            .map(|table| table as &mut dyn toml_edit::TableLike),
        _ => bail!("cc: expected [[cc]]"),
    };
    if let Some(table) = old {
        put(table, "channel", channel);
        put(table, "cc", cc_value);
        if cc >= FINE {
            // It has no finer half.
            table.remove("fine");
        }
        return Ok(document.to_string());
    }
    let fields = [
        ("channel", Value::from(channel)),
        ("cc", Value::from(cc_value)),
        ("param", Value::from(param)),
    ];
    match rules {
        Item::ArrayOfTables(tables) => {
            let mut table = Table::new();
            if let Some(above) = above {
                table.decor_mut().set_prefix(above);
            }
            for (key, value) in fields {
                table.insert(key, Item::Value(value));
            }
            tables.push(table);
        }
        Item::Value(Value::Array(array)) => array.push(fields.into_iter().collect::<InlineTable>()),
        _ => {}
    }
    Ok(document.to_string())
}

fn is_of(item: Option<&Item>, param: &str) -> bool {
    item.and_then(Item::as_str) == Some(param)
}

/// Changes a number, and leaves what stands around it.
fn put(table: &mut dyn toml_edit::TableLike, key: &str, number: i64) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            let decor = old.decor().clone();
            *old = Value::from(number);
            *old.decor_mut() = decor;
        }
        None => {
            table.insert(key, Item::Value(Value::from(number)));
        }
    }
}

/// Puts `text` where the file is, whole or not at all.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    // A link stays one.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let mut beside = std::ffi::OsString::from(".");
    beside.push(name);
    beside.push(format!(".{}.tmp", std::process::id()));
    let beside: PathBuf = path.with_file_name(beside);
    let write = || {
        let mut file = fs::File::create_new(&beside)?;
        file.write_all(text.as_bytes())?;
        if let Ok(old) = fs::metadata(&path) {
            file.set_permissions(old.permissions())?;
        }
        file.sync_all()?;
        drop(file);
        fs::rename(&beside, &path)
    };
    write().inspect_err(|error| {
        if error.kind() != io::ErrorKind::AlreadyExists {
            let _ = fs::remove_file(&beside);
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        parse("map.toml", text).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_file_line_and_field() {
        let told = [
            (
                "[[cc]]\ncc = 7\nparam = \"water.rat\"",
                "map.toml:3:9: param: no parameter `water.rat`; did you mean `water.rate`? (`freshet describe` lists all)",
            ),
            (
                "\n[[cc]]\ncc = 120\nparam = \"mix.level\"",
                "map.toml:3:6: cc: expected a whole number from 0 to 119",
            ),
            (
                "[[cc]]\nparam = \"mix.level\"",
                "map.toml:1:1: cc: missing from this [[cc]]",
            ),
            (
                "[[cc]]\ncc = 1\nchanel = 2\nparam = \"mix.level\"",
                "map.toml:3:1: no field `chanel`; did you mean `channel`?",
            ),
            (
                "[[cc]]\ncc = 1\nparam = \"mix.level\"\nrange = [-60, 99]",
                "map.toml:4:9: range: expected two values, each a number from -80 to 24 dB",
            ),
            (
                "[[cc]]\ncc = 1\nparam = \"mix.level\"\ncurve = \"log\"",
                "map.toml:4:9: curve: expected \"linear\": equal ratios need a range above 0, and this one is -80 to 24",
            ),
            (
                "[[cc]]\ncc = 40\nparam = \"mix.level\"\nfine = true",
                "map.toml:4:8: fine: expected false: only controllers 0 to 31 have a finer half",
            ),
            (
                "[notes]\npressure = [0, 1]",
                "map.toml:2:12: pressure: expected two pressures above 0 and up to 8 Pa",
            ),
            (
                "[program]\nchannel = 0",
                "map.toml:2:11: channel: expected a whole number from 1 to 16",
            ),
            ("cc = 5", "map.toml:1:6: cc: expected [[cc]]"),
            (
                "what = 5",
                "map.toml:1:1: no field `what`; there are cc, program, notes",
            ),
        ];
        for (text, wanted) in told {
            assert_eq!(error(text), wanted);
        }
        assert!(error("[[cc]\n").starts_with("map.toml:1:"));
    }

    #[test]
    fn all_that_may_stand_there() {
        let text = "notes = false\n[[cc]]\nchannel = 3\ncc = 20\nparam = \"water.law\"\nrange = [\"custom\", \"flat\"]\n\
             [[cc]]\ncc = 1\nparam = \"mix.level\"\nrange = [-60, 0.5]\nfine = true\n\
             [program]\nscenes = [\"surf\"]";
        let mapping = parse("map.toml", text).unwrap();
        assert_eq!(mapping.rules[0].range, (2.0, 0.0));
        assert_eq!(mapping.rules[0].channel, Some(3));
        assert!(mapping.rules[1].fine);
        assert_eq!(mapping.notes, None);
        assert_eq!(mapping.programs.unwrap().scenes, ["surf"]);
        let empty = parse("map.toml", "").unwrap();
        assert!(empty.rules.is_empty() && empty.notes.is_some() && empty.programs.is_some());
    }

    #[test]
    fn what_is_learnt_leaves_the_rest() {
        let text = "# mine\n[[cc]] # a knob\ncc = 74 # the left one\nparam = \"water.rate\"\nrange = [1, 5]\n\n# keys\n[notes]\nchannel = 2\n";
        let again = bound(text, 3, 20, param::RATE).unwrap();
        assert!(again.contains("cc = 20 # the left one") && again.contains("channel = 3"));
        assert!(again.starts_with("# mine\n[[cc]] # a knob") && again.contains("range = [1, 5]"));
        let more = bound(&again, 1, 7, param::LEVEL).unwrap();
        assert!(more.contains("# keys\n[notes]\nchannel = 2"), "{more}");
        let mapping = parse("map.toml", &more).unwrap();
        assert_eq!(mapping.rules.len(), 2);
        assert_eq!(mapping.rules[1], Rule::whole(Some(1), 7, param::LEVEL));
        let inline = bound(
            "cc = [{ cc = 1, param = \"mix.tone\" }]",
            1,
            7,
            param::LEVEL,
        )
        .unwrap();
        assert_eq!(parse("map.toml", &inline).unwrap().rules.len(), 2);
        let new = bound(HEADER, 1, 7, param::LEVEL).unwrap();
        assert!(new.starts_with(HEADER));
        assert_eq!(parse("map.toml", &new).unwrap().rules.len(), 1);
    }
}
