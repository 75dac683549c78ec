//! Water and fire from physics, in fixed point: the core that sounds the same on a desk and on a microcontroller.
//!
//! A [scene] over one constant [table](param) → [`Control`](control::Control), once a [tick](frame::TICK), makes
//! settings → [`Synth`] renders blocks of [`Frame`]s from them. [`Instrument`] keeps the two in step.
//!
//! One bus carries pressure in pascal at 1 m from the scene; [`fixed::FULL_SCALE_PA`] of them are digital full scale.
//! The audio path is integer arithmetic; what is derived from parameters is f64 through `libm`. The same profile,
//! seed, scene and parameter events give the same samples on every machine.
#![no_std]
#![deny(unsafe_code)]

pub mod bank;
pub mod bubble;
pub mod cloud;
pub mod control;
pub mod drops;
pub mod fixed;
pub mod frame;
mod kernel;
pub mod limiter;
pub mod mix;
pub mod observer;
pub mod param;
pub mod population;
pub mod profile;
pub mod protocol;
pub mod random;
pub mod resonator;
pub mod scene;
pub mod stats;
pub mod storage;
pub mod swell;
pub mod synth;
pub mod texture;
pub mod update;
pub mod voices;

pub use frame::{BLOCK, Block, Frame, TICK};
pub use synth::{Instrument, Synth};
pub use update::Update;
