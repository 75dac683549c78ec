//! Bubbles that hear each other: the coupled cloud on the desk, in f64 (CB §3–4).
//!
//! [`coupling`] says how much, [`modes`] what that does to the pitches, [`step`] how one bubble is stepped so that it
//! is exact when alone. [`dense`] and [`reduced`] solve the coupled step; [`ensemble`] and [`player`] play what [`tracks`] (a file)
//! or [`synthetic`] (a generator) bring, struck by [`forcing`].

pub mod cloud_command;
pub mod coupling;
pub mod dense;
pub mod ensemble;
pub mod forcing;
pub mod modes;
pub mod modes_command;
pub mod player;
pub mod reduced;
pub mod render;
pub mod solver;
pub mod static_cloud;
pub mod step;
pub mod synthetic;
pub mod tracks;
pub mod wide;
