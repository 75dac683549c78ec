//! Pictures of a fire: its vorticity in a slice, its energy by size of eddies, the sound of its rows.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use super::fire_file::Fire;
use super::row::Row;
use super::texture::Loops;
use crate::spectrogram::{self, Spectrogram};
use crate::wav::write_error;

const INK: RGBColor = RGBColor(38, 42, 50);
const PAPER: RGBColor = RGBColor(255, 255, 255);
/// Pixels a cell.
const CELL: i32 = 18;

type Area<'a> = DrawingArea<BitMapBackend<'a>, plotters::coord::Shift>;

fn paper<'a>(path: &'a Path, size: (u32, u32), title: &str) -> Result<Area<'a>> {
    std::fs::File::create(path).map_err(|error| write_error(path.display(), &error))?;
    spectrogram::use_font()?;
    let root = BitMapBackend::new(path, size).into_drawing_area();
    root.fill(&PAPER).map_err(|_| failed(path))?;
    root.draw_text(title, &style(24), (20, 16))
        .map_err(|_| failed(path))?;
    Ok(root)
}

fn style(size: i32) -> TextStyle<'static> {
    TextStyle::from((spectrogram::FONT, size).into_font()).color(&INK)
}

fn failed(path: &Path) -> anyhow::Error {
    anyhow!(
        "cannot write the picture {} (is the disk full?)",
        path.display()
    )
}

/// Vorticity across an upright slice through the middle: red turns one way, blue the other.
pub fn slice(path: &Path, fire: &Fire, row: Option<&Row>) -> Result<()> {
    let Some(row) = row else { return Ok(()) };
    let [nx, ny, nz] = fire.cells;
    let title = format!(
        "{}: vorticity across a slice of {:.0} × {:.0} mm, inflow below at {} m/s",
        fire.title,
        1e3 * fire.width,
        1e3 * fire.grid().h * nz as f64,
        fire.speeds.last().copied().unwrap_or_default()
    );
    let (width, height) = (CELL * nx as i32, CELL * nz as i32);
    let left = (760 - width).max(40) / 2;
    let size = ((width + 2 * left) as u32, (height + 80) as u32);
    let root = paper(path, size, &title)?;
    let at = |i: usize, k: usize| row.flow.omega[1][(k * ny + ny / 2) * nx + i];
    let all = (0..nz).flat_map(|k| (0..nx).map(move |i| at(i, k).abs()));
    let most = all.fold(1e-9, f64::max);
    for y in 0..height / 3 {
        for x in 0..width / 3 {
            // Between the middles of cells, so that eddies and not cells are seen.
            let place = |p: i32| f64::from(3 * p) / f64::from(CELL) - 0.5;
            let (x_cell, z_cell) = (place(x), (nz as f64 - 1.0) - place(y));
            let split = |p: f64, n: usize| {
                let p = p.clamp(0.0, n as f64 - 1.0);
                let low = (p as usize).min(n - 2);
                (low, p - low as f64)
            };
            let ((i, a), (k, b)) = (split(x_cell, nx), split(z_cell, nz));
            let low = at(i, k) * (1.0 - a) + at(i + 1, k) * a;
            let high = at(i, k + 1) * (1.0 - a) + at(i + 1, k + 1) * a;
            let w = (low * (1.0 - b) + high * b) / most;
            let fade = w.abs().min(1.0).powf(0.7);
            let mix = |end: u8| (245.0 + (f64::from(end) - 245.0) * fade) as u8;
            let [r, g, b] = if w > 0.0 {
                [178, 24, 43]
            } else {
                [33, 70, 172]
            };
            let corner = (left + 3 * x, 60 + 3 * y);
            let colour = RGBColor(mix(r), mix(g), mix(b));
            let cell = Rectangle::new([corner, (corner.0 + 3, corner.1 + 3)], colour.filled());
            root.draw(&cell).map_err(|_| failed(path))?;
        }
    }
    root.present().map_err(|_| failed(path))
}

/// Energy in shells of wave numbers across the flow, each row in units of its speed squared, beside k^−5/3.
pub fn energy(path: &Path, fire: &Fire, rows: &[Row]) -> Result<()> {
    let title = format!(
        "{}: energy by wave number across the flow, half way up, over speed²",
        fire.title
    );
    let root = paper(path, (1000, 640), &title)?;
    let draw = || -> Result<(), Box<dyn std::error::Error + '_>> {
        let spectra: Vec<Vec<f64>> = rows
            .iter()
            .zip(&fire.speeds)
            .map(|(row, u)| {
                let shells = row.progress.spectrum.shells();
                shells.iter().map(|e| (e / (u * u)).max(1e-12)).collect()
            })
            .collect();
        let all = || spectra.iter().flatten().copied();
        let (low, high) = (all().fold(1.0, f64::min), all().fold(1e-12, f64::max));
        let shells = spectra.first().map_or(2, Vec::len).max(2);
        let mut chart = ChartBuilder::on(&root)
            .margin_top(60)
            .margin_right(30)
            .x_label_area_size(60)
            .y_label_area_size(90)
            .build_cartesian_2d(
                (0.9..shells as f64 * 1.1).log_scale(),
                (low * 0.5..high * 2.0).log_scale(),
            )?;
        chart
            .configure_mesh()
            .x_desc("periods across the box")
            .y_desc("energy / speed²")
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:.0e}"))
            .label_style(style(20))
            .axis_desc_style(style(20))
            .light_line_style(INK.mix(0.06))
            .bold_line_style(INK.mix(0.15))
            .draw()?;
        for (n, spectrum) in spectra.iter().enumerate() {
            let way = n as f64 / (spectra.len().max(2) - 1) as f64;
            let colour = RGBColor((40.0 + 190.0 * way) as u8, 90, (200.0 - 170.0 * way) as u8);
            let points = spectrum.iter().enumerate();
            let points = points.map(|(k, e)| ((k + 1) as f64, *e));
            chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
        }
        let guide = [2.0, shells as f64 * 0.8].map(|k: f64| (k, high * k.powf(-5.0 / 3.0) * 2.0));
        chart.draw_series(LineSeries::new(guide, INK.stroke_width(2)))?;
        root.draw_text(
            "black: k^(-5/3); blue to red: slow to fast",
            &style(20),
            (620, 70),
        )?;
        Ok(root.present()?)
    };
    draw().map_err(|_| failed(path))
}

/// The first variant of every row one after another, slowest first, each as loud as the others.
pub fn sound(path: &Path, fire: &Fire, loops: &[Loops]) -> Result<()> {
    let rate = loops.last().map_or(0, |row| row.sounds[0].len());
    let rate = (rate as f64 / fire.seconds).ceil();
    let count = (rate * fire.seconds) as usize;
    let mut picture = Spectrogram::new(rate as u32, (count * loops.len()) as u64);
    for row in loops {
        let sound = &row.sounds[0];
        let peak = sound.iter().fold(1e-30_f64, |peak, x| peak.max(x.abs()));
        for x in stretched(sound, count) {
            let x = (x / peak) as f32;
            picture.push(x, x);
        }
    }
    let speeds: Vec<String> = fire.speeds.iter().map(|u| format!("{u}")).collect();
    let title = format!(
        "{}: rows at {} m/s, each as loud as the others",
        fire.title,
        speeds.join(", ")
    );
    picture.write_png(path, &title)
}

/// A loop with more samples, exactly (by its Fourier series).
fn stretched(sound: &[f64], count: usize) -> Vec<f64> {
    let mut planner = realfft::RealFftPlanner::new();
    let forward = planner.plan_fft_forward(sound.len());
    let back = planner.plan_fft_inverse(count);
    let (mut spectrum, mut wide) = (forward.make_output_vec(), back.make_input_vec());
    let mut out = back.make_output_vec();
    // PANIC: the lengths are the plans' own; the ends of the spectrum are real.
    forward
        .process(&mut sound.to_vec(), &mut spectrum)
        .expect("lengths of the plan");
    let last = spectrum.len().min(wide.len()) - 1;
    wide[1..last].copy_from_slice(&spectrum[1..last]);
    back.process(&mut wide, &mut out)
        .expect("lengths of the plan");
    out.iter().map(|x| x / sound.len() as f64).collect()
}
