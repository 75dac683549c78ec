//! The desk side of freshet: scenes, rendering, measuring. The command `freshet` is a thin shell over it.
#![forbid(unsafe_code)]

pub mod bench;
pub mod births;
pub mod board;
pub mod bubble_events;
pub mod flash;
pub mod list;
#[cfg(feature = "play")]
pub mod play;
#[cfg(feature = "flash")]
pub mod probe;
pub mod reference;
pub mod render;
pub mod scene_file;
pub mod source;
pub mod spectrogram;
pub mod wav;
