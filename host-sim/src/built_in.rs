//! The scenes that travel with the command and with the firmware.

use anyhow::Result;

use crate::scene_file::SceneFile;

include!(concat!(env!("OUT_DIR"), "/scenes.rs"));

/// The scene called `name`, if there is one.
pub fn scene(name: &str) -> Option<Result<SceneFile>> {
    SCENES.iter().find(|scene| scene.0 == name).map(parse)
}

/// Every scene, with its name.
pub fn all() -> impl Iterator<Item = Result<(&'static str, SceneFile)>> {
    SCENES.iter().map(|scene| Ok((scene.0, parse(scene)?)))
}

fn parse((name, text): &(&str, &str)) -> Result<SceneFile> {
    SceneFile::parse(&format!("scenes/{name}.toml"), text)
}
