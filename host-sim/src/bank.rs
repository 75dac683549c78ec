//! Writing a bank: scenes for a board's flash, read there by [`freshet::bank`].

use anyhow::{Context, Result, bail};
use freshet::bank::{self, Bank, Boot, HEADER, MAGIC, ROW, SceneRecord, VERSION};
use freshet::scene::Scene;

use crate::built_in;

/// The bank of all built-in scenes; a board starts with the one called `boot`.
pub fn built_in(boot: &str, seed: Option<u64>) -> Result<Vec<u8>> {
    let scenes = built_in::all()
        .map(|scene| scene.map(|(name, file)| (name, file.scene)))
        .collect::<Result<Vec<_>>>()?;
    let scene = scenes
        .iter()
        .position(|scene| scene.0 == boot)
        .with_context(|| format!("no scene `{boot}` to start with"))?;
    write(
        &scenes,
        Boot {
            scene: u16::try_from(scene)?,
            seed,
        },
    )
}

/// The bank of `scenes`, which have names, and of what to do when switched on.
pub fn write(scenes: &[(&str, Scene)], boot: Boot) -> Result<Vec<u8>> {
    let mut records = Vec::new();
    for (name, scene) in scenes {
        if name.is_empty() || name.len() > bank::NAME {
            bail!(
                "the scene's name `{name}` has {} bytes; expected 1 to {}",
                name.len(),
                bank::NAME
            );
        }
        records = postcard::to_extend(&SceneRecord::new(name, scene), records)?;
    }
    let sections = [
        (bank::BOOT, postcard::to_stdvec(&boot)?),
        (bank::SCENES, records),
    ];
    let bytes = assemble(&sections)?;
    Bank::open(&bytes).context("the bank cannot be read back")?;
    Ok(bytes)
}

fn assemble(sections: &[(u32, Vec<u8>)]) -> Result<Vec<u8>> {
    let mut rows = Vec::new();
    let mut bodies = Vec::new();
    let start = HEADER + sections.len() * ROW;
    for (kind, body) in sections {
        let offset = start + bodies.len();
        for word in [*kind, u32::try_from(offset)?, u32::try_from(body.len())?] {
            rows.extend(word.to_le_bytes());
        }
        bodies.extend_from_slice(body);
        // The next one begins at a word.
        bodies.resize(bodies.len().next_multiple_of(4), 0);
    }
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(u16::try_from(sections.len())?.to_le_bytes());
    bytes.extend(u32::try_from(start + bodies.len())?.to_le_bytes());
    let body = [rows, bodies].concat();
    bytes.extend(bank::checksum(&bytes, &body).to_le_bytes());
    bytes.extend(body);
    Ok(bytes)
}
