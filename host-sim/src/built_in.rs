//! The scenes that travel with the command and with the firmware.

use anyhow::Result;

use crate::scene_file::SceneFile;

include!(concat!(env!("OUT_DIR"), "/scenes.rs"));

/// The scene called `name`, if there is one.
pub fn scene(name: &str) -> Option<Result<SceneFile>> {
    let (name, text) = SCENES.iter().find(|scene| scene.0 == name)?;
    Some(SceneFile::parse(&format!("scenes/{name}.toml"), text))
}
