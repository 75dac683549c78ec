//! `freshet list` and `freshet describe`: what there is to play and to turn.

use anyhow::Result;
use freshet::param::{self, Curve, Kind, Param, TABLE};

use crate::built_in;
use crate::scene_file::{SceneFile, expectation, show_value, unknown_path};
use crate::source::Source;

/// Every scene that travels with the command, a line each.
pub fn list() -> Result<String> {
    let scenes = built_in::all().collect::<Result<Vec<_>>>()?;
    let width = scenes.iter().map(|scene| scene.0.len()).max().unwrap_or(0);
    let lines: Vec<String> = scenes
        .iter()
        .map(|(name, file)| format!("{name:width$}  {}", file.sounds))
        .collect();
    Ok(lines.join("\n"))
}

/// The parameters: all of them as a table, or those at or below `path` in full, with their values in `scene`.
pub fn describe(path: Option<&str>, scene: Option<&str>) -> Result<String> {
    let scene = scene
        .map(Source::find)
        .transpose()?
        .map_or_else(SceneFile::default, |source| source.scene);
    let Some(path) = path else {
        return Ok(table(&scene));
    };
    let below = format!("{path}.");
    let found: Vec<usize> = (0..TABLE.len())
        .filter(|&i| TABLE[i].path == path || TABLE[i].path.starts_with(&below))
        .collect();
    if found.is_empty() {
        return Err(unknown_path(path));
    }
    let texts: Vec<String> = found
        .iter()
        .map(|&i| in_full(&TABLE[i], scene.value(i)))
        .collect();
    Ok(texts.join("\n\n"))
}

fn table(scene: &SceneFile) -> String {
    let mut lines = vec![format!(
        "{:<20} {:>12} {:>12} {:>22}  {:<5} {}",
        "path", "current", "default", "range", "unit", "what it does"
    )];
    for (i, param) in TABLE.iter().enumerate() {
        if i > param::WEIGHT && i < param::COUNT - 1 {
            continue;
        }
        lines.push(format!(
            "{:<20} {:>12} {:>12} {:>22}  {:<5} {}",
            param.path,
            show_value(param, scene.value(i)),
            show_value(param, param.default),
            range(param),
            param.unit,
            param.about
        ));
    }
    lines.join("\n")
}

fn range(param: &Param) -> String {
    match param.kind {
        Kind::Choice(names) => names.join("|"),
        _ => format!("{} .. {}", param.min, param.max),
    }
}

fn in_full(param: &Param, current: f32) -> String {
    let curve = match param.curve {
        Curve::Linear => "linear",
        Curve::Log(_) => "logarithmic",
    };
    let unit = if param.unit.is_empty() {
        "none"
    } else {
        param.unit
    };
    format!(
        "{}\n  {}\n  current  {}\n  default  {}\n  range    {} ({})\n  unit     {unit}\n  curve    {curve}\n  ramp     {} s\n  id       {}",
        param.path,
        param.about,
        show_value(param, current),
        show_value(param, param.default),
        range(param),
        expectation(param),
        param.ramp,
        param.id,
    )
}
