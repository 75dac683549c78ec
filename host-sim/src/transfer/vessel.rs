//! Vessel files (to be written out).
use super::mesh::{Mesh, Part};
use super::revolve::{arc, revolve};
use std::f64::consts::PI;

/// A drop.
pub fn drop(radius: f64, edge: f64) -> Mesh {
    let mesh = revolve(&[(arc(radius, 0.0, 0.0, PI, edge), Part::Free)], edge);
    let exact = 4.0 / 3.0 * PI * radius.powi(3);
    let factor = (exact / mesh.volume()).cbrt();
    mesh.scaled(factor)
}

/// A glass.
pub fn glass(radius: f64, height: f64, wall: f64, level: f64, edge: f64) -> Mesh {
    let outer = radius + wall;
    let wet = vec![(0.0, 0.0), (radius, 0.0), (radius, level)];
    let dry = vec![
        (0.0, -wall),
        (outer, -wall),
        (outer, height),
        (radius, height),
        (radius, level),
    ];
    let free = vec![(radius, level), (0.0, level)];
    revolve(&[(wet, Part::Wet), (dry, Part::Dry), (free, Part::Free)], edge)
}
