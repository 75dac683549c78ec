//! The desk side of freshet: scenes, rendering, measuring. The command `freshet` is a thin shell over it.
#![forbid(unsafe_code)]

pub mod bank;
pub mod built_in;
pub mod scene_file;

#[cfg(feature = "command")]
pub mod bake;
#[cfg(feature = "command")]
pub mod bench;
#[cfg(feature = "sound")]
pub mod births;
#[cfg(feature = "sound")]
pub mod board;
#[cfg(feature = "command")]
pub mod bridge;
#[cfg(feature = "sound")]
pub mod bubble_events;
#[cfg(feature = "command")]
pub mod client;
#[cfg(feature = "command")]
pub mod cloud;
#[cfg(feature = "command")]
pub mod control;
#[cfg(feature = "command")]
pub mod fire;
#[cfg(feature = "command")]
pub mod flash;
#[cfg(feature = "command")]
pub mod keep;
#[cfg(feature = "command")]
pub mod list;
#[cfg(feature = "sound")]
pub mod load;
#[cfg(feature = "play")]
pub mod play;
#[cfg(feature = "flash")]
pub mod probe;
#[cfg(all(feature = "command", unix))]
mod pty;
#[cfg(feature = "command")]
pub mod record;
#[cfg(feature = "command")]
pub mod reference;
#[cfg(feature = "command")]
pub mod render;
#[cfg(feature = "command")]
pub mod replay;
#[cfg(feature = "command")]
pub mod simulate;
#[cfg(feature = "sound")]
pub mod source;
#[cfg(feature = "command")]
pub mod spectrogram;
#[cfg(feature = "command")]
pub mod talk;
#[cfg(feature = "command")]
pub mod transcript;
#[cfg(feature = "command")]
pub mod transfer;
#[cfg(feature = "sound")]
pub mod twin;
#[cfg(feature = "sound")]
pub mod wav;
