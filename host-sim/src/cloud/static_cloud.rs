//! A cloud that stands still, from CSV: `x_m,y_m,z_m,radius_m` and perhaps `depth_m`.

use std::path::Path;

use anyhow::{Result, anyhow, bail};

use super::coupling::Place;
use crate::scene_file::cannot_read;

/// Most bubbles read: their matrix takes 8 N² bytes, a few times over.
pub const MOST: usize = 4096;

/// Reads a cloud. Where there is no `depth_m`, the surface is as far above the highest bubble as its radius.
///
/// # Errors
/// A file that cannot be read, lacks a column, or has a value that is no number or out of range: with its line.
pub fn read(path: &Path) -> Result<Vec<Place>> {
    let file = std::fs::File::open(path).map_err(|error| cannot_read(path, &error))?;
    let name = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(file);
    let wrong = |error: csv::Error| {
        let line = error.position().map_or(0, csv::Position::line);
        let what = match error.kind() {
            csv::ErrorKind::Utf8 { .. } => "expected text in UTF-8, got other bytes".to_owned(),
            csv::ErrorKind::UnequalLengths {
                expected_len, len, ..
            } => format!("expected {expected_len} fields, got {len}"),
            csv::ErrorKind::Io(error) => return cannot_read(path, error),
            _ => error.to_string(),
        };
        anyhow!("{name}:{line}: {what}")
    };
    let header = reader.headers().map_err(wrong)?.clone();
    let names: Vec<&str> = header
        .iter()
        .map(|name| name.trim_start_matches('\u{feff}').trim())
        .collect();
    let column = |wanted: &str| names.iter().position(|name| *name == wanted);
    let needed = |wanted: &str| {
        column(wanted).ok_or_else(|| {
            anyhow!(
                "{name}:1: expected a column `{wanted}`, got `{}` (columns are x_m,y_m,z_m,radius_m and perhaps depth_m)",
                names.join(",").chars().take(80).collect::<String>()
            )
        })
    };
    let columns = [
        needed("x_m")?,
        needed("y_m")?,
        needed("z_m")?,
        needed("radius_m")?,
    ];
    let depth = column("depth_m");
    let mut places = Vec::new();
    for row in reader.records() {
        let row = row.map_err(wrong)?;
        let line = row.position().map_or(0, csv::Position::line);
        let number = |column: usize, low: f64, high: f64, range: &str| -> Result<f64> {
            let field = row.get(column).unwrap_or_default();
            match field.parse::<f64>() {
                Ok(value) if (low..=high).contains(&value) => Ok(value),
                _ => bail!(
                    "{name}:{line}: column `{}`: expected a number {range}, got `{}`",
                    names[column],
                    field
                        .chars()
                        .filter(|c| !c.is_control())
                        .take(40)
                        .collect::<String>()
                ),
            }
        };
        let far = "in metres, from -1e6 to 1e6";
        let at = [
            number(columns[0], -1e6, 1e6, far)?,
            number(columns[1], -1e6, 1e6, far)?,
            number(columns[2], -1e6, 1e6, far)?,
        ];
        let radius = number(columns[3], 1e-7, 1.0, "in metres, from 1e-7 to 1")?;
        let depth = match depth {
            Some(column) => number(column, 0.0, 1e6, "in metres, from 0 to 1e6")?,
            None => f64::NAN,
        };
        if places.len() == MOST {
            bail!("{name}:{line}: expected at most {MOST} bubbles");
        }
        places.push(Place { at, radius, depth });
    }
    if places.is_empty() {
        bail!("{name}: no bubbles in it; expected rows under `x_m,y_m,z_m,radius_m`");
    }
    let top = places
        .iter()
        .map(|place| place.at[1] + place.radius)
        .fold(f64::NEG_INFINITY, f64::max);
    for place in places.iter_mut().filter(|place| place.depth.is_nan()) {
        place.depth = top - place.at[1];
    }
    Ok(places)
}

/// Writes a cloud.
///
/// # Errors
/// What cannot be written.
pub fn write(places: &[Place], out: &mut impl std::io::Write) -> std::io::Result<()> {
    writeln!(out, "x_m,y_m,z_m,radius_m,depth_m")?;
    for Place { at, radius, depth } in places {
        writeln!(
            out,
            "{:.9},{:.9},{:.9},{radius:.9},{depth:.9}",
            at[0], at[1], at[2]
        )?;
    }
    Ok(())
}
