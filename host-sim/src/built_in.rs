//! The scenes that travel with the command and with the firmware.

use anyhow::Result;
use freshet::scene::Scene;

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

/// Name and scene of each, as a board has them.
pub fn named() -> Result<Vec<(String, Scene)>> {
    let named = |scene: Result<(&str, SceneFile)>| {
        let (name, file) = scene?;
        Ok((name.to_owned(), file.scene))
    };
    all().map(named).collect()
}

fn parse((name, text): &(&str, &str)) -> Result<SceneFile> {
    SceneFile::parse(&format!("scenes/{name}.toml"), text)
}
