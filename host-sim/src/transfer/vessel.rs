//! Vessel files: a liquid at rest and what holds it, as TOML. Lengths in metres, z up.
//!
//! ```toml
//! title = "Drinking glass"
//! shape = "glass"     # drop, glass, bowl, box, pool or mesh
//! radius = 0.035      # inside
//! height = 0.12       # of the rim above the inner bottom
//! wall = 0.003        # 0: as HF have it, a thin interface around the liquid, and then level = height
//! level = 0.05        # of the water above the inner bottom
//! edge = 0.006        # of the triangles [default: about 3700 of them]
//! ```

use std::f64::consts::PI;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::block::open_box;
use super::mesh::{Mesh, Part};
use super::mesh_file;
use super::revolve::{Corner, arc, revolve};
use super::shape::Shape;
use crate::scene_file::{Reader, cannot_read, nearest};

/// Longest vessel file read.
const MAX_BYTES: u64 = 1 << 20;
/// Triangles that an edge of no given length makes, and the most that any makes.
const WANTED: f64 = 3_700.0;
const MOST: f64 = 200_000.0;
/// Area of an equilateral triangle over its edge squared.
const EQUILATERAL: f64 = 0.433;

/// A liquid at rest and what holds it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Form {
    /// A ball of water around the origin.
    Drop { radius: f64 },
    /// An upright cylinder with a bottom as thick as its wall; the inner bottom's middle is the origin.
    Glass {
        radius: f64,
        height: f64,
        wall: f64,
        level: f64,
    },
    /// A spherical bowl; its lowest point inside is the origin.
    Bowl {
        radius: f64,
        height: f64,
        wall: f64,
        level: f64,
    },
    /// An open box; the inner bottom's middle is the origin.
    Box {
        width: f64,
        depth: f64,
        height: f64,
        wall: f64,
        level: f64,
    },
    /// Water below z = 0 without end.
    Pool,
    /// Triangles of another program.
    Mesh(Mesh),
}

/// A vessel file, read.
#[derive(Clone, Debug)]
pub struct Vessel {
    /// The name for people.
    pub title: String,
    pub(super) form: Form,
    /// Wanted edge of the triangles, m.
    pub edge: Option<f64>,
}

/// What a key means: a length with its least and largest value in metres.
const LENGTH: (f64, f64) = (1e-4, 100.0);

const SHAPES: [(&str, &[&str]); 6] = [
    ("drop", &["radius"]),
    ("glass", &["radius", "height", "wall", "level"]),
    ("bowl", &["radius", "height", "wall", "level"]),
    ("box", &["width", "depth", "height", "wall", "level"]),
    ("pool", &[]),
    ("mesh", &["file", "scale", "free", "solid", "wet", "dry"]),
];

impl Vessel {
    /// Reads a vessel file.
    ///
    /// # Errors
    /// What is wrong with it, where, and what was expected.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|error| cannot_read(path, &error))?;
        if bytes.len() as u64 > MAX_BYTES {
            bail!(
                "{name}: expected a vessel, got more than {MAX_BYTES} bytes (is this a TOML file?)"
            );
        }
        let Ok(text) = String::from_utf8(bytes) else {
            bail!("{name}: expected text in UTF-8, got other bytes (is this a vessel file?)");
        };
        let folder = path.parent().unwrap_or(Path::new("."));
        Self::parse(&name, &text, folder)
    }

    /// Reads a vessel from `text`; `name` is for messages, meshes lie relative to `folder`.
    ///
    /// # Errors
    /// See [`Vessel::open`].
    pub fn parse(name: &str, text: &str, folder: &Path) -> Result<Self> {
        let reader = Reader { name, text };
        let table = DeTable::parse(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            reader.error(at, format!("not valid TOML: {}", error.message()))
        })?;
        let fields = Fields {
            reader,
            table: table.get_ref(),
        };
        let shape = fields.text("shape")?;
        let shapes = SHAPES.map(|shape| shape.0);
        let Some((_, keys)) = SHAPES.iter().find(|known| known.0 == shape) else {
            let message = format!("shape = \"{shape}\": expected one of {}", shapes.join(", "));
            return Err(fields.error("shape", message));
        };
        let known = || {
            ["title", "shape", "edge"]
                .iter()
                .chain(keys.iter())
                .copied()
        };
        for (key, _) in fields.table {
            let key_text = key.get_ref().as_ref();
            if !known().any(|known| known == key_text) {
                let list: Vec<&str> = known().collect();
                let hint = nearest(key_text, known())
                    .map_or_else(String::new, |near| format!("did you mean `{near}`? "));
                let message = format!(
                    "a {shape} has no `{key_text}` ({hint}expected {})",
                    list.join(", ")
                );
                return Err(fields.reader.error(key.span().start, message));
            }
        }
        let title = match fields.table.get("title") {
            Some(_) => fields.text("title")?.to_owned(),
            None => shape.to_owned(),
        };
        let edge = match fields.table.get("edge") {
            Some(_) => Some(fields.number("edge", LENGTH)?),
            None => None,
        };
        let length = |key| fields.number(key, LENGTH);
        let form = match shape {
            "drop" => Form::Drop {
                radius: length("radius")?,
            },
            "glass" => Form::Glass {
                radius: length("radius")?,
                height: length("height")?,
                wall: fields.wall()?,
                level: fields.at_most("level", "height")?,
            },
            "bowl" => Form::Bowl {
                radius: length("radius")?,
                height: fields.at_most("height", "radius")?,
                wall: fields.wall()?,
                level: fields.at_most("level", "height")?,
            },
            "box" => Form::Box {
                width: length("width")?,
                depth: length("depth")?,
                height: length("height")?,
                wall: fields.wall()?,
                level: fields.at_most("level", "height")?,
            },
            "pool" => Form::Pool,
            _ => Form::Mesh(fields.mesh(folder)?),
        };
        Ok(Vessel { title, form, edge })
    }

    /// The triangles, with edges of about [`Vessel::edge`]; none for a pool.
    ///
    /// # Errors
    /// An edge that makes too many triangles, or too few to tell the shape.
    pub fn mesh(&self) -> Result<Option<Mesh>> {
        let coarse = match &self.form {
            Form::Pool => return Ok(None),
            Form::Mesh(mesh) => return Ok(Some(mesh.clone())),
            // Coarse, and bounded for a needle, too.
            form => form.mesh((form.extent() / 8.0).max(form.longest() / 200.0)),
        };
        let area = coarse.area();
        let edge = self
            .edge
            .unwrap_or_else(|| (area / (EQUILATERAL * WANTED)).sqrt());
        let count = area / (EQUILATERAL * edge * edge);
        if count > MOST {
            bail!(
                "edge = {edge}: that makes some {count:.0} triangles; expected at least {:.2e} m",
                (area / (EQUILATERAL * MOST)).sqrt()
            );
        }
        if edge > 0.5 * self.form.extent() {
            bail!(
                "edge = {edge}: longer than the vessel can be told by; expected at most {:.2e} m",
                0.5 * self.form.extent()
            );
        }
        Ok(Some(self.form.mesh(edge)))
    }

    /// The same vessel filled to another level, in metres above its lowest point inside.
    ///
    /// # Errors
    /// A shape that has no level; a level that is not above 0 and at most the vessel's height.
    pub fn filled_to(&self, to: f64) -> Result<Self> {
        let mut filled = self.clone();
        match &mut filled.form {
            Form::Glass {
                level,
                height,
                wall,
                ..
            }
            | Form::Bowl {
                level,
                height,
                wall,
                ..
            }
            | Form::Box {
                level,
                height,
                wall,
                ..
            } => {
                let least = if *wall > 0.0 { LENGTH.0 } else { *height };
                if !(least..=*height).contains(&to) {
                    bail!("level {to}: expected from {least} to {height} (metres)");
                }
                *level = to;
                Ok(filled)
            }
            Form::Drop { .. } | Form::Pool | Form::Mesh(_) => {
                bail!(
                    "{}: it has no level; expected a glass, a bowl or a box",
                    self.title
                )
            }
        }
    }

    /// The shape that solvers take.
    ///
    /// # Errors
    /// A mesh that is not closed and oriented, or an edge that does not fit.
    pub fn shape(&self) -> Result<Shape> {
        match self.mesh()? {
            None => Ok(Shape::Pool),
            Some(mesh) => Shape::new(mesh),
        }
    }
}

impl Form {
    /// The smallest of its dimensions that shape the liquid, m.
    fn extent(&self) -> f64 {
        match self {
            Form::Drop { radius } => 2.0 * radius,
            Form::Glass { radius, height, .. } => f64::min(2.0 * radius, *height),
            Form::Bowl { radius, .. } => *radius,
            Form::Box {
                width,
                depth,
                height,
                ..
            } => width.min(*depth).min(*height),
            Form::Pool | Form::Mesh(_) => 1.0,
        }
    }

    /// The largest of its dimensions, m.
    fn longest(&self) -> f64 {
        match self {
            Form::Drop { radius } => *radius,
            Form::Glass {
                radius,
                height,
                wall,
                ..
            }
            | Form::Bowl {
                radius,
                height,
                wall,
                ..
            } => radius.max(*height).max(*wall),
            Form::Box {
                width,
                depth,
                height,
                wall,
                ..
            } => width.max(*depth).max(*height).max(*wall),
            Form::Pool | Form::Mesh(_) => 1.0,
        }
    }

    fn mesh(&self, edge: f64) -> Mesh {
        match *self {
            Form::Drop { radius } => drop(radius, edge),
            Form::Glass {
                radius,
                height,
                wall,
                level,
            } => glass(radius, height, wall, level, edge),
            Form::Bowl {
                radius,
                height,
                wall,
                level,
            } => bowl(radius, height, wall, level, edge),
            Form::Box {
                width,
                depth,
                height,
                wall,
                level,
            } => open_box([width, depth, height], wall, level, edge),
            Form::Pool => Mesh::default(),
            Form::Mesh(ref mesh) => mesh.clone(),
        }
    }
}

/// A ball of water, with the volume of the sphere.
fn drop(radius: f64, edge: f64) -> Mesh {
    let mesh = revolve(
        &[(arc(radius, 0.0, 0.0, PI, edge), Part::Free)],
        edge,
        (0.0, 0.0),
    );
    let exact = 4.0 / 3.0 * PI * radius.powi(3);
    let factor = (exact / mesh.volume()).cbrt();
    mesh.scaled(factor)
}

fn glass(radius: f64, height: f64, wall: f64, level: f64, edge: f64) -> Mesh {
    let free = vec![(radius, level), (0.0, level)];
    let outer = radius + wall;
    let wet = vec![(0.0, 0.0), (radius, 0.0), (radius, level)];
    let dry = vec![
        (0.0, -wall),
        (outer, -wall),
        (outer, height),
        (radius, height),
        (radius, level),
    ];
    let both = (radius, outer);
    revolve(&lines(wall, wet, dry, free), edge, both)
}

/// The profile of a vessel of revolution.
fn lines(
    wall: f64,
    wet: Vec<Corner>,
    dry: Vec<Corner>,
    free: Vec<Corner>,
) -> Vec<(Vec<Corner>, Part)> {
    if wall == 0.0 {
        return vec![(wet, Part::Solid), (free, Part::Free)];
    }
    vec![(wet, Part::Wet), (dry, Part::Dry), (free, Part::Free)]
}

/// Walls between two spheres of one centre, cut off level at the rim.
fn bowl(radius: f64, height: f64, wall: f64, level: f64, edge: f64) -> Mesh {
    let angle = |radius_at: f64, z: f64| ((radius - z) / radius_at).clamp(-1.0, 1.0).acos();
    let wet = arc(radius, radius, 0.0, angle(radius, level), edge);
    let mut dry = arc(
        radius + wall,
        radius,
        0.0,
        angle(radius + wall, height),
        edge,
    );
    if level < height {
        let inside = (angle(radius, height), angle(radius, level));
        dry.extend(arc(radius, radius, inside.0, inside.1, edge));
    } else {
        dry.extend(wet.last());
    }
    let free = vec![*wet.last().unwrap_or(&(0.0, level)), (0.0, level)];
    revolve(&lines(wall, wet, dry, free), edge, (0.0, 0.0))
}

/// The keys of a file, read with their places.
struct Fields<'a> {
    reader: Reader<'a>,
    table: &'a DeTable<'a>,
}

impl Fields<'_> {
    fn get(&self, key: &str) -> Result<&Spanned<DeValue<'_>>> {
        match self.table.get(key) {
            Some(value) => Ok(value),
            None => bail!(
                "{}: no `{key}`; expected one, as in `{}`",
                self.reader.name,
                example(key)
            ),
        }
    }

    fn error(&self, key: &str, message: impl std::fmt::Display) -> anyhow::Error {
        let at = self.table.get(key).map_or(0, |value| value.span().start);
        self.reader.error(at, message)
    }

    fn text(&self, key: &str) -> Result<&str> {
        match self.get(key)?.get_ref() {
            DeValue::String(text) => Ok(text),
            _ => Err(self.error(
                key,
                format!("{key}: expected a text in quotes, as in `{}`", example(key)),
            )),
        }
    }

    fn number(&self, key: &str, (least, most): (f64, f64)) -> Result<f64> {
        let number = match self.get(key)?.get_ref() {
            DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
                .ok()
                .map(|number| number as f64),
            DeValue::Float(number) => number.as_str().replace('_', "").parse().ok(),
            _ => None,
        };
        match number {
            Some(number) if (least..=most).contains(&number) => Ok(number),
            _ => Err(self.error(
                key,
                format!("{key}: expected a number from {least} to {most} (metres)"),
            )),
        }
    }

    /// A length that may not pass another.
    fn at_most(&self, key: &str, limit: &str) -> Result<f64> {
        let (value, most) = (self.number(key, LENGTH)?, self.number(limit, LENGTH)?);
        if value > most {
            return Err(self.error(key, format!("{key} = {value}: above `{limit}` = {most}")));
        }
        Ok(value)
    }

    /// A thickness; none only where the liquid fills the vessel.
    fn wall(&self) -> Result<f64> {
        let wall = self.number("wall", (0.0, LENGTH.1))?;
        if wall > 0.0 && wall < LENGTH.0 {
            let message = format!("wall = {wall}: expected 0, or at least {}", LENGTH.0);
            return Err(self.error("wall", message));
        }
        if wall == 0.0 && self.number("level", LENGTH)? != self.number("height", LENGTH)? {
            return Err(self.error(
                "wall",
                "wall = 0: expected `level` to be `height`, for thin walls hold no air",
            ));
        }
        Ok(wall)
    }

    fn names(&self, key: &str) -> Result<Vec<String>> {
        let Some(value) = self.table.get(key) else {
            return Ok(Vec::new());
        };
        let wanted = format!(
            "{key}: expected names of the mesh's parts, as in `{}`",
            example(key)
        );
        let DeValue::Array(names) = value.get_ref() else {
            return Err(self.error(key, wanted));
        };
        names
            .iter()
            .map(|name| match name.get_ref() {
                DeValue::String(name) => Ok(name.to_string()),
                DeValue::Integer(number) => Ok(number.as_str().to_owned()),
                _ => Err(self.reader.error(name.span().start, &wanted)),
            })
            .collect()
    }

    fn mesh(&self, folder: &Path) -> Result<Mesh> {
        let path = folder.join(self.text("file")?);
        let scale = match self.table.get("scale") {
            Some(_) => self.number("scale", (1e-6, 1e6))?,
            None => 1.0,
        };
        let mut parts = Vec::new();
        for (key, part) in [
            ("free", Part::Free),
            ("solid", Part::Solid),
            ("wet", Part::Wet),
            ("dry", Part::Dry),
        ] {
            for name in self.names(key)? {
                if parts.iter().any(|(known, _)| *known == name) {
                    return Err(self.error(
                        key,
                        format!("{key}: the part \"{name}\" stands in two lists"),
                    ));
                }
                parts.push((name, part));
            }
        }
        if !parts.iter().any(|(_, part)| *part == Part::Free) {
            bail!(
                "{}: no `free`; expected the parts of the mesh that are free surface, as in `{}`",
                self.reader.name,
                example("free")
            );
        }
        if self.table.get("edge").is_some() {
            return Err(self.error("edge", "edge: a mesh keeps the edges it has"));
        }
        mesh_file::open(&path, &parts, scale)
            .with_context(|| format!("{}: `file`", self.reader.name))
    }
}

fn example(key: &str) -> String {
    match key {
        "title" => "title = \"Drinking glass\"".to_owned(),
        "shape" => "shape = \"glass\"".to_owned(),
        "file" => "file = \"wave.obj\"".to_owned(),
        "free" | "solid" | "wet" | "dry" => format!("{key} = [\"name of a part\"]"),
        _ => format!("{key} = 0.05"),
    }
}
