//! Pictures: a vessel cut open, and figures that fall or rise over decades.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use super::mesh::{Part, images, reflect};
use super::point::{Point, cross, dot, norm, scale, sub};
use super::shape::Closed;
use crate::spectrogram::{FONT, check_name, use_font};

const INK: RGBColor = RGBColor(38, 42, 50);
const FAINT: RGBColor = RGBColor(224, 227, 232);

fn cannot_write(path: &Path) -> anyhow::Error {
    anyhow!(
        "cannot write the picture {} (does the folder exist, and is there room?)",
        path.display()
    )
}

/// The half behind y = 0, seen from the front and above: free surface blue, wet walls green, dry ones grey.
///
/// # Errors
/// A name that does not end in `.png`; a path that cannot be written.
pub fn vessel(path: &Path, title: &str, facts: &str, closed: &Closed) -> Result<()> {
    check_name(path)?;
    use_font()?;
    draw_vessel(path, title, facts, closed).map_err(|_| cannot_write(path))
}

fn draw_vessel(path: &Path, title: &str, facts: &str, closed: &Closed) -> Result<()> {
    const SIZE: (i32, i32) = (1000, 800);
    // Towards the eye, and the picture's own axes.
    let eye = unit([-0.35, -1.0, 0.55]);
    let right = unit(cross([0.0, 0.0, 1.0], eye));
    let up = cross(eye, right);
    let light = unit([-0.5, -0.6, 0.9]);
    let mut faces: Vec<([Point; 3], Part)> = Vec::new();
    for signs in images(closed.mesh.mirrors) {
        for (corners, part) in &closed.mesh.triangles {
            let corners = corners.map(|i| reflect(closed.mesh.points[i], signs));
            if corners.iter().map(|corner| corner[1]).sum::<f64>() >= 0.0 {
                faces.push((corners, *part));
            }
        }
    }
    let flat = |p: Point| (dot(p, right), dot(p, up));
    let all = || faces.iter().flat_map(|face| face.0).map(flat);
    let low = all().fold((f64::MAX, f64::MAX), |a, b| (a.0.min(b.0), a.1.min(b.1)));
    let high = all().fold((f64::MIN, f64::MIN), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    let zoom = f64::min(900.0 / (high.0 - low.0), 640.0 / (high.1 - low.1));
    let middle = (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1));
    let place = |p: Point| {
        let (x, y) = flat(p);
        (
            SIZE.0 / 2 + (zoom * (x - middle.0)).round() as i32,
            SIZE.1 / 2 + 30 - (zoom * (y - middle.1)).round() as i32,
        )
    };
    // The farthest first.
    let depth = |face: &[Point; 3]| face.iter().map(|p| dot(*p, eye)).sum::<f64>();
    faces.sort_by(|a, b| depth(&a.0).total_cmp(&depth(&b.0)));

    let root = BitMapBackend::new(path, (SIZE.0 as u32, SIZE.1 as u32)).into_drawing_area();
    root.fill(&WHITE)?;
    for (corners, part) in &faces {
        let normal = unit(cross(
            sub(corners[1], corners[0]),
            sub(corners[2], corners[0]),
        ));
        let shade = 0.55 + 0.45 * dot(normal, light).abs();
        let (colour, cover) = match part {
            Part::Free => ([90.0, 160.0, 235.0], 0.75),
            Part::Wet => ([120.0, 190.0, 170.0], 0.9),
            Part::Solid => ([150.0, 170.0, 190.0], 0.9),
            Part::Dry => ([205.0, 205.0, 200.0], 0.85),
        };
        let [r, g, b] = colour.map(|part: f64| (part * shade) as u8);
        let outline: Vec<(i32, i32)> = corners.iter().map(|corner| place(*corner)).collect();
        let fill = RGBColor(r, g, b).mix(cover);
        root.draw(&Polygon::new(outline.clone(), fill.filled()))?;
        let closed = [&outline[..], &outline[..1]].concat();
        root.draw(&PathElement::new(closed, INK.mix(0.35).stroke_width(1)))?;
    }
    root.draw_text(title, &(FONT, 26).into_font().color(&INK), (40, 24))?;
    root.draw_text(facts, &(FONT, 18).into_font().color(&INK), (40, 58))?;
    root.present()?;
    Ok(())
}

fn unit(a: Point) -> Point {
    scale(a, 1.0 / norm(a))
}

/// A curve of a picture: its name, and points.
pub struct Curve {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

/// Curves over two logarithmic axes.
///
/// # Errors
/// As [`vessel`].
pub fn decades(path: &Path, title: &str, axes: [&str; 2], curves: &[Curve]) -> Result<()> {
    check_name(path)?;
    use_font()?;
    draw_decades(path, title, axes, curves).map_err(|_| cannot_write(path))
}

fn draw_decades(path: &Path, title: &str, axes: [&str; 2], curves: &[Curve]) -> Result<()> {
    let points = || curves.iter().flat_map(|curve| curve.points.iter().copied());
    let low = points().fold((f64::MAX, f64::MAX), |a, b| (a.0.min(b.0), a.1.min(b.1)));
    let high = points().fold((f64::MIN, f64::MIN), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    let root = BitMapBackend::new(path, (1000, 700)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, (FONT, 26).into_font().color(&INK))
        .margin(20)
        .x_label_area_size(50)
        .y_label_area_size(80)
        .build_cartesian_2d(
            (low.0 / 1.2..high.0 * 1.2).log_scale(),
            (low.1 / 1.5..high.1 * 1.5).log_scale(),
        )?;
    chart
        .configure_mesh()
        .x_desc(axes[0])
        .y_desc(axes[1])
        .label_style((FONT, 17).into_font().color(&INK))
        .light_line_style(FAINT.mix(0.5))
        .bold_line_style(FAINT)
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .x_labels(6)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .draw()?;
    let colours = [
        RGBColor(74, 60, 132),
        RGBColor(205, 64, 113),
        RGBColor(30, 140, 120),
        RGBColor(230, 140, 40),
        RGBColor(90, 160, 235),
        RGBColor(120, 120, 120),
    ];
    for (curve, colour) in curves.iter().zip(colours.into_iter().cycle()) {
        let line = LineSeries::new(curve.points.clone(), colour.stroke_width(2)).point_size(4);
        chart
            .draw_series(line)?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(3)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .label_font((FONT, 17).into_font().color(&INK))
        .background_style(WHITE.mix(0.85))
        .border_style(FAINT)
        .draw()?;
    root.present()?;
    Ok(())
}
