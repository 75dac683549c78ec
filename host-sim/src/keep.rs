//! What a twin keeps over a restart, as a file: TOML, so that it can be read and mended.
//!
//! ```toml
//! version = 1
//! boot = "preset 3"
//!
//! [preset.3]
//! name = "my rain"
//! scene = "light-rain"
//! values = { "mix.level" = -9.0, "water.rate" = 123.0 }
//! ```

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use freshet::param::{self, TABLE};
use freshet::protocol::{Name, Preset, Request, SLOTS, Slot, parse};
use serde::{Deserialize, Serialize};

use crate::scene_file::{cannot_read, expectation, unknown_path};
use crate::twin::Kept;
use crate::wav::write_error;

const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    version: u32,
    boot: String,
    #[serde(default)]
    preset: BTreeMap<String, StoredPreset>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredPreset {
    name: String,
    scene: String,
    values: BTreeMap<String, f32>,
}

/// Reads what was kept in `path`; nothing, where there is no such file yet.
pub fn load(path: &Path) -> Result<Kept> {
    match fs::read_to_string(path) {
        Ok(text) => read(&text).with_context(|| path.display().to_string()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Kept::default()),
        Err(error) => Err(cannot_read(path, &error)),
    }
}

/// Writes it, all or nothing: whatever happens meanwhile, the old file or the new one is there.
pub fn save(path: &Path, kept: &Kept) -> Result<()> {
    let text = write(kept)?;
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    let new = Path::new(&name);
    let all = || -> io::Result<()> {
        let mut file = File::create(new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(new, path)
    };
    all().map_err(|error| {
        let _ = fs::remove_file(new);
        write_error(path.display(), &error)
    })
}

fn write(kept: &Kept) -> Result<String> {
    let preset = |(slot, preset): (&Slot, &Preset)| {
        let values = preset.values.iter().filter_map(|(id, value)| {
            let param = &TABLE[param::index_of_id(*id)?];
            Some((param.path.to_owned(), *value))
        });
        let stored = StoredPreset {
            name: preset.name.to_string(),
            scene: preset.scene.to_string(),
            values: values.collect(),
        };
        (slot.to_string(), stored)
    };
    let stored = Stored {
        version: VERSION,
        boot: kept.boot.boot().to_string(),
        preset: kept.presets.iter().map(preset).collect(),
    };
    let text = toml::to_string(&stored)?;
    Ok(format!(
        "# What `freshet simulate --keep` keeps: presets by their slots; 0 are the settings stored last.\n{text}"
    ))
}

fn read(text: &str) -> Result<Kept> {
    #[derive(Deserialize)]
    struct Version {
        version: u32,
    }
    let Version { version } = toml::from_str(text).map_err(|error| told(&error))?;
    if version != VERSION {
        bail!("a file of version {version}, expected {VERSION}: another freshet wrote it");
    }
    let stored: Stored = toml::from_str(text).map_err(|error| told(&error))?;
    let line = format!("boot {}", stored.boot);
    let boot = match parse(&line, &mut |_| {}) {
        Ok(Request::SetBoot(boot)) => boot.into(),
        _ => bail!(
            "boot = {:?}: expected default, settings, scene NAME or preset SLOT",
            stored.boot
        ),
    };
    let preset = |(slot, stored): (String, StoredPreset)| {
        let number = slot.parse().ok().filter(|slot| *slot <= SLOTS);
        let number = number.with_context(|| format!("[preset.{slot}]: expected 0 to {SLOTS}"))?;
        let preset = preset(&stored).with_context(|| format!("[preset.{slot}]"))?;
        Ok((number, preset))
    };
    Ok(Kept {
        presets: stored
            .preset
            .into_iter()
            .map(preset)
            .collect::<Result<_>>()?,
        boot,
    })
}

fn preset(stored: &StoredPreset) -> Result<Preset> {
    let mut values = Vec::new();
    for (path, value) in &stored.values {
        let param = &TABLE[param::index_of(path).ok_or_else(|| unknown_path(path))?];
        if !param.accepts(*value) {
            bail!("{path} = {value}: expected {}", expectation(param));
        }
        values.push((param.id, *value));
    }
    Ok(Preset {
        name: name(&stored.name)?,
        scene: name(&stored.scene)?,
        values: values.into_iter().collect(),
    })
}

fn name(text: &str) -> Result<Name> {
    Name::try_from(text).map_err(|_| anyhow!("the name {text:?} is longer than 32 bytes"))
}

/// What TOML says, in a line.
fn told(error: &toml::de::Error) -> anyhow::Error {
    anyhow!("{}", error.to_string().trim().replace('\n', " "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use freshet::protocol::BootRecord;

    #[test]
    fn what_is_kept_comes_back_bit_for_bit() {
        let values = [(501, -9.1), (101, f32::from_bits(0x4479_ffff)), (105, 2.0)];
        let preset = Preset {
            name: Name::try_from("my rain").unwrap(),
            scene: Name::try_from("light-rain").unwrap(),
            values: values.into_iter().collect(),
        };
        let kept = Kept {
            presets: [(0, Preset::default()), (16, preset)].into(),
            boot: BootRecord::Preset(16),
        };
        let text = write(&kept).unwrap();
        let mut back = read(&text).unwrap();
        let values = &mut back.presets.get_mut(&16).unwrap().values;
        // By their paths.
        assert_eq!(values[0].0, 501);
        values.sort_by_key(|(id, _)| [501, 101, 105].iter().position(|known| known == id));
        assert_eq!(back, kept, "{text}");
    }

    #[test]
    fn what_is_wrong_in_a_file_is_named() {
        let preset = |rest: &str| {
            format!(
                "version = 1\nboot = \"default\"\n[preset.3]\nname = \"\"\nscene = \"brook\"\n{rest}"
            )
        };
        for (text, words) in [
            ("version = 2".to_owned(), "version 2, expected 1"),
            ("version".to_owned(), "line 1"),
            (
                "version = 1\nboot = \"never\"".to_owned(),
                "boot = \"never\": expected default",
            ),
            (
                preset("values = { \"water.rat\" = 1.0 }"),
                "did you mean `water.rate`",
            ),
            (
                preset("values = { \"mix.level\" = 99.0 }"),
                "mix.level = 99: expected",
            ),
            (
                preset("values = {}").replace("preset.3", "preset.17"),
                "[preset.17]: expected 0 to 16",
            ),
            (preset("value = {}"), "unknown field"),
        ] {
            let error = format!("{:#}", read(&text).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
    }
}
