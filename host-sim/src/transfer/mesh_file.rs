//! Triangles from other programs: OBJ with groups, PLY with a face property `part`.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};

use super::mesh::{Builder, Mesh, Part};
use super::point::{Point, scale};
use crate::scene_file::cannot_read;

/// Longest file and most triangles read.
const MAX_BYTES: u64 = 256 << 20;
const MAX_TRIANGLES: usize = 200_000;

/// Reads a mesh; `parts` says what each named part is, `factor` makes metres of its lengths.
///
/// # Errors
/// What is wrong, with the file's name and the line, or the number of the face.
pub fn open(path: &Path, parts: &[(String, Part)], factor: f64) -> Result<Mesh> {
    let name = path.display().to_string();
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
        .map_err(|error| cannot_read(path, &error))?;
    if bytes.len() as u64 > MAX_BYTES {
        bail!("{name}: more than {MAX_BYTES} bytes");
    }
    let mut soup = Soup {
        points: Vec::new(),
        builder: Builder::default(),
        parts,
        factor,
    };
    if bytes.starts_with(b"ply") {
        ply(&bytes, &mut soup)
    } else {
        obj(&String::from_utf8_lossy(&bytes), &mut soup)
    }
    .with_context(|| name.clone())?;
    if soup.builder.mesh.triangles.is_empty() {
        bail!("{name}: no triangles found; expected an OBJ file with faces, or a PLY file");
    }
    Ok(soup.builder.mesh)
}

/// What is collected while reading.
struct Soup<'a> {
    points: Vec<Point>,
    builder: Builder,
    parts: &'a [(String, Part)],
    factor: f64,
}

impl Soup<'_> {
    fn point(&mut self, point: Point) -> Result<()> {
        if !point.iter().all(|x| x.is_finite()) {
            bail!("expected three finite numbers, got {point:?}");
        }
        self.points.push(scale(point, self.factor));
        Ok(())
    }

    /// A face with any number of corners, numbered from 0.
    fn face(&mut self, corners: &[usize], part: &str) -> Result<()> {
        let Some((_, part)) = self.parts.iter().find(|(name, _)| name == part) else {
            let known: Vec<&str> = self.parts.iter().map(|part| part.0.as_str()).collect();
            bail!(
                "a face of the part \"{part}\", which the vessel names in none of `free`, `solid`, `wet` and `dry` ({})",
                known.join(", ")
            );
        };
        if corners.len() < 3 {
            bail!(
                "a face with {} corners: expected three or more",
                corners.len()
            );
        }
        let mut points = Vec::with_capacity(corners.len());
        for corner in corners {
            points.push(*self.points.get(*corner).with_context(|| {
                format!(
                    "point {} of {}: there is none",
                    corner.saturating_add(1),
                    self.points.len()
                )
            })?);
        }
        for i in 2..points.len() {
            self.builder
                .triangle([points[0], points[i - 1], points[i]], *part);
        }
        if self.builder.mesh.triangles.len() > MAX_TRIANGLES {
            bail!("more than {MAX_TRIANGLES} triangles");
        }
        Ok(())
    }
}

fn obj(text: &str, soup: &mut Soup<'_>) -> Result<()> {
    let mut part = String::from("default");
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let done = match word {
            "v" => numbers(rest.split_whitespace()).and_then(|point| soup.point(point)),
            "f" => rest
                .split_whitespace()
                .map(|corner| obj_corner(corner, soup.points.len()))
                .collect::<Result<Vec<usize>>>()
                .and_then(|corners| soup.face(&corners, &part)),
            "g" | "o" | "usemtl" => {
                rest.trim().clone_into(&mut part);
                Ok(())
            }
            _ => Ok(()),
        };
        done.with_context(|| format!("line {}", number + 1))?;
    }
    Ok(())
}

/// `7`, `7/1/3` or `-1`, counted from the last.
fn obj_corner(text: &str, points: usize) -> Result<usize> {
    let number = text.split('/').next().unwrap_or_default();
    let wanted = || anyhow!("`{text}`: expected the number of a point, from 1 to {points}");
    let index: i64 = number.parse().map_err(|_| wanted())?;
    let index = if index < 0 {
        points as i64 + index
    } else {
        index - 1
    };
    usize::try_from(index)
        .ok()
        .filter(|index| *index < points)
        .ok_or_else(wanted)
}

fn numbers<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Point> {
    let mut point = [0.0; 3];
    for x in &mut point {
        let word = words.next().context("expected three numbers")?;
        *x = word
            .parse()
            .map_err(|_| anyhow!("`{word}`: expected a number"))?;
    }
    Ok(point)
}

/// A property of a PLY element: its name, type, and for a list the type of its length.
struct Property {
    name: String,
    kind: String,
    length: Option<String>,
}

fn ply(bytes: &[u8], soup: &mut Soup<'_>) -> Result<()> {
    let end = b"end_header";
    let header = bytes
        .windows(end.len())
        .take(1 << 16)
        .position(|window| window == end)
        .context("no `end_header`")?;
    let text = String::from_utf8_lossy(&bytes[..header]);
    let mut elements: Vec<(String, usize, Vec<Property>)> = Vec::new();
    let mut format = String::new();
    for (number, line) in text.lines().enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match *words.as_slice() {
            ["format", kind, _] => kind.clone_into(&mut format),
            ["element", name, count] => {
                let count = count
                    .parse()
                    .map_err(|_| anyhow!("line {}: `{count}`: expected a count", number + 1))?;
                elements.push((name.to_owned(), count, Vec::new()));
            }
            ["property", ref rest @ ..] => {
                let (name, kind, length) = match *rest {
                    ["list", length, kind, name] => (name, kind, Some(length.to_owned())),
                    [kind, name] => (name, kind, None),
                    _ => bail!("line {}: `{line}`: expected a property", number + 1),
                };
                let element = elements.last_mut().with_context(|| {
                    format!("line {}: a property before any element", number + 1)
                })?;
                element.2.push(Property {
                    name: name.to_owned(),
                    kind: kind.to_owned(),
                    length,
                });
            }
            _ => {}
        }
    }
    let body = &bytes[header + end.len()..];
    let skip = body
        .iter()
        .position(|byte| *byte == b'\n')
        .map_or(body.len(), |at| at + 1);
    let mut values = Values {
        body: &body[skip..],
        big: match format.as_str() {
            "ascii" => None,
            "binary_little_endian" => Some(false),
            "binary_big_endian" => Some(true),
            _ => bail!(
                "format `{format}`: expected ascii, binary_little_endian or binary_big_endian"
            ),
        },
    };
    for (element, count, properties) in elements {
        // Nothing to read, however many there are.
        if properties.is_empty() {
            continue;
        }
        for row in 0..count {
            let mut point = [f64::NAN; 3];
            let (mut corners, mut part) = (Vec::new(), 0.0);
            for property in &properties {
                let length = match &property.length {
                    Some(kind) => values.next(kind),
                    None => Ok(1.0),
                };
                let length = length.with_context(|| format!("{element} {}", row + 1))?;
                // No list of a mesh is that long; a broken one says anything.
                if !(0.0..=1e6).contains(&length) {
                    bail!("{element} {}: a list of {length} entries", row + 1);
                }
                for _ in 0..length as usize {
                    let value = values
                        .next(&property.kind)
                        .with_context(|| format!("{element} {}", row + 1))?;
                    match (element.as_str(), property.name.as_str()) {
                        ("vertex", "x") => point[0] = value,
                        ("vertex", "y") => point[1] = value,
                        ("vertex", "z") => point[2] = value,
                        ("face", "vertex_indices" | "vertex_index") => corners.push(index(value)),
                        ("face", "part") => part = value,
                        _ => {}
                    }
                }
            }
            match element.as_str() {
                "vertex" => soup.point(point),
                "face" => soup.face(&corners, &format!("{part}")),
                _ => Ok(()),
            }
            .with_context(|| format!("{element} {}", row + 1))?;
        }
    }
    Ok(())
}

/// The number of a point; none that exists where it is not one.
fn index(value: f64) -> usize {
    if value >= 0.0 && value.fract() == 0.0 {
        value as usize
    } else {
        usize::MAX
    }
}

/// The numbers after a PLY header.
struct Values<'a> {
    body: &'a [u8],
    /// Binary, and which end first; `None` for text.
    big: Option<bool>,
}

impl Values<'_> {
    fn next(&mut self, kind: &str) -> Result<f64> {
        let Some(big) = self.big else {
            let start = self
                .body
                .iter()
                .position(|byte| !byte.is_ascii_whitespace());
            let rest = &self.body[start.context("the file ends too early")?..];
            let end = rest
                .iter()
                .position(u8::is_ascii_whitespace)
                .unwrap_or(rest.len());
            self.body = &rest[end..];
            let word = String::from_utf8_lossy(&rest[..end]);
            return word
                .parse()
                .map_err(|_| anyhow!("`{word}`: expected a number"));
        };
        let size = match kind {
            "char" | "uchar" | "int8" | "uint8" => 1,
            "short" | "ushort" | "int16" | "uint16" => 2,
            "int" | "uint" | "float" | "int32" | "uint32" | "float32" => 4,
            "double" | "float64" => 8,
            _ => bail!("type `{kind}`: expected a PLY type such as float or int"),
        };
        if self.body.len() < size {
            bail!("the file ends too early");
        }
        let (head, rest) = self.body.split_at(size);
        self.body = rest;
        let mut bytes = [0; 8];
        for (i, byte) in head.iter().enumerate() {
            bytes[if big { size - 1 - i } else { i }] = *byte;
        }
        let raw = u64::from_le_bytes(bytes);
        Ok(match kind {
            "char" | "int8" => f64::from(raw as i8),
            "uchar" | "uint8" => f64::from(raw as u8),
            "short" | "int16" => f64::from(raw as i16),
            "ushort" | "uint16" => f64::from(raw as u16),
            "int" | "int32" => f64::from(raw as i32),
            "uint" | "uint32" => f64::from(raw as u32),
            "float" | "float32" => f64::from(f32::from_bits(raw as u32)),
            _ => f64::from_bits(raw),
        })
    }
}
