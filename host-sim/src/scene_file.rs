//! Scenes as TOML over the parameter table, checked against it.
//!
//! ```toml
//! title = "Brook"
//! sounds = "what it should sound like, in a line"
//!
//! [water]
//! rate = 1500
//!
//! [intensity]          # what the handle moves, as points [intensity, value]
//! at = 0.5             # where it stands
//! "water.rate" = [[0, 200], [1, 20000]]
//! ```

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Result, anyhow, bail};
use freshet::param::{self, Kind, Param, TABLE};
use freshet::scene::{CURVES, IntensityCurve, POINTS, Scene};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longest file read: what is longer is no scene and must not fill the memory.
const MAX_BYTES: u64 = 1 << 20;

/// A scene with the words that go with it.
#[derive(Clone, Debug, Default)]
pub struct SceneFile {
    /// The name for people.
    pub title: String,
    /// What it should sound like.
    pub sounds: String,
    /// The scene.
    pub scene: Scene,
}

impl SceneFile {
    /// Reads a scene file.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|error| cannot_read(path, &error))?;
        if bytes.len() as u64 > MAX_BYTES {
            bail!(
                "{name}: expected a scene, got more than {MAX_BYTES} bytes (is this a TOML file?)"
            );
        }
        let text = String::from_utf8(bytes).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            let text = &String::from_utf8_lossy(&error.as_bytes()[..at]);
            let message = "expected text in UTF-8, got other bytes (save the file in UTF-8)";
            Reader { name: &name, text }.error(at, message)
        })?;
        if text.trim().is_empty() {
            bail!("{name}: the file is empty; expected a scene such as `water.rate = 1000`");
        }
        Self::parse(&name, &text)
    }

    /// Reads a scene from `text`; `name` is for messages.
    pub fn parse(name: &str, text: &str) -> Result<Self> {
        let reader = Reader { name, text };
        let table = DeTable::parse(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            reader.error(at, format!("not valid TOML: {}", error.message()))
        })?;
        let mut file = Self::default();
        let mut named: Vec<(usize, usize)> = Vec::new();
        for (key, value) in table.get_ref() {
            match (key.get_ref().as_ref(), value.get_ref()) {
                ("title", DeValue::String(text)) => file.title = text.to_string(),
                ("sounds", DeValue::String(text)) => file.sounds = text.to_string(),
                ("title" | "sounds", _) => {
                    return Err(reader.error(value.span().start, "expected a text in quotes"));
                }
                ("intensity", DeValue::Table(table)) => {
                    reader.intensity(table, &mut file.scene)?;
                }
                (path, _) => {
                    reader.value(path, key.span().start, value, &mut file.scene, &mut named)?
                }
            }
        }
        for curve in &file.scene.curves {
            if let Some((_, at)) = named.iter().find(|(index, _)| *index == curve.param) {
                let path = TABLE[curve.param].path;
                return Err(reader.error(
                    *at,
                    format!("`{path}` is moved by the intensity too; keep one of the two"),
                ));
            }
        }
        reader.check_radii(&file.scene, &named)?;
        Ok(file)
    }

    /// Sets parameters as the command line does, in order.
    pub fn set_all(&mut self, assignments: &[String]) -> Result<()> {
        for assignment in assignments {
            self.set(assignment)?;
        }
        let [min, max] = [param::RADIUS_MIN, param::RADIUS_MAX].map(|index| self.value(index));
        if min > max && !assignments.is_empty() {
            bail!("water.radius_min = {min} mm is above water.radius_max = {max} mm");
        }
        Ok(())
    }

    /// Sets a parameter as the command line does; an intensity curve over it gives way.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let (path, text) = assignment.split_once('=').ok_or_else(|| {
            anyhow!("--set {assignment}: expected path=value, for example water.rate=2000")
        })?;
        let (path, text) = (path.trim(), text.trim());
        let index = param::index_of(path).ok_or_else(|| unknown_path(path))?;
        let value = parse_value(&TABLE[index], text)?;
        put(&mut self.scene, index, value);
        self.scene.curves.retain(|curve| curve.param != index);
        Ok(())
    }

    /// The value a parameter has when the scene starts.
    pub fn value(&self, index: usize) -> f32 {
        let set = |index: usize| {
            let value = self.scene.values.iter().find(|value| value.0 == index);
            value.map_or(TABLE[index].default, |value| value.1)
        };
        let curve = self.scene.curves.iter().find(|curve| curve.param == index);
        curve.map_or_else(|| set(index), |curve| curve.at(set(param::INTENSITY)))
    }
}

/// Sets one value of a scene.
pub fn put(scene: &mut Scene, index: usize, value: f32) {
    match scene.values.iter_mut().find(|old| old.0 == index) {
        Some(old) => old.1 = value,
        None => scene
            .values
            .push((index, value))
            .expect("a scene holds every parameter"),
    }
}

/// The error for a path that is not in the table, with the nearest one that is.
pub fn unknown_path(path: &str) -> anyhow::Error {
    let paths = TABLE.iter().map(|param| param.path);
    match nearest(path, paths) {
        Some(near) => {
            anyhow!("no parameter `{path}`; did you mean `{near}`? (`freshet describe` lists all)")
        }
        None => anyhow!("no parameter `{path}` (`freshet describe` lists all)"),
    }
}

/// The name most like `name`, if any is at all like it.
pub fn nearest<'a>(name: &str, among: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    among
        .map(|other| (strsim::jaro_winkler(name, other), other))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, other)| other)
}

/// What a parameter takes, in words.
pub fn expectation(param: &Param) -> String {
    let unit = if param.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", param.unit)
    };
    match param.kind {
        Kind::Real => format!("a number from {} to {}{unit}", param.min, param.max),
        Kind::Whole => format!("a whole number from {} to {}{unit}", param.min, param.max),
        Kind::Choice(names) => format!("one of {}", names.join(", ")),
    }
}

/// A value as people see it: a choice by its name.
pub fn show_value(param: &Param, value: f32) -> String {
    match param.kind {
        Kind::Choice(names) => names.get(value as usize).unwrap_or(&"?").to_string(),
        _ => format!("{value}"),
    }
}

fn check(param: &Param, value: f32, shown: &str) -> Result<f32> {
    if !param.accepts(value) {
        bail!("{} = {shown}: expected {}", param.path, expectation(param));
    }
    Ok(value)
}

/// A value as people write it, checked.
pub(crate) fn parse_value(param: &Param, text: &str) -> Result<f32> {
    if let Kind::Choice(names) = param.kind
        && let Some(index) = names.iter().position(|name| *name == text)
    {
        return Ok(index as f32);
    }
    match text.parse::<f32>() {
        Ok(value) => check(param, value, text),
        Err(_) => bail!("{} = {text}: expected {}", param.path, expectation(param)),
    }
}

/// The error for a file that could not be read, with what to do about it.
#[cold]
pub(crate) fn cannot_read(path: &Path, error: &std::io::Error) -> anyhow::Error {
    use std::io::ErrorKind::{IsADirectory, NotFound, PermissionDenied};
    let reason = error.to_string();
    let reason = reason.split(" (os error").next().unwrap_or_default();
    let hint = match error.kind() {
        NotFound => " (is the path right?)",
        IsADirectory => " (expected a file)",
        PermissionDenied => " (may you read it?)",
        _ => "",
    };
    anyhow!("cannot read {}: {reason}{hint}", path.display())
}

/// A text and what to call it, for messages.
pub(crate) struct Reader<'a> {
    pub(crate) name: &'a str,
    pub(crate) text: &'a str,
}

impl Reader<'_> {
    /// An error at a byte of the text.
    pub(crate) fn error(&self, at: usize, message: impl std::fmt::Display) -> anyhow::Error {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        let start = before
            .iter()
            .rposition(|byte| *byte == b'\n')
            .map_or(0, |at| at + 1);
        let column = String::from_utf8_lossy(&before[start..]).chars().count() + 1;
        anyhow!("{}:{line}:{column}: {message}", self.name)
    }

    /// One entry, or a table of them, under `path`.
    fn value(
        &self,
        path: &str,
        at: usize,
        value: &Spanned<DeValue<'_>>,
        scene: &mut Scene,
        named: &mut Vec<(usize, usize)>,
    ) -> Result<()> {
        match value.get_ref() {
            DeValue::Table(table) => {
                for (key, value) in table {
                    let path = format!("{path}.{}", key.get_ref());
                    self.value(&path, key.span().start, value, scene, named)?;
                }
                Ok(())
            }
            DeValue::Array(weights) if path == "water.weight" => {
                if weights.len() > 64 {
                    let message = format!(
                        "{} weights: a population has at most 64 classes",
                        weights.len()
                    );
                    return Err(self.error(value.span().start, message));
                }
                for (k, weight) in weights.iter().enumerate() {
                    let path = format!("water.weight.{}", k + 1);
                    self.value(&path, weight.span().start, weight, scene, named)?;
                }
                Ok(())
            }
            _ => {
                let index =
                    param::index_of(path).ok_or_else(|| self.error(at, unknown_path(path)))?;
                let number = self.number(&TABLE[index], value)?;
                put(scene, index, number);
                named.push((index, at));
                Ok(())
            }
        }
    }

    /// A number, or the name of a choice, for `param`.
    fn number(&self, param: &Param, value: &Spanned<DeValue<'_>>) -> Result<f32> {
        let at = value.span().start;
        let parsed = match value.get_ref() {
            DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
                .map_err(|_| {
                    anyhow!(
                        "{} = {}: expected {}",
                        param.path,
                        number.as_str(),
                        expectation(param)
                    )
                })
                .and_then(|number| check(param, number as f32, &number.to_string())),
            DeValue::Float(number) => parse_value(param, number.as_str()),
            DeValue::Boolean(on) if matches!(param.kind, Kind::Choice(param::SWITCH)) => {
                Ok(f32::from(*on))
            }
            DeValue::String(text) if matches!(param.kind, Kind::Choice(_)) => {
                parse_value(param, text)
            }
            _ => Err(anyhow!("{}: expected {}", param.path, expectation(param))),
        };
        parsed.map_err(|error| self.error(at, error))
    }

    /// The table of what the handle moves.
    fn intensity(&self, table: &DeTable<'_>, scene: &mut Scene) -> Result<()> {
        for (key, value) in table {
            let (path, at) = (key.get_ref().as_ref(), key.span().start);
            if path == "at" {
                put(
                    scene,
                    param::INTENSITY,
                    self.number(&TABLE[param::INTENSITY], value)?,
                );
                continue;
            }
            if let DeValue::Table(_) = value.get_ref() {
                let hint = format!(
                    "write the path in quotes, like \"{path}.rate\" = [[0, 100], [1, 1000]]"
                );
                return Err(self.error(at, hint));
            }
            let index = param::index_of(path).ok_or_else(|| self.error(at, unknown_path(path)))?;
            if index == param::INTENSITY {
                return Err(self.error(
                    at,
                    "the intensity cannot move itself; `at` says where it stands",
                ));
            }
            let curve = self.curve(index, value)?;
            if scene.curves.push(curve).is_err() {
                return Err(self.error(
                    at,
                    format!("an intensity moves at most {CURVES} parameters"),
                ));
            }
        }
        Ok(())
    }

    fn curve(&self, index: usize, value: &Spanned<DeValue<'_>>) -> Result<IntensityCurve> {
        let at = value.span().start;
        let wanted =
            "expected points [intensity, value] in order of intensity, like [[0, 100], [1, 1000]]";
        let DeValue::Array(points) = value.get_ref() else {
            return Err(self.error(at, wanted));
        };
        let mut curve = IntensityCurve {
            param: index,
            points: Default::default(),
        };
        for point in points.iter() {
            let at = point.span().start;
            let pair = match point.get_ref() {
                DeValue::Array(pair) if pair.len() == 2 => pair,
                _ => return Err(self.error(at, wanted)),
            };
            let x = self.number(&TABLE[param::INTENSITY], &pair[0])?;
            let y = self.number(&TABLE[index], &pair[1])?;
            if curve.points.last().is_some_and(|last| last.0 >= x) {
                return Err(self.error(at, wanted));
            }
            if curve.points.push((x, y)).is_err() {
                return Err(self.error(at, format!("a curve has at most {POINTS} points")));
            }
        }
        if curve.points.is_empty() {
            return Err(self.error(at, wanted));
        }
        Ok(curve)
    }

    /// The smallest radius is below the largest.
    fn check_radii(&self, scene: &Scene, named: &[(usize, usize)]) -> Result<()> {
        let get = |index: usize| {
            let value = scene.values.iter().find(|value| value.0 == index);
            value.map_or(TABLE[index].default, |value| value.1)
        };
        let (min, max) = (get(param::RADIUS_MIN), get(param::RADIUS_MAX));
        let at = named
            .iter()
            .find(|(index, _)| [param::RADIUS_MIN, param::RADIUS_MAX].contains(index));
        match at {
            Some((_, at)) if min > max => Err(self.error(
                *at,
                format!("water.radius_min = {min} mm is above water.radius_max = {max} mm"),
            )),
            _ => Ok(()),
        }
    }
}
