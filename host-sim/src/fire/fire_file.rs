//! Fires as TOML: what is baked into a texture.
//!
//! ```toml
//! title = "Campfire"
//!
//! [turbulence]              # the flow in one source volume (VS §5.1)
//! width = 0.1               # m
//! cells = [24, 24, 36]      # along x, y and up, the way of the flow
//! perturbation = 0.3        # rms of each component of what flows in, as a part of the speed
//! eddy = 0.04               # size of the eddies that flow in, m
//! confinement = 0.1         # vorticity confinement, as a part of the speed
//! viscosity = 1.2e-4        # m²/s; hot air
//!
//! [texture]
//! speeds = [0.5, 1, 2]      # a row each, m/s
//! receivers = [[1, 0, 1]]   # a variant each: which way it lies
//! seconds = 4               # of each loop
//! bits = 8                  # of a sample: 8 or 16
//! seed = 1                  # the same seed is the same sound
//! ```

use std::fmt::Display;
use std::ops::RangeInclusive;

use anyhow::{Result, anyhow};
use freshet::texture::ROWS;
use serde::Deserialize;
use toml::Spanned;

use super::grid::{Ends, Grid};
use crate::scene_file::Reader;

/// Cells along an axis.
const CELLS: RangeInclusive<usize> = 8..=256;
/// Most receivers.
const RECEIVERS: usize = 32;

/// What a fire is baked from. SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Fire {
    /// The name for people.
    pub title: String,
    /// Width of the source volume, m.
    pub width: f64,
    /// Cells along x, y and the flow.
    pub cells: [usize; 3],
    /// Rms of each component of what flows in, as a part of the speed.
    pub perturbation: f64,
    /// Size of the eddies that flow in, m.
    pub eddy: f64,
    /// Vorticity confinement ε, as a part of the speed.
    pub confinement: f64,
    /// Kinematic viscosity, m²/s.
    pub viscosity: f64,
    /// Speed of each row, m/s, slowest first.
    pub speeds: Vec<f64>,
    /// Direction of each receiver.
    pub receivers: Vec<[f64; 3]>,
    /// Period of the loops, s.
    pub seconds: f64,
    /// Bits of a sample: 8 or 16.
    pub bits: u8,
    /// Of what flows in.
    pub seed: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    title: String,
    turbulence: RawTurbulence,
    texture: RawTexture,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTurbulence {
    width: Spanned<f64>,
    cells: Spanned<[usize; 3]>,
    perturbation: Spanned<f64>,
    eddy: Spanned<f64>,
    confinement: Spanned<f64>,
    viscosity: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTexture {
    speeds: Spanned<Vec<f64>>,
    receivers: Spanned<Vec<[f64; 3]>>,
    seconds: Spanned<f64>,
    bits: Spanned<u8>,
    seed: u64,
}

impl Fire {
    /// Reads a fire from `text`; `name` is for messages.
    ///
    /// # Errors
    /// The place, the field and what was expected there.
    pub fn parse(name: &str, text: &str) -> Result<Self> {
        let reader = Reader { name, text };
        let raw: Raw = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            reader.error(at, error.message())
        })?;
        let (flow, texture) = (&raw.turbulence, &raw.texture);
        let wrong = |at: usize, field: &str, found: &dyn Display, expected: &str| {
            reader.error(at, format!("{field} = {found}: expected {expected}"))
        };
        let number = |field: &str, value: &Spanned<f64>, low: f64, high: f64, unit: &str| {
            let x = *value.get_ref();
            if (low..=high).contains(&x) {
                return Ok(x);
            }
            let expected = format!("a number from {low} to {high}{unit}");
            Err(wrong(value.span().start, field, &x, &expected))
        };
        let width = number("turbulence.width", &flow.width, 1e-3, 10.0, " m")?;
        let cells = *flow.cells.get_ref();
        if cells.iter().any(|n| !CELLS.contains(n)) {
            let expected = format!(
                "three whole numbers from {} to {}",
                CELLS.start(),
                CELLS.end()
            );
            let found = format!("{cells:?}");
            let at = flow.cells.span().start;
            return Err(wrong(at, "turbulence.cells", &found, &expected));
        }
        let speeds = texture.speeds.get_ref();
        let rising = speeds.windows(2).all(|pair| pair[0] < pair[1]);
        let inside = speeds.iter().all(|u| (0.01..=100.0).contains(u));
        if speeds.is_empty() || speeds.len() > ROWS || !rising || !inside {
            let expected =
                format!("1 to {ROWS} speeds from 0.01 to 100 m/s, each above the one before");
            let at = texture.speeds.span().start;
            return Err(wrong(
                at,
                "texture.speeds",
                &format!("{speeds:?}"),
                &expected,
            ));
        }
        let receivers = texture.receivers.get_ref();
        let somewhere = |way: &[f64; 3]| {
            let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
            (1e-6..=1e6).contains(&length)
        };
        if !(1..=RECEIVERS).contains(&receivers.len()) || !receivers.iter().all(somewhere) {
            let expected = format!("1 to {RECEIVERS} directions [x, y, z]");
            let at = texture.receivers.span().start;
            return Err(wrong(
                at,
                "texture.receivers",
                &format!("{receivers:?}"),
                &expected,
            ));
        }
        let bits = *texture.bits.get_ref();
        if bits != 8 && bits != 16 {
            return Err(wrong(
                texture.bits.span().start,
                "texture.bits",
                &bits,
                "8 or 16",
            ));
        }
        let fire = Self {
            title: raw.title,
            width,
            cells,
            perturbation: number("turbulence.perturbation", &flow.perturbation, 0.0, 0.5, "")?,
            eddy: number("turbulence.eddy", &flow.eddy, width / 100.0, width, " m")?,
            confinement: number("turbulence.confinement", &flow.confinement, 0.0, 1.0, "")?,
            viscosity: number("turbulence.viscosity", &flow.viscosity, 0.0, 1.0, " m²/s")?,
            speeds: speeds.clone(),
            receivers: receivers.clone(),
            seconds: number("texture.seconds", &texture.seconds, 0.1, 60.0, " s")?,
            bits,
            seed: texture.seed,
        };
        // An explicit step of diffusion must not overshoot.
        let most = fire.grid().h * fire.speeds[0] / 4.0;
        if fire.viscosity > most {
            let expected = format!("at most {most:.2e} m²/s, by the cells and the least speed");
            let at = flow.viscosity.span().start;
            return Err(wrong(
                at,
                "turbulence.viscosity",
                &fire.viscosity,
                &expected,
            ));
        }
        let longest = fire
            .speeds
            .iter()
            .map(|u| super::row::Plan::new(&fire, *u).samples);
        if longest
            .max()
            .is_none_or(|n| n > freshet::texture::SAMPLES / 16)
        {
            return Err(anyhow!(
                "{name}: such loops are too long; make seconds or cells fewer"
            ));
        }
        Ok(fire)
    }

    /// The grid of its source volume.
    pub fn grid(&self) -> Grid {
        Grid {
            cells: self.cells,
            h: self.width / self.cells[0] as f64,
            ends: Ends::Open,
        }
    }
}
