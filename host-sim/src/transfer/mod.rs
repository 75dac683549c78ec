//! From bubble to ear: acoustic transfer through a frozen liquid, its walls and the air (HF §4–6).
//!
//! `e^{+iωt}`, outgoing waves `e^{−ikR}`. In the water `(∇² + k²)P = S_b δ(x − x_b)`, P = 0 on the free surface and
//! ∂P/∂n = 0 on solids; in the air ∂P/∂n is the water's on the free surface and 0 on solids. What is computed is
//! P/S_b at the ear in 1/m; sound in pascal takes [`DENSITY_RATIO`] besides.

pub mod bench;
mod block;
pub mod command;
mod elements;
pub mod mesh;
mod mesh_file;
pub mod multipoles;
mod panel;
mod picture;
mod plane;
mod point;
mod revolve;
pub mod shape;
pub mod solver;
pub mod vessel;

pub use point::Point;

/// A medium at rest.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Speed of sound, m/s.
    pub speed: f64,
    /// kg/m³.
    pub density: f64,
}

/// Water and air as in HF table 3.
pub const WATER: Medium = Medium {
    speed: 1497.0,
    density: 1000.0,
};
/// See [`WATER`].
pub const AIR: Medium = Medium {
    speed: 343.0,
    density: 1.2,
};

/// ρ_a/ρ: the pressure that a surface moved by a pressure gradient in water makes in air. HF omit it.
pub const DENSITY_RATIO: f64 = AIR.density / WATER.density;
