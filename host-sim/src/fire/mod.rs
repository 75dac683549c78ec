//! Fire on the desk: turbulence and the sound of its vortices, baked into textures (VS §3–5).
//!
//! [`flow`] is an incompressible flow on a [`grid`]: [`advection`], [`vorticity`] with its confinement, [`projection`], fed by
//! an [`inflow`]. [`vortex_sound`] hears it. A [`row`] of a [`texture`] is the sound of one speed; [`baking`] makes all that a
//! [`fire_file`] asks for.

pub mod advection;
pub mod baking;
pub mod energy_spectrum;
pub mod fire_file;
pub mod flow;
pub mod grid;
pub mod inflow;
pub mod picture;
pub mod projection;
pub mod row;
pub mod sound;
pub mod texture;
pub mod vortex_sound;
pub mod vorticity;
