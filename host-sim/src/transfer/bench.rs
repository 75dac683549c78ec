//! `freshet bench --transfer`: residuals and speed of the transfer solvers, beside HF's way.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::Point;
use super::multipoles::{FUNCTIONS, Multipoles, samples, scatter};
use super::picture::{Curve, decades};
use super::shape::{Closed, Sample, Shape};
use super::solver::{Residual, Solver};
use super::vessel::Vessel;

/// HF's table 1: most points for the water and for the air.
const POINTS: [usize; 2] = [60, 120];
const EAR: Point = [0.3, 0.2, 0.4];

const DROP: &str = include_str!("../../../vessels/drop.toml");
const BLOCK: &str = include_str!("../../../vessels/pouring.toml");
const GLASS: &str = include_str!("../../../vessels/glass.toml");
const BOWL: &str = include_str!("../../../vessels/bowl.toml");
const TANK: &str = include_str!("../../../vessels/tank.toml");

/// The figures; pictures of convergence and cost go to the folder.
///
/// # Errors
/// A folder that cannot be written to.
pub fn bench(plots: Option<&Path>) -> Result<String> {
    let bar = ProgressBar::with_draw_target(Some(4), ProgressDrawTarget::stderr());
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {msg}  {elapsed}").expect("the template is valid"),
    );
    let mut text = Vec::new();
    let mut step = |what, figures: fn(Option<&Path>) -> Result<String>| {
        bar.set_message(what);
        text.push(figures(plots)?);
        bar.inc(1);
        anyhow::Ok(())
    };
    step("residuals", residuals)?;
    step("convergence", convergence)?;
    step("cost against samples", cost)?;
    step("speed of a bake", speed)?;
    bar.finish_and_clear();
    Ok(text.join("\n\n"))
}

fn vessel(text: &str) -> Result<Vessel> {
    Vessel::parse("bench", text, Path::new("."))
}

fn closed(shape: &Shape) -> Result<&Closed> {
    match shape {
        Shape::Closed(closed) => Ok(closed),
        Shape::Pool => anyhow::bail!("the bench's vessels are closed"),
    }
}

/// The finest mesh with no more unknowns than HF's points bring.
fn as_many_unknowns(vessel: &mut Vessel) -> Result<Shape> {
    let mut edge = 0.03;
    let mut best = None;
    loop {
        edge *= 0.96;
        vessel.edge = Some(edge);
        let Ok(shape) = vessel.shape() else { continue };
        let found = closed(&shape)?;
        let fits = found.water.count().1 <= FUNCTIONS * POINTS[0]
            && found.air.count().1 <= FUNCTIONS * POINTS[1];
        if !fits {
            return best.context("no mesh is that coarse");
        }
        best = Some(shape);
    }
}

/// Mean residuals of both ways over bubbles and frequencies.
fn residuals(_: Option<&Path>) -> Result<String> {
    const FREQUENCIES: [f64; 3] = [500.0, 1_000.0, 2_000.0];
    let mut lines = vec![
        "Residuals, means over 8 random bubbles at 500, 1000 and 2000 Hz: HF's 60 and 120 points, and elements with no more unknowns, direct and adjoint"
            .to_owned(),
        format!(
            "{:<8} {:>17} {:>17} {:>17}   (water, air)",
            "", "HF", "direct", "adjoint"
        ),
    ];
    for (name, text) in [
        ("drop", DROP),
        ("block", BLOCK),
        ("glass", GLASS),
        ("bowl", BOWL),
        ("tank", TANK),
    ] {
        let mut vessel = vessel(text)?;
        let fine = vessel.shape()?;
        let shape = as_many_unknowns(&mut vessel)?;
        let bubbles = scatter(closed(&fine)?, 8, 7);
        let (mut theirs, mut ours, mut adjoint) = Default::default();
        let share = 1.0 / (bubbles.len() * FREQUENCIES.len()) as f64;
        let add = |sum: &mut Residual, one: Residual| {
            sum.water += share * one.water;
            sum.air += share * one.air;
        };
        for frequency in FREQUENCIES {
            let poles = Multipoles::new(&fine, frequency, POINTS[0], POINTS[1])?;
            let solver = Solver::new(&shape, frequency)?;
            for bubble in &bubbles {
                add(&mut theirs, poles.direct(*bubble, EAR)?.residual);
                add(&mut ours, solver.sound(*bubble)?.residual(EAR));
            }
            let field = solver.hear(EAR)?;
            bubbles
                .iter()
                .for_each(|bubble| add(&mut adjoint, field.residual(*bubble)));
        }
        let pair = |one: Residual| format!("{:.4} {:.4}", one.water, one.air);
        lines.push(format!(
            "{name:<8} {:>17} {:>17} {:>17}",
            pair(theirs),
            pair(ours),
            pair(adjoint)
        ));
    }
    Ok(lines.join("\n"))
}

/// As HF figure 13: residuals against unknowns, in the glass.
fn convergence(plots: Option<&Path>) -> Result<String> {
    const FREQUENCY: f64 = 1_500.0;
    let bubble = [0.01, 0.0, 0.02];
    let mut glass = vessel(GLASS)?;
    let fine = glass.shape()?;
    let found = closed(&fine)?;
    let mut curves = [
        "HF water",
        "HF air",
        "elements, water",
        "elements, air",
        "elements, answer",
    ]
    .map(|name| Curve {
        name: name.to_owned(),
        points: Vec::new(),
    });
    for points in [5, 10, 20, 40, 80, 120] {
        // The placement is random: the mean of three.
        let mut sum = Residual::default();
        for seed in 1..=3 {
            let (inside, outside) = samples(found);
            let centres = scatter(found, points, seed);
            let both = [points, points];
            let poles = Multipoles::on(found, FREQUENCY, inside, outside, &centres, both)?;
            let one = poles.direct(bubble, EAR)?.residual;
            sum.water += one.water / 3.0;
            sum.air += one.air / 3.0;
        }
        let unknowns = (FUNCTIONS * points) as f64;
        curves[0].points.push((unknowns, sum.water));
        curves[1].points.push((unknowns, sum.air));
    }
    let mut answers = Vec::new();
    for edge in [0.016, 0.012, 0.009, 0.0065, 0.0045] {
        glass.edge = Some(edge);
        let shape = glass.shape()?;
        let solver = Solver::new(&shape, FREQUENCY)?;
        let sound = solver.sound(bubble)?;
        let residual = sound.residual(EAR);
        let found = closed(&shape)?;
        let (water, air) = (found.water.count().1 as f64, found.air.count().1 as f64);
        curves[2].points.push((water, residual.water));
        curves[3].points.push((air, residual.air));
        answers.push((air, solver.hear(EAR)?.at(&[bubble])?[0]));
    }
    if let Some((_, finest)) = answers.pop() {
        for (unknowns, answer) in answers {
            let off = (answer - finest).norm() / finest.norm();
            curves[4].points.push((unknowns, off));
        }
    }
    if let Some(folder) = plots {
        decades(
            &folder.join("transfer-convergence.png"),
            "Residuals in a glass at 1500 Hz (as HF figure 13)",
            ["unknowns", "relative"],
            &curves,
        )?;
    }
    let mut lines = vec!["Convergence in the glass at 1500 Hz: (unknowns: residual)".to_owned()];
    for curve in &curves {
        let points: Vec<String> = curve
            .points
            .iter()
            .map(|(x, y)| format!("{x:.0}: {y:.1e}"))
            .collect();
        lines.push(format!("{:<18} {}", curve.name, points.join("  ")));
    }
    Ok(lines.join("\n"))
}

/// HF's fit on more and more samples of one drop: linear in them.
fn cost(plots: Option<&Path>) -> Result<String> {
    const POINTS: [usize; 2] = [20, 40];
    let mut drop = vessel(DROP)?;
    let mut curve = Curve {
        name: "20 and 40 points, one factorisation and bubble".to_owned(),
        points: Vec::new(),
    };
    let mut lines = vec![format!(
        "Cost against surface samples: HF's placement, {} and {} points, one core",
        POINTS[0], POINTS[1]
    )];
    for edge in [0.0082, 0.0046, 0.0026, 0.0015] {
        drop.edge = Some(edge);
        let shape = drop.shape()?;
        let found = closed(&shape)?;
        let centres = scatter(found, POINTS[1], 1);
        let (inside, outside): (Vec<Sample>, Vec<Sample>) = samples(found);
        let count = inside.len() as f64;
        let begun = Instant::now();
        one_core(|| {
            Multipoles::on(found, 2_000.0, inside, outside, &centres, POINTS)?
                .direct([0.0, 0.01, 0.02], EAR)
        })??;
        let seconds = begun.elapsed().as_secs_f64();
        lines.push(format!(
            "{count:>8.0} samples {seconds:>8.3} s {:>8.1} µs a sample",
            1e6 * seconds / count
        ));
        curve.points.push((count, seconds));
    }
    if let Some(folder) = plots {
        decades(
            &folder.join("transfer-cost.png"),
            "Cost against surface samples",
            ["samples", "seconds"],
            &[curve],
        )?;
    }
    Ok(lines.join("\n"))
}

/// A bake of a grid of bubbles, against bubble by bubble.
fn speed(_: Option<&Path>) -> Result<String> {
    const GRID: [usize; 3] = [20, 20, 12];
    const BANDS: usize = 24;
    const SAMPLE: usize = 3;
    let mut glass = vessel(GLASS)?;
    let shape = glass.shape()?;
    // In the square inside the circle.
    let place = |i: usize, axis: usize, low: f64, high: f64| {
        low + (high - low) * (i as f64 + 0.5) / GRID[axis] as f64
    };
    let bubbles: Vec<Point> = (0..GRID.iter().product())
        .map(|i: usize| {
            let (x, y, z) = (i % GRID[0], i / GRID[0] % GRID[1], i / (GRID[0] * GRID[1]));
            [
                place(x, 0, -0.024, 0.024),
                place(y, 1, -0.024, 0.024),
                place(z, 2, 0.0, 0.05),
            ]
        })
        .collect();
    let ears = [EAR, [0.3, -0.2, 0.4]];
    let band = |i: usize| 300.0 * (5_000.0f64 / 300.0).powf(i as f64 / (BANDS - 1) as f64);
    let solves = (bubbles.len() * BANDS) as f64;

    let begun = Instant::now();
    one_core(|| -> Result<()> {
        for i in 0..BANDS {
            let solver = Solver::new(&shape, band(i))?;
            for ear in ears {
                solver.hear(ear)?.at(&bubbles)?;
            }
        }
        Ok(())
    })??;
    let adjoint = begun.elapsed().as_secs_f64();

    // Bubbles from all over the grid, in a middle band.
    let some = |n: usize| bubbles.iter().step_by(bubbles.len() / n).take(n).copied();
    let middle = band(BANDS / 2);
    let found = closed(&shape)?;
    let begun = Instant::now();
    one_core(|| -> Result<()> {
        for (seed, bubble) in some(SAMPLE).enumerate() {
            let (inside, outside) = samples(found);
            // HF draw the points anew for every bubble; the fewest of table 1.
            let centres = scatter(found, 80, seed as u64);
            let poles = Multipoles::on(found, middle, inside, outside, &centres, [30, 80])?;
            for ear in ears {
                poles.direct(bubble, ear)?;
            }
        }
        Ok(())
    })??;
    let theirs = begun.elapsed().as_secs_f64() / SAMPLE as f64;

    let solver = Solver::new(&shape, middle)?;
    let begun = Instant::now();
    one_core(|| -> Result<()> {
        for bubble in some(40) {
            solver.sound(bubble)?.at(&ears)?;
        }
        Ok(())
    })??;
    let shared = begun.elapsed().as_secs_f64() / 40.0;

    // As coarse as this frequency allows, everything anew for one bubble.
    glass.edge = Some(0.01);
    let coarse = glass.shape()?;
    let (mut alone, mut residual) = (f64::INFINITY, Residual::default());
    for _ in 0..3 {
        let begun = Instant::now();
        residual = one_core(|| -> Result<Residual> {
            let solver = Solver::new(&coarse, 1_000.0)?;
            let sound = solver.sound([0.01, 0.005, 0.02])?;
            sound.at(&ears)?;
            let seconds = begun.elapsed().as_secs_f64();
            alone = alone.min(seconds);
            Ok(sound.residual(EAR))
        })??;
    }
    Ok([
        format!(
            "Speed in the glass: {} x {} x {} bubbles, {BANDS} bands, 2 ears, one core",
            GRID[0], GRID[1], GRID[2]
        ),
        format!("adjoint                            {adjoint:>12.1} s, measured"),
        format!(
            "HF's way, {theirs:.2} s a bubble          {:>12.0} s, from {SAMPLE} bubbles with 30 and 80 points: {:.0} times as long",
            theirs * solves,
            theirs * solves / adjoint
        ),
        format!(
            "direct, sharing factors, {shared:.4} s   {:>12.0} s, from 40 bubbles: {:.0} times as long",
            shared * solves,
            shared * solves / adjoint
        ),
        format!(
            "direct, one bubble alone           {alone:>12.3} s at 1 kHz, edges of 10 mm, residuals {:.4} in water, {:.4} in air",
            residual.water, residual.air
        ),
    ]
    .join("\n"))
}

/// Runs `work` on a single thread.
fn one_core<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    Ok(pool.install(work))
}
