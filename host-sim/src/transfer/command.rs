//! `freshet transfer` and `freshet vessel`.

use std::path::PathBuf;

use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};
use faer::c64;
use serde_json::json;

use super::DENSITY_RATIO;
use super::mesh::show;
use super::multipoles::Multipoles;
use super::picture;
use super::point::Point;
use super::shape::Shape;
use super::solver::{Residual, Solver, Transfer};
use super::vessel::{Form, Vessel};

/// What `freshet transfer` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A vessel file
    pub vessel: PathBuf,
    /// The bubble, inside the liquid, m
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Point,
    /// The ear, in the air, m
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub ear: Point,
    /// Hz
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    pub frequency: f64,
    /// From the ear to every bubble, or from the bubble to every ear
    #[arg(long, value_enum, default_value_t = Method::Adjoint)]
    pub method: Method,
    /// Boundary elements, or HF's multipoles in the liquid
    #[arg(long, value_enum, default_value_t = Basis::Elements)]
    pub basis: Basis,
    /// Multipoles in the water and for the air (HF table 1: 30 to 60 and 50 to 120)
    #[arg(long, value_name = "WATER,AIR", value_parser = counts, default_value = "60,120")]
    pub points: [usize; 2],
    /// Edge of the triangles, m [default: the file's]
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    pub edge: Option<f64>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Which end a solve starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Bubble by bubble (HF §5).
    Direct,
    /// Every bubble at once (physics.md §5).
    Adjoint,
}

/// What the field is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Basis {
    /// Linear on triangles.
    Elements,
    /// Monopoles, dipoles and quadrupoles about points in the liquid (HF §5).
    Multipoles,
}

/// What `freshet vessel` is asked.
#[derive(Clone, Debug, Args)]
pub struct VesselRequest {
    /// A vessel file
    pub vessel: PathBuf,
    /// Edge of the triangles, m [default: the file's]
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    pub edge: Option<f64>,
    /// Draw the mesh, cut open, to this PNG
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// `x,y,z` in metres.
fn point(text: &str) -> Result<Point, String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>())
        .collect::<Result<_, _>>()
        .map_err(|_| "expected three numbers in metres, like 0,0.01,0.02".to_owned())?;
    match *parts.as_slice() {
        [x, y, z] if parts.iter().all(|x| x.is_finite()) => Ok([x, y, z]),
        _ => Err("expected three numbers in metres, like 0,0.01,0.02".to_owned()),
    }
}

fn counts(text: &str) -> Result<[usize; 2], String> {
    let wanted = || "expected two counts from 1 to 400, like 60,120".to_owned();
    let (water, air) = text.split_once(',').ok_or_else(wanted)?;
    let parse = |part: &str| match part.trim().parse::<usize>() {
        Ok(count) if (1..=400).contains(&count) => Ok(count),
        _ => Err(wanted()),
    };
    Ok([parse(water)?, parse(air)?])
}

fn open(path: &std::path::Path, edge: Option<f64>) -> Result<(Vessel, Shape)> {
    let mut vessel = Vessel::open(path)?;
    if let Some(edge) = edge {
        if !(1e-4..=100.0).contains(&edge) {
            bail!("--edge {edge}: expected from 0.0001 to 100 (metres)");
        }
        match vessel.form {
            Form::Mesh(_) => bail!("--edge: a mesh keeps the edges it has"),
            _ => vessel.edge = Some(edge),
        }
    }
    let shape = vessel
        .shape()
        .map_err(|error| anyhow!("{}: {error:#}", path.display()))?;
    Ok((vessel, shape))
}

/// The answer of `freshet transfer`.
///
/// # Errors
/// A vessel that cannot be read; a frequency, bubble or ear out of place.
pub fn transfer(request: &Request) -> Result<String> {
    let (vessel, shape) = open(&request.vessel, request.edge)?;
    shape.check_frequency(request.frequency)?;
    shape.check_bubble(request.at)?;
    shape.check_ear(request.ear)?;
    let found = solve(&shape, request)?;
    let Transfer {
        ratio,
        residual: Residual { water, air },
    } = found;
    if request.json {
        let answer = json!({
            "vessel": request.vessel.display().to_string(),
            "title": vessel.title,
            "at": request.at,
            "ear": request.ear,
            "frequency": request.frequency,
            "method": request.method.to_possible_value().map(|v| v.get_name().to_owned()),
            "basis": request.basis.to_possible_value().map(|v| v.get_name().to_owned()),
            "re": ratio.re,
            "im": ratio.im,
            "magnitude": ratio.norm(),
            "phase": ratio.arg(),
            "unit": "1/m",
            "density_ratio": DENSITY_RATIO,
            "residual": { "water": water, "air": air },
        });
        return Ok(serde_json::to_string_pretty(&answer)?);
    }
    Ok([
        format!("P/S_b          {} 1/m", complex(ratio)),
        format!("magnitude      {:.6e} 1/m", ratio.norm()),
        format!("phase          {:.4} rad", ratio.arg()),
        format!("density ratio  {DENSITY_RATIO} (times this it is the pressure in air)"),
        format!("residual       {water:.2e} in water, {air:.2e} in air"),
    ]
    .join("\n"))
}

fn solve(shape: &Shape, request: &Request) -> Result<Transfer> {
    let (bubble, ear) = (request.at, request.ear);
    if request.basis == Basis::Multipoles {
        let [water, air] = request.points;
        let poles = Multipoles::new(shape, request.frequency, water, air)?;
        return match request.method {
            Method::Direct => poles.direct(bubble, ear),
            Method::Adjoint => poles.adjoint(bubble, ear),
        };
    }
    let solver = Solver::new(shape, request.frequency)?;
    Ok(match request.method {
        Method::Adjoint => {
            let field = solver.hear(ear)?;
            Transfer {
                ratio: field.at(&[bubble])?[0],
                residual: field.residual(bubble),
            }
        }
        Method::Direct => {
            let sound = solver.sound(bubble)?;
            Transfer {
                ratio: sound.at(&[ear])?[0],
                residual: sound.residual(ear),
            }
        }
    })
}

fn complex(z: c64) -> String {
    let sign = if z.im < 0.0 { '-' } else { '+' };
    format!("{:.6e} {sign} {:.6e}i", z.re, z.im.abs())
}

/// The answer of `freshet vessel`.
///
/// # Errors
/// A vessel that cannot be read or meshed; a picture that cannot be written.
pub fn vessel(request: &VesselRequest) -> Result<String> {
    if let Some(path) = &request.plot {
        crate::spectrogram::check_name(path)?;
    }
    let (vessel, shape) = open(&request.vessel, request.edge)?;
    let Shape::Closed(closed) = &shape else {
        if request.plot.is_some() {
            bail!("a pool has no end and no triangles: there is nothing to draw");
        }
        return Ok(if request.json {
            let answer = json!({ "title": vessel.title, "shape": "pool" });
            serde_json::to_string_pretty(&answer)?
        } else {
            format!(
                "{}: water below z = 0, without end; nothing to mesh",
                vessel.title
            )
        });
    };
    let (low, high) = closed.water.bounds();
    let (panels, nodes) = closed.water.count();
    let (air_panels, air_nodes) = closed.air.count();
    let litres = 1e3 * closed.mesh.volume();
    let free = 1e4 * closed.water.area(true);
    let edge = 1e3 * closed.water.edge().max(closed.air.edge());
    let planes = closed.mesh.mirrors.iter().filter(|mirror| **mirror).count();
    if let Some(path) = &request.plot {
        let facts = format!(
            "{litres:.3} l  ·  {} triangles  ·  up to {:.0} Hz",
            panels.max(air_panels),
            shape.highest()
        );
        picture::vessel(path, &vessel.title, &facts, closed)?;
    }
    if request.json {
        let answer = json!({
            "title": vessel.title,
            "volume": closed.mesh.volume(),
            "free_area": closed.water.area(true),
            "low": low,
            "high": high,
            "longest_edge": edge * 1e-3,
            "highest_frequency": shape.highest(),
            "water": { "triangles": panels, "nodes": nodes },
            "air": { "triangles": air_panels, "nodes": air_nodes },
            "mirror_planes": planes,
        });
        return Ok(serde_json::to_string_pretty(&answer)?);
    }
    Ok([
        vessel.title.clone(),
        format!(
            "liquid     {litres:.4} l between {} and {} m, free surface {free:.2} cm²",
            show(low),
            show(high)
        ),
        format!("water      {panels} triangles, {nodes} nodes: watertight, oriented"),
        format!("air        {air_panels} triangles, {air_nodes} nodes: watertight, oriented"),
        format!("planes     {planes} mirror planes"),
        format!(
            "edges      {edge:.2} mm at most: resolves up to {:.0} Hz",
            shape.highest()
        ),
    ]
    .join("\n"))
}
