//! A quarter of a shape of revolution, from the profile it has around the z axis.

use std::f64::consts::{FRAC_PI_2, PI};

use super::mesh::{Builder, Mesh, Part};
use super::point::Point;

/// A corner of a profile: distance from the axis, height.
pub type Corner = (f64, f64);

/// Meshes lines (walked so that the surface's normal points to the right) with edges of about `edge`. Rings between
/// the radii of `wall` get the same number of points: both sides of a thin upright wall then lie face to face.
pub fn revolve(lines: &[(Vec<Corner>, Part)], edge: f64, wall: (f64, f64)) -> Mesh {
    let mut builder = Builder::default();
    builder.mesh.mirrors = [true, true];
    for (line, part) in lines {
        for pair in line.windows(2) {
            let ((r0, z0), (r1, z1)) = (pair[0], pair[1]);
            let steps = ((r1 - r0).hypot(z1 - z0) / edge).ceil().max(1.0) as usize;
            let at = |i: usize| {
                let t = i as f64 / steps as f64;
                ring(r0 + t * (r1 - r0), z0 + t * (z1 - z0), edge, wall)
            };
            for i in 0..steps {
                stitch(&mut builder, &at(i), &at(i + 1), *part);
            }
        }
    }
    builder.mesh
}

/// Points of an arc from the angle `from` to `to`, measured at (0, `height`) from straight down.
pub fn arc(radius: f64, height: f64, from: f64, to: f64, edge: f64) -> Vec<Corner> {
    let steps = (radius * (to - from).abs() / edge).ceil().max(1.0) as usize;
    (0..=steps)
        .map(|i| {
            let angle = from + (to - from) * i as f64 / steps as f64;
            let across = radius * angle.sin();
            // The pole lies on the axis exactly.
            let across = if across < 1e-9 * radius { 0.0 } else { across };
            (across, height - radius * angle.cos())
        })
        .collect()
}

/// A quarter of a circle as a polygon that encloses as much as the circle does.
fn ring(radius: f64, z: f64, edge: f64, wall: (f64, f64)) -> Vec<Point> {
    if radius <= 0.0 {
        return vec![[0.0, 0.0, z]];
    }
    let in_wall = radius > wall.0 * (1.0 - 1e-9) && radius < wall.1;
    let counted = if in_wall { wall.1 } else { radius };
    let n = (counted * FRAC_PI_2 / edge).round().max(2.0) as usize;
    let step = FRAC_PI_2 / n as f64;
    let radius = radius * (step / step.sin()).sqrt();
    (0..=n)
        .map(|i| match i {
            0 => [radius, 0.0, z],
            _ if i == n => [0.0, radius, z],
            _ => {
                let angle = step * i as f64;
                [radius * angle.cos(), radius * angle.sin(), z]
            }
        })
        .collect()
}

/// Joins two rings, each from the x axis to the y axis.
fn stitch(builder: &mut Builder, from: &[Point], to: &[Point], part: Part) {
    let (mut i, mut j) = (0, 0);
    let share = |i: usize, ring: &[Point]| {
        if ring.len() < 2 {
            PI
        } else {
            i as f64 / (ring.len() - 1) as f64
        }
    };
    while i + 1 < from.len() || j + 1 < to.len() {
        let step_from = j + 1 >= to.len()
            || (i + 1 < from.len() && share(i + 1, from) <= share(j + 1, to) + 1e-12);
        if step_from {
            builder.triangle([from[i], from[i + 1], to[j]], part);
            i += 1;
        } else {
            builder.triangle([from[i], to[j + 1], to[j]], part);
            j += 1;
        }
    }
}
