//! Triangles that bound the liquid and the air, and the check that they do.

use std::collections::HashMap;

use anyhow::{Result, bail};

use super::point::{Point, cross, distance, dot, norm, scale, sub};

/// What lies on the two sides of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Liquid inside, air outside: P = 0 seen from the water, and what radiates into the air.
    Free,
    /// A wall without thickness: liquid inside, air outside.
    Solid,
    /// The wet side of a thick wall; its normal points out of the liquid.
    Wet,
    /// The dry side of a thick wall; its normal points into the air.
    Dry,
}

impl Part {
    /// Whether the liquid touches it.
    pub fn bounds_water(self) -> bool {
        self != Part::Dry
    }

    /// Whether the air touches it.
    pub fn bounds_air(self) -> bool {
        self != Part::Wet
    }
}

/// Triangles with parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners of the triangles, m.
    pub points: Vec<Point>,
    /// Counter-clockwise seen from where the normal points: out of the liquid, or into the air.
    pub triangles: Vec<([usize; 3], Part)>,
    /// Whether x = 0 and y = 0 are mirror planes; then only x ≥ 0 or y ≥ 0 is meshed.
    pub mirrors: [bool; 2],
}

impl Mesh {
    /// Refuses what is not a closed, oriented surface around the liquid, and one around liquid and walls.
    pub fn check(&self) -> Result<()> {
        if !self.triangles.iter().any(|t| t.1 == Part::Free) {
            bail!("no free surface: nothing can be heard");
        }
        for (corners, _) in &self.triangles {
            let [a, b, c] = corners.map(|i| self.points[i]);
            let double = cross(sub(b, a), sub(c, a));
            let longest = distance(a, b).max(distance(b, c)).max(distance(c, a));
            if dot(double, double).sqrt() < 1e-9 * longest * longest || longest == 0.0 {
                bail!("a triangle at {} has no area", show(a));
            }
        }
        self.check_closed("the liquid's surface", Part::bounds_water)?;
        self.check_closed("the surface towards the air", Part::bounds_air)
    }

    fn check_closed(&self, what: &str, belongs: fn(Part) -> bool) -> Result<()> {
        let mut edges: HashMap<(usize, usize), u32> = HashMap::new();
        let mut volume = 0.0;
        for (corners, _) in self.triangles.iter().filter(|t| belongs(t.1)) {
            let [a, b, c] = corners.map(|i| self.points[i]);
            volume += dot(a, cross(b, c)) / 6.0;
            for i in 0..3 {
                *edges.entry((corners[i], corners[(i + 1) % 3])).or_default() += 1;
            }
        }
        let on_mirror = |i: usize, j: usize| {
            (0..2).any(|axis| {
                let near = |i: usize| self.points[i][axis].abs() < 1e-9;
                self.mirrors[axis] && near(i) && near(j)
            })
        };
        // In an order that does not depend on the table's.
        let mut sorted: Vec<_> = edges.iter().collect();
        sorted.sort();
        for ((from, to), count) in sorted {
            let (a, b) = (show(self.points[*from]), show(self.points[*to]));
            if *count > 1 {
                bail!(
                    "{what} is not oriented, or branches: two triangles run along the edge from {a} to {b} the same way; \
                     expected normals that point out of the liquid and into the air"
                );
            }
            if !edges.contains_key(&(*to, *from)) && !on_mirror(*from, *to) {
                bail!(
                    "{what} is not watertight: a triangle has no neighbour at the edge from {a} to {b}"
                );
            }
        }
        if volume <= 0.0 {
            bail!(
                "{what} is inside out: expected normals that point out of the liquid and into the air"
            );
        }
        Ok(())
    }

    /// The same surface, times `factor`.
    pub fn scaled(mut self, factor: f64) -> Self {
        for point in &mut self.points {
            *point = scale(*point, factor);
        }
        self
    }

    /// Area in m², the reflections included.
    pub fn area(&self) -> f64 {
        let double = |[a, b, c]: [Point; 3]| norm(cross(sub(b, a), sub(c, a)));
        let triangles = self.triangles.iter();
        let meshed: f64 = triangles
            .map(|t| 0.5 * double(t.0.map(|i| self.points[i])))
            .sum();
        meshed * images(self.mirrors).len() as f64
    }

    /// Volume of what the triangles of the liquid enclose, m³.
    pub fn volume(&self) -> f64 {
        let meshed: f64 = self
            .triangles
            .iter()
            .filter(|t| t.1.bounds_water())
            .map(|(corners, _)| {
                let [a, b, c] = corners.map(|i| self.points[i]);
                dot(a, cross(b, c)) / 6.0
            })
            .sum();
        meshed * images(self.mirrors).len() as f64
    }
}

/// The reflections that make the whole of the part meshed, each as signs of x and y; the first is the identity.
pub fn images(mirrors: [bool; 2]) -> Vec<[f64; 2]> {
    let signs = |mirror: bool| if mirror { vec![1.0, -1.0] } else { vec![1.0] };
    let mut all = Vec::new();
    for y in signs(mirrors[1]) {
        for x in signs(mirrors[0]) {
            all.push([x, y]);
        }
    }
    all
}

/// A reflected point.
pub fn reflect(point: Point, signs: [f64; 2]) -> Point {
    [point[0] * signs[0], point[1] * signs[1], point[2]]
}

/// A point for messages, m.
pub fn show(point: Point) -> String {
    let [x, y, z] = point.map(|x| (x * 1e6).round() / 1e6);
    format!("({x}, {y}, {z})")
}

/// Collects triangles; points at the same place are one.
#[derive(Default)]
pub(super) struct Builder {
    pub mesh: Mesh,
    known: HashMap<[i64; 3], usize>,
}

impl Builder {
    /// The point's number; the same for the same place to 10 nm.
    pub fn point(&mut self, point: Point) -> usize {
        let key = point.map(|x| (x * 1e8).round() as i64);
        *self.known.entry(key).or_insert_with(|| {
            self.mesh.points.push(point);
            self.mesh.points.len() - 1
        })
    }

    pub fn triangle(&mut self, corners: [Point; 3], part: Part) {
        let corners = corners.map(|corner| self.point(corner));
        let [a, b, c] = corners;
        if a != b && b != c && c != a {
            self.mesh.triangles.push((corners, part));
        }
    }
}
