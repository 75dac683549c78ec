//! `freshet bake`: what a board keeps in flash, computed from a TOML whose tables say what it is.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Result, anyhow};
use clap::Args;
use toml::de::DeTable;

use crate::fire::baking;
use crate::scene_file::{Reader, cannot_read};
use crate::spectrogram;

/// Longest file read, bytes.
const MOST: u64 = 1 << 20;

/// What `freshet bake` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A fire, such as fires/campfire.toml
    pub input: PathBuf,
    /// Where the texture goes; an interrupted bake goes on from what lies beside it
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Draw the vorticity of the fastest flow, in a slice
    #[arg(long, value_name = "PNG")]
    pub slice: Option<PathBuf>,
    /// Draw the energy over sizes of eddies
    #[arg(long, value_name = "PNG")]
    pub energy: Option<PathBuf>,
    /// Draw the sound of the rows
    #[arg(long, value_name = "PNG")]
    pub spectrogram: Option<PathBuf>,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Report {
    /// For people.
    pub summary: String,
    /// Whether Ctrl-C ended it.
    pub interrupted: bool,
}

/// Bakes until it is done or `stop` is set.
///
/// # Errors
/// A file that cannot be read or written; a TOML that says nothing to bake, or something wrong, with the place.
pub fn bake(request: &Request, stop: &AtomicBool) -> Result<Report> {
    for path in [&request.slice, &request.energy, &request.spectrogram] {
        path.as_deref().map_or(Ok(()), spectrogram::check_name)?;
    }
    let name = request.input.display().to_string();
    let text = read(&request.input)?;
    let reader = Reader {
        name: &name,
        text: &text,
    };
    let table = DeTable::parse(&text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        reader.error(at, format!("not valid TOML: {}", error.message()))
    })?;
    if table.get_ref().contains_key("turbulence") {
        return baking::bake(request, &name, &text, stop);
    }
    Err(anyhow!(
        "{name}: nothing to bake; expected a fire, with the tables [turbulence] and [texture]"
    ))
}

fn read(path: &Path) -> Result<String> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MOST + 1).read_to_end(&mut bytes))
        .map_err(|error| cannot_read(path, &error))?;
    let wrong = |what: &str| anyhow!("{}: expected a TOML file, got {what}", path.display());
    if bytes.len() as u64 > MOST {
        return Err(wrong(&format!("more than {MOST} bytes")));
    }
    String::from_utf8(bytes).map_err(|_| wrong("bytes that are not UTF-8"))
}
