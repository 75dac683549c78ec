//! The sound of vortices: Möhring's integral over the whole source volume (VS (1), with the exponent of c mended).
//!
//! `p(t) = ρ/(12π c² r) · d³/dt³ ∫ (x̂·y)·((y × ω)·x̂) dV`, y from the middle of the volume, x̂ toward the receiver.
//!
//! VS sums the integral over cells of 27 voxels, each about its own middle, with weights that depend on distance alone.
//! That cancels: the sum of `w(d)·(x·d)·((d × ω)·x)` over such a cell is `c·x·(x × ω) = 0`. And the trace of the source is
//! zero, `y·(y × ω) = 0`, so that the mean over receivers all around, which VS takes, is silence. Hence one origin for the
//! whole volume, and receivers kept apart.
//!
//! Eddies must not be cut off at the ends or jump from one side to the other: the integral is windowed, smoothly enough for
//! three derivatives.

use std::f64::consts::PI;

use realfft::{RealFftPlanner, num_complex::Complex};

use super::grid::Grid;

/// Density of air, kg/m³.
pub const DENSITY: f64 = 1.2;
/// Speed of sound in air, m/s.
pub const SOUND: f64 = 343.0;

/// ∫ y_i (y × ω)_j dV, made symmetric: xx, yy, zz, xy, xz, yz, in m⁵/s.
pub type Moment = [f64; 6];

/// The source volume.
pub struct Volume {
    /// Along each axis: places of the cells from the middle, m, and how much they count.
    axis: [Vec<(f64, f64)>; 3],
    cell: f64,
}

impl Volume {
    /// A whole box, windowed over `taper` of its length at either end of each axis (0: not at all).
    pub fn new(grid: &Grid, taper: [f64; 3]) -> Self {
        let axis = [0, 1, 2].map(|axis| {
            let n = grid.cells[axis] as f64;
            let place = |i: usize| {
                let x = (i as f64 + 0.5) / n;
                let end = x.min(1.0 - x);
                let weight = if end < taper[axis] {
                    smooth(end / taper[axis])
                } else {
                    1.0
                };
                ((x - 0.5) * n * grid.h, weight)
            };
            (0..grid.cells[axis]).map(place).collect()
        });
        Self {
            axis,
            cell: grid.h.powi(3),
        }
    }

    /// The moment of a vorticity given in the middle of each cell, 1/s.
    pub fn moment(&self, omega: &[Vec<f64>; 3]) -> Moment {
        let mut sum = [0.0; 6];
        let mut at = 0;
        for &(z, by_z) in &self.axis[2] {
            for &(y, by_y) in &self.axis[1] {
                let weight = by_z * by_y;
                for &(x, by_x) in &self.axis[0] {
                    let weight = weight * by_x;
                    let [a, b, c] = [0, 1, 2].map(|i| weight * omega[i][at]);
                    let (p, q, r) = (y * c - z * b, z * a - x * c, x * b - y * a);
                    sum[0] += x * p;
                    sum[1] += y * q;
                    sum[2] += z * r;
                    sum[3] += x * q + y * p;
                    sum[4] += x * r + z * p;
                    sum[5] += y * r + z * q;
                    at += 1;
                }
            }
        }
        for (i, sum) in sum.iter_mut().enumerate() {
            *sum *= self.cell * if i < 3 { 1.0 } else { 0.5 };
        }
        sum
    }
}

/// From 0 to 1 with three derivatives that are 0 at both ends.
fn smooth(x: f64) -> f64 {
    x.powi(4) * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x)))
}

/// `(x̂·y)·((y × ω)·x̂)` integrated, toward a receiver.
pub fn toward(moment: &Moment, direction: [f64; 3]) -> f64 {
    let size = direction.iter().map(|x| x * x).sum::<f64>();
    let [x, y, z] = direction;
    let [xx, yy, zz, xy, xz, yz] = moment;
    (x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz)) / size
}

/// Pascal at 1 m for a third derivative of the integral.
pub fn pressure(third: f64) -> f64 {
    DENSITY / (12.0 * PI * SOUND * SOUND) * third
}

/// The band a derivative is taken in, Hz: untouched up to the first, nothing from the second on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// All of it.
    pub pass: f64,
    /// None of it.
    pub stop: f64,
}

/// The third derivative of `record`, one value every `dt`, on every `stride`th of its places.
///
/// A third derivative raises noise like f³: what the grid's graininess adds above the eddies it resolves would drown them.
/// So it is taken in the frequency domain, exactly within the band and smoothly to nothing at its end, which is also
/// what makes the coarser places enough. The record need not come round: the first and last `margin` values are faded, and
/// what lies there, and some periods of the band's slope further in, means nothing.
pub fn third_derivative(
    record: &[f64],
    dt: f64,
    margin: usize,
    band: Band,
    stride: usize,
) -> Vec<f64> {
    let n = record.len() / stride * stride;
    if n == 0 {
        return Vec::new();
    }
    let record = &record[..n];
    let margin = margin.min(n / 2);
    // A line has no third derivative, but would be a step for the transform.
    let ends = [&record[..margin.max(1)], &record[n - margin.max(1)..]];
    let [first, last] = ends.map(|end| end.iter().sum::<f64>() / end.len() as f64);
    let mut series: Vec<f64> = (0..n)
        .map(|i| {
            let line = first + (last - first) * (i as f64 + 0.5) / n as f64;
            let end = i.min(n - 1 - i);
            let fade = if end < margin {
                smooth((end as f64 + 0.5) / margin as f64)
            } else {
                1.0
            };
            (record[i] - line) * fade
        })
        .collect();
    let mut planner = RealFftPlanner::new();
    let forward = planner.plan_fft_forward(n);
    let mut spectrum = forward.make_output_vec();
    let m = n / stride;
    let back = planner.plan_fft_inverse(m);
    let mut narrow = back.make_input_vec();
    let mut out = back.make_output_vec();
    // PANIC: the lengths are the plans' own; the ends of the spectrum are real.
    forward
        .process(&mut series, &mut spectrum)
        .expect("lengths of the plan");
    for (bin, (to, from)) in narrow.iter_mut().zip(&spectrum).enumerate() {
        let f = bin as f64 / (n as f64 * dt);
        let slope = ((f - band.pass) / (band.stop - band.pass)).clamp(0.0, 1.0);
        let omega = 2.0 * PI * f;
        let gain = -omega.powi(3) * (1.0 - smooth(slope)) / n as f64;
        *to = from * Complex::new(0.0, gain);
    }
    narrow[0] = Complex::default();
    if m % 2 == 0 {
        narrow[m / 2] = Complex::default();
    }
    back.process(&mut narrow, &mut out)
        .expect("lengths of the plan");
    out
}
