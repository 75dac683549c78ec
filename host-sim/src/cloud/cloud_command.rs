//! `freshet cloud`: synthetic clouds and streams.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;

use super::static_cloud;
use super::synthetic::{Law, Stream, ball, write_stream};
use crate::wav::write_error;

/// What `freshet cloud` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// Where it goes: `.csv` is a cloud that stands still (for `freshet modes`), anything else bubble tracks
    pub output: PathBuf,
    /// Bubbles of a cloud that stands still
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub count: usize,
    /// Radius of its ball, mm
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 40.0,
        allow_hyphen_values = true
    )]
    pub ball: f64,
    /// Smallest radius, mm
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.5,
        allow_hyphen_values = true
    )]
    pub radius_min: f64,
    /// Largest radius, mm
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 3.0,
        allow_hyphen_values = true
    )]
    pub radius_max: f64,
    /// Tracks: how radii are spread
    #[arg(long, value_enum, default_value = "log")]
    pub law: Law,
    /// Tracks: how long births go on
    #[arg(
        long,
        value_name = "S",
        default_value_t = 4.0,
        allow_hyphen_values = true
    )]
    pub seconds: f64,
    /// Tracks: births a second
    #[arg(
        long,
        value_name = "HZ",
        default_value_t = 500.0,
        allow_hyphen_values = true
    )]
    pub rate: f64,
    /// Tracks: width, height and depth of where they are born, mm
    #[arg(long, value_name = "MM", num_args = 3, default_values_t = [80.0, 60.0, 80.0], allow_hyphen_values = true)]
    pub region: Vec<f64>,
    /// Tracks: how fast they rise, m/s
    #[arg(
        long,
        value_name = "M/S",
        default_value_t = 0.25,
        allow_hyphen_values = true
    )]
    pub rise: f64,
    /// Tracks: mean life, s; nobody lives past the surface
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.1,
        allow_hyphen_values = true
    )]
    pub life: f64,
    /// Tracks: part that splits in two
    #[arg(
        long,
        value_name = "PART",
        default_value_t = 0.2,
        allow_hyphen_values = true
    )]
    pub split: f64,
    /// Tracks: part that merges with another
    #[arg(
        long,
        value_name = "PART",
        default_value_t = 0.1,
        allow_hyphen_values = true
    )]
    pub merge: f64,
    /// The same seed gives the same bubbles
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Writes what is asked; a line about it.
///
/// # Errors
/// A number out of range, a file that cannot be written.
pub fn run(request: &Request) -> Result<String> {
    for (name, value, low, high) in [
        ("ball", request.ball, 0.0, 1e5),
        ("radius-min", request.radius_min, 0.01, 500.0),
        ("radius-max", request.radius_max, request.radius_min, 500.0),
        ("seconds", request.seconds, 1e-3, 1e5),
        ("rate", request.rate, 1e-3, 1e6),
        ("rise", request.rise, 0.0, 10.0),
        ("life", request.life, 1e-3, 1e5),
        ("split", request.split, 0.0, 1.0),
        ("merge", request.merge, 0.0, 1.0 - request.split),
        ("region", request.region[0], 0.0, 1e5),
        ("region", request.region[1], 0.0, 1e5),
        ("region", request.region[2], 0.0, 1e5),
    ] {
        if !(low..=high).contains(&value) {
            bail!("--{name} {value}: expected a number from {low} to {high}");
        }
    }
    if !(1..=static_cloud::MOST).contains(&request.count) {
        bail!(
            "--count {}: expected from 1 to {}",
            request.count,
            static_cloud::MOST
        );
    }
    let path = &request.output;
    let failed = |error: std::io::Error| write_error(path.display(), &error);
    let mut out: Box<dyn Write> = if path == Path::new("-") {
        Box::new(std::io::stdout().lock())
    } else {
        Box::new(std::fs::File::create(path).map_err(failed)?)
    };
    let mut writer = BufWriter::new(&mut out);
    let [low, high] = [request.radius_min, request.radius_max].map(|mm| mm / 1e3);
    let is_csv = path
        .extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("csv"));
    let line = if is_csv {
        let places = ball(request.count, request.ball / 1e3, low, high, request.seed);
        static_cloud::write(&places, &mut writer).map_err(failed)?;
        format!(
            "{}  {} bubbles in a ball of {} mm",
            path.display(),
            places.len(),
            request.ball
        )
    } else {
        let stream = Stream {
            seconds: request.seconds,
            rate: request.rate,
            radius: [low, high],
            law: request.law,
            region: [0, 1, 2].map(|axis| request.region[axis] / 1e3),
            rise: request.rise,
            life: request.life,
            split: request.split,
            merge: request.merge,
            step: 1e-3,
            seed: request.seed,
        };
        let count = write_stream(&stream, &mut writer).map_err(failed)?;
        format!(
            "{}  {count} bubbles in {} s",
            path.display(),
            request.seconds
        )
    };
    writer.flush().map_err(failed)?;
    Ok(if path == Path::new("-") {
        String::new()
    } else {
        line
    })
}
