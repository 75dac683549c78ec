//! Fire on the desk: turbulence and the sound of its vortices, baked into textures (VS §3–5).

pub mod advection;
pub mod flow;
pub mod grid;
pub mod inflow;
pub mod projection;
pub mod vortex_sound;
pub mod vorticity;
