//! `freshet modes`: the pitches of a cloud, as a table, JSON or a picture.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow};
use clap::Args;
use plotters::prelude::*;
use serde_json::json;

use super::coupling::{Coupling, Kernel, Place};
use super::modes::{Mode, checked_matrix, frequencies, modes};
use super::reduced::Reduced;
use super::static_cloud;
use super::step::Tone;
use crate::spectrogram;
use crate::wav::write_error;

/// Modes in the picture.
const SHOWN: usize = 12;
/// Rows of the table.
const ROWS: usize = 40;

/// What `freshet modes` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A cloud (.csv): x_m,y_m,z_m,radius_m and perhaps depth_m
    pub cloud: PathBuf,
    /// Softness of the coupling between near bubbles
    #[arg(
        long,
        value_name = "E",
        default_value_t = 2.0,
        allow_hyphen_values = true
    )]
    pub epsilon: f64,
    /// Form of the coupling
    #[arg(long, value_enum, default_value = "definite")]
    pub kernel: Kernel,
    /// Subtract each bubble's image in the surface
    #[arg(long)]
    pub dipole: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Draw who pulsates in each mode
    #[arg(long, value_name = "PNG")]
    pub plot: Option<PathBuf>,
}

/// The modes, as text.
///
/// # Errors
/// A file that cannot be read or written; a matrix that is not positive definite, with the reason.
pub fn run(request: &Request) -> Result<String> {
    let coupling = Coupling {
        kernel: request.kernel,
        epsilon: request.epsilon,
        dipole: request.dipole,
    }
    .checked()?;
    if let Some(path) = &request.plot {
        spectrogram::check_name(path)?;
    }
    let places = static_cloud::read(&request.cloud)?;
    let tones: Vec<Tone> = places
        .iter()
        .map(|place| Tone::of_radius(place.radius))
        .collect();
    let radii: Vec<f64> = places.iter().map(|place| place.radius).collect();
    let refused = |error: anyhow::Error| anyhow!("{}: {error}", request.cloud.display());
    let mass = checked_matrix(&coupling, &places).map_err(refused)?;
    let found = modes(&mass, &radii, &tones).map_err(refused)?;
    let reduced = Reduced::matrix(&coupling, &places)
        .and_then(|mass| modes(&mass, &radii, &tones).ok())
        .map(|modes| modes.iter().map(|mode| mode.hertz).collect::<Vec<_>>());
    if let Some(path) = &request.plot {
        draw(path, &request.cloud, &places, &found)?;
    }
    if request.json {
        let alone: Vec<f64> = tones
            .iter()
            .map(|tone| tone.omega_d() / std::f64::consts::TAU)
            .collect();
        let json = json!({
            "bubbles": places.len(),
            "epsilon": request.epsilon,
            "kernel": match request.kernel { Kernel::Definite => "definite", Kernel::Cb => "cb" },
            "dipole": request.dipole,
            "frequencies_hz": found.iter().map(|mode| mode.hertz).collect::<Vec<_>>(),
            "undamped_frequencies_hz": frequencies(&mass, &tones)?,
            "decays_per_s": found.iter().map(|mode| mode.decay).collect::<Vec<_>>(),
            "reduced_frequencies_hz": reduced,
            "alone_frequencies_hz": alone,
            "pulsations": found.iter().map(|mode| &mode.pulsation).collect::<Vec<_>>(),
        });
        return Ok(serde_json::to_string_pretty(&json)?);
    }
    Ok(table(&found, reduced.as_deref()))
}

fn table(found: &[Mode], reduced: Option<&[f64]>) -> String {
    let mut lines = vec![format!(
        "{:>5} {:>12} {:>12} {:>12}  {}",
        "mode", "Hz", "reduced Hz", "decay 1/s", "bubbles at more than half"
    )];
    for (i, mode) in found.iter().enumerate().take(ROWS) {
        let many = mode.pulsation.iter().filter(|v| v.abs() > 0.5).count();
        let opposed = mode.pulsation.iter().filter(|v| **v < -0.5).count();
        let reduced = reduced.map_or("-".into(), |all| format!("{:.2}", all[i]));
        let note = if opposed > 0 {
            format!("{many}, {opposed} of them opposed")
        } else {
            many.to_string()
        };
        lines.push(format!(
            "{:>5} {:>12.2} {:>12} {:>12.2}  {note}",
            i + 1,
            mode.hertz,
            reduced,
            mode.decay
        ));
    }
    if found.len() > ROWS {
        lines.push(format!("… {} more (--json shows all)", found.len() - ROWS));
    }
    lines.join("\n")
}

/// The lowest modes, each as the cloud seen from the front, red where bubbles swell and blue where they shrink.
fn draw(path: &Path, cloud: &Path, places: &[Place], found: &[Mode]) -> Result<()> {
    std::fs::File::create(path).map_err(|error| write_error(path.display(), &error))?;
    let failed = |_| {
        anyhow!(
            "cannot write the picture {} (is the disk full?)",
            path.display()
        )
    };
    let shown = found.len().min(SHOWN);
    let columns = shown.clamp(1, 4);
    let rows = shown.div_ceil(columns);
    spectrogram::use_font()?;
    let root = BitMapBackend::new(path, (350 * columns as u32, 60 + 370 * rows as u32))
        .into_drawing_area();
    let paper = RGBColor(255, 255, 255);
    let ink = RGBColor(38, 42, 50);
    root.fill(&paper).map_err(failed)?;
    let title = cloud.file_stem().unwrap_or_default().to_string_lossy();
    let style = |size: i32| TextStyle::from((spectrogram::FONT, size).into_font()).color(&ink);
    root.draw_text(
        &format!(
            "{title}: {} bubbles, lowest modes (red swells as blue shrinks)",
            places.len()
        ),
        &style(24),
        (20, 18),
    )
    .map_err(failed)?;
    let extent = |axis: usize| {
        let along = || places.iter().map(|place| place.at[axis]);
        let reach = places.iter().map(|place| place.radius).fold(0.0, f64::max);
        (
            along().fold(f64::INFINITY, f64::min) - reach,
            along().fold(f64::NEG_INFINITY, f64::max) + reach,
        )
    };
    let (x, y) = (extent(0), extent(1));
    let scale = 300.0 / (x.1 - x.0).max(y.1 - y.0).max(1e-9);
    // Far ones first.
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| places[a].at[2].total_cmp(&places[b].at[2]));
    for (n, mode) in found.iter().take(shown).enumerate() {
        let left = 350 * (n % columns) as i32;
        let top = 60 + 370 * (n / columns) as i32;
        root.draw_text(
            &format!("{}: {:.1} Hz", n + 1, mode.hertz),
            &style(20),
            (left + 20, top),
        )
        .map_err(failed)?;
        for &i in &order {
            let place = &places[i];
            let px = f64::from(left) + 175.0 + (place.at[0] - (x.0 + x.1) / 2.0) * scale;
            let py = f64::from(top) + 190.0 - (place.at[1] - (y.0 + y.1) / 2.0) * scale;
            let size = (place.radius * scale).max(2.0);
            let v = mode.pulsation[i];
            let mix = |low: f64, high: f64| (low + (high - low) * v.abs().sqrt()) as u8;
            let colour = if v >= 0.0 {
                RGBColor(mix(236.0, 200.0), mix(236.0, 24.0), mix(240.0, 30.0))
            } else {
                RGBColor(mix(236.0, 20.0), mix(236.0, 70.0), mix(240.0, 200.0))
            };
            let at = (px as i32, py as i32);
            root.draw(&Circle::new(at, size as i32, colour.filled()))
                .map_err(failed)?;
            root.draw(&Circle::new(at, size as i32, ink.mix(0.35)))
                .map_err(failed)?;
        }
    }
    root.present().map_err(failed)
}
