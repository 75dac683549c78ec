//! `freshet bake`: what a board keeps in flash, computed from a TOML that says what it is.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use clap::Args;

/// What `freshet bake` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A fire (`fires/NAME.toml`)
    pub input: PathBuf,
    /// Where it goes
    #[arg(short, long)]
    pub output: PathBuf,
}

/// What came of it.
pub struct Report {
    /// For people.
    pub summary: String,
    /// Whether it was stopped before the end.
    pub interrupted: bool,
}

/// Bakes.
pub fn bake(_request: &Request, _stop: &AtomicBool) -> Result<Report> {
    anyhow::bail!("not yet")
}
