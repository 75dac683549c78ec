//! Settings as a scene file.

use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::Path;

use freshet::param::{self, Kind, Param, TABLE, WEIGHT};

use super::classes;
use super::model::{Model, SaveError, like};
use crate::scene_file::SceneFile;

/// The scene file that sounds as `model` stands. What the scene's intensity moves it goes on moving, but for what was
/// turned otherwise.
pub fn scene_file(model: &Model, title: &str) -> String {
    let values = &model.settings.values;
    let intensity = values[param::INTENSITY];
    let curves = model.curves().iter();
    let curves: Vec<_> = curves
        .filter(|curve| like(curve.at(intensity), values[curve.param]))
        .collect();
    let sounds = match model.file() {
        Some(file) => file.sounds.clone(),
        None => format!("made from the scene {}", model.settings.scene),
    };
    let mut text = format!("title = {}\nsounds = {}\n", quoted(title), quoted(&sounds));
    let radii = [param::RADIUS_MIN, param::RADIUS_MAX];
    let crossed = values[radii[0]] > values[radii[1]];
    let mut group = "";
    for (index, param) in TABLE.iter().enumerate().take(WEIGHT) {
        let value = match radii.iter().position(|radius| *radius == index) {
            // The instrument takes them either way; a file does not.
            Some(place) if crossed => values[radii[1 - place]],
            _ => values[index],
        };
        let moved = curves.iter().any(|curve| curve.param == index);
        let Some((of, name)) = param.path.split_once('.') else {
            continue;
        };
        if moved || value == param.default {
            continue;
        }
        if of != group {
            group = of;
            let _ = write!(text, "\n[{group}]\n");
        }
        let _ = writeln!(text, "{name} = {}", written(param, value));
    }
    let weights = &values[WEIGHT..];
    if let Some(last) = weights.iter().rposition(|weight| *weight != 1.0) {
        let count = classes::count(values).max(last + 1);
        let weights: Vec<String> = weights[..count].iter().map(f32::to_string).collect();
        let line = format!("water.weight = [{}]\n", weights.join(", "));
        // A dotted key stands before the first table.
        let at = text.find("\n[").map_or(text.len(), |at| at);
        let grouped = text.contains("\n[water]\n");
        if grouped {
            let at = text
                .find("\n[water]\n")
                .map_or(0, |at| at + "\n[water]\n".len());
            text.insert_str(at, line.trim_start_matches("water."));
        } else {
            text.insert_str(at, &line);
        }
    }
    let _ = write!(text, "\n[intensity]\nat = {intensity}\n");
    for curve in curves {
        let points: Vec<String> = (curve.points.iter())
            .map(|(x, y)| format!("[{x}, {y}]"))
            .collect();
        let path = TABLE[curve.param].path;
        let _ = writeln!(text, "\"{path}\" = [{}]", points.join(", "));
    }
    text
}

fn written(param: &Param, value: f32) -> String {
    match param.kind {
        Kind::Choice(names) => quoted(names.get(value as usize).unwrap_or(&"?")),
        _ => value.to_string(),
    }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.replace(['\n', '\r'], " ")).to_string()
}

/// Writes the scene file; one that is there only where `over` says so.
pub fn save(model: &Model, path: &Path, over: bool) -> Result<(), SaveError> {
    let failed = |why: String| SaveError::Failed(format!("cannot write {}: {why}", path.display()));
    let title = path
        .file_stem()
        .map_or("untitled".into(), |stem| stem.to_string_lossy());
    let text = scene_file(model, &title);
    // Never a file that `freshet render` would refuse.
    if let Err(error) = SceneFile::parse(&path.display().to_string(), &text) {
        return Err(failed(error.to_string()));
    }
    let mut options = OpenOptions::new();
    options.write(true);
    if over {
        // All of it or nothing: what was there stays until the new one is whole.
        let mut beside = path.as_os_str().to_owned();
        beside.push(".part");
        let written = fs::write(&beside, &text).and_then(|()| fs::rename(&beside, path));
        return written.map_err(|error| failed(error.to_string()));
    }
    let file = options.create_new(true).open(path);
    match file.and_then(|mut file| file.write_all(text.as_bytes())) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(SaveError::Exists),
        Err(error) => Err(failed(error.to_string())),
    }
}
