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
//! three derivatives. That is not enough: eddies that the mean flow U carries through a window, unchanged, would be
//! louder than what they do to each other (measured: by half). So the derivative is the one seen from the mean flow,
//! D = ∂t + U·∂z, which is nothing for what is only carried:
//!
//! `∫ W·yy·D³ω dV = Σ C(3, n)·(−U)ⁿ · d³⁻ⁿ/dt³⁻ⁿ ∫ ∂zⁿ(W·yy)·ω dV`, n from 0 to 3,
//!
//! by parts, so that no derivative of ω need be taken. Without a window it is Möhring's own: the terms in which they differ
//! are derivatives of the flow's impulse, which does not change.

use std::f64::consts::PI;

use realfft::{RealFftPlanner, num_complex::Complex};

use super::grid::Grid;

/// Density of air, kg/m³.
pub const DENSITY: f64 = 1.2;
/// Speed of sound in air, m/s.
pub const SOUND: f64 = 343.0;

/// ∫ ∂zⁿ(W·y_i (y × ·)_j) ω dV, n from 0 to 3; made symmetric: xx, yy, zz, xy, xz, yz, in m⁵⁻ⁿ/s.
pub type Moments = [[f64; 6]; 4];

/// The source volume.
pub struct Volume {
    /// Across: places of the cells from the middle, m, and how much they count.
    across: [Vec<(f64, f64)>; 2],
    /// Along the flow: the derivatives 0 to 3 of W, W·z, W·z².
    along: Vec<[[f64; 3]; 4]>,
    cell: f64,
}

impl Volume {
    /// A whole box, windowed over `taper` of its length at either end of each axis.
    pub fn new(grid: &Grid, taper: [f64; 3]) -> Self {
        let middle = |i: usize, axis: usize| (i as f64 + 0.5) / grid.cells[axis] as f64;
        let length = grid.cells.map(|n| n as f64 * grid.h);
        let across = [0, 1].map(|axis| {
            let place = |i: usize| {
                let x = middle(i, axis);
                let weight = smooth(x.min(1.0 - x) / taper[axis])[0];
                ((x - 0.5) * length[axis], weight)
            };
            (0..grid.cells[axis]).map(place).collect()
        });
        let along = (0..grid.cells[2]).map(|k| {
            let x = middle(k, 2);
            // From the upper end, odd derivatives turn round.
            let turn: f64 = if x < 0.5 { 1.0 } else { -1.0 };
            let unit = turn / (taper[2] * length[2]);
            let window = smooth(x.min(1.0 - x) / taper[2]);
            let w = [0, 1, 2, 3].map(|n| window[n] * unit.powi(n as i32));
            let z = (x - 0.5) * length[2];
            // Leibniz.
            [0, 1, 2, 3].map(|n: usize| {
                let before = |j: usize| n.checked_sub(j).map_or(0.0, |m| w[m]);
                let n = n as f64;
                [
                    w[n as usize],
                    w[n as usize] * z + n * before(1),
                    w[n as usize] * z * z + 2.0 * n * before(1) * z + n * (n - 1.0) * before(2),
                ]
            })
        });
        Self {
            across,
            along: along.collect(),
            cell: grid.h.powi(3),
        }
    }

    /// The moments of a vorticity given in the middle of each cell, 1/s.
    pub fn moments(&self, omega: &[Vec<f64>; 3]) -> Moments {
        let mut sum = [[0.0; 6]; 4];
        let mut at = 0;
        for along in &self.along {
            // Sums over a layer of each component times 1, x, y, x², y², xy.
            let mut layer = [[0.0; 6]; 3];
            for &(y, by_y) in &self.across[1] {
                for &(x, by_x) in &self.across[0] {
                    let weight = by_x * by_y;
                    for (sums, omega) in layer.iter_mut().zip(omega) {
                        let w = weight * omega[at];
                        let (wx, wy) = (w * x, w * y);
                        for (sum, w) in sums.iter_mut().zip([w, wx, wy, wx * x, wy * y, wx * y]) {
                            *sum += w;
                        }
                    }
                    at += 1;
                }
            }
            let [a, b, c] = layer;
            const ONE: usize = 0;
            const X: usize = 1;
            const Y: usize = 2;
            const XX: usize = 3;
            const YY: usize = 4;
            const XY: usize = 5;
            for (sum, [w, z, zz]) in sum.iter_mut().zip(along) {
                // y × ω = (y·c − z·b, z·a − x·c, x·b − y·a).
                sum[0] += w * c[XY] - z * b[X];
                sum[1] += z * a[Y] - w * c[XY];
                sum[2] += z * (b[X] - a[Y]);
                sum[3] += 0.5 * (z * (a[X] - b[Y]) + w * (c[YY] - c[XX]));
                sum[4] += 0.5 * (w * (b[XX] - a[XY]) + z * c[Y] - zz * b[ONE]);
                sum[5] += 0.5 * (w * (b[XY] - a[YY]) + zz * a[ONE] - z * c[X]);
            }
        }
        sum.map(|sum| sum.map(|x| x * self.cell))
    }
}

/// From 0 to 1 with five derivatives that are 0 at both ends, and its first three. With fewer, a grid's sums over the window
/// are no longer integrals: the kinks alias.
fn smooth(x: f64) -> [f64; 4] {
    if x >= 1.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    let (u, turn) = (x * (1.0 - x), 1.0 - 2.0 * x);
    let rest = 462.0 + x * (-1980.0 + x * (3465.0 + x * (-3080.0 + x * (1386.0 - 252.0 * x))));
    [
        x.powi(6) * rest,
        2772.0 * u.powi(5),
        2772.0 * 5.0 * u.powi(4) * turn,
        2772.0 * u.powi(3) * (20.0 * turn * turn - 10.0 * u),
    ]
}

/// `(x̂·y)·((y × ω)·x̂)` integrated, toward a receiver.
pub fn toward(moments: &Moments, direction: [f64; 3]) -> [f64; 4] {
    let size = direction.iter().map(|x| x * x).sum::<f64>();
    let [x, y, z] = direction;
    moments.map(|[xx, yy, zz, xy, xz, yz]| {
        (x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz)) / size
    })
}

/// Pascal at 1 m for a third derivative of the integral.
pub fn pressure(third: f64) -> f64 {
    DENSITY / (12.0 * PI * SOUND * SOUND) * third
}

/// The band a derivative is taken in, Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// All from here on, nothing below the half of it. What takes longer than eddies stay in the volume is not known.
    pub from: f64,
    /// All up to here.
    pub pass: f64,
    /// Nothing from here on.
    pub stop: f64,
}

/// The third derivative of a record seen from a flow at `speed`: Σ C(3, n)·(−U)ⁿ·d³⁻ⁿ/dt³⁻ⁿ of its nth part, for one value
/// every `dt`, on every `stride`th of its places.
///
/// A third derivative raises noise like f³: what the grid's graininess adds above the eddies it resolves would drown them.
/// So it is taken in the frequency domain, exactly within the band and smoothly to nothing at its end, which is also
/// what makes the coarser places enough. The record need not come round: the first and last `margin` values are faded, and
/// what lies there, and some periods of the band's slope further in, means nothing. It has no mean.
pub fn third_derivative(
    record: &[[f64; 4]],
    speed: f64,
    dt: f64,
    margin: usize,
    band: Band,
    stride: usize,
) -> Vec<f64> {
    let m = record.len() / stride;
    let n = m * stride;
    if n == 0 {
        return Vec::new();
    }
    let mut planner = RealFftPlanner::new();
    let (forward, back) = (planner.plan_fft_forward(n), planner.plan_fft_inverse(m));
    let mut spectrum = forward.make_output_vec();
    let mut narrow = back.make_input_vec();
    let mut out = back.make_output_vec();
    for (part, binomial) in [1.0, 3.0, 3.0, 1.0].into_iter().enumerate() {
        let mut series = faded(
            record[..n].iter().map(|parts| parts[part]).collect(),
            margin,
        );
        // PANIC: the lengths are the plans' own; below, too, where the ends of the spectrum are 0.
        forward
            .process(&mut series, &mut spectrum)
            .expect("lengths of the plan");
        let whole = binomial * (-speed).powi(part as i32) / n as f64;
        let inside = narrow.len() - 1;
        for (bin, (to, from)) in narrow
            .iter_mut()
            .zip(&spectrum)
            .enumerate()
            .take(inside)
            .skip(1)
        {
            let f = bin as f64 / (n as f64 * dt);
            let slope = ((f - band.pass) / (band.stop - band.pass)).max(0.0);
            let rise = if band.from > 0.0 {
                (2.0 * f / band.from - 1.0).max(0.0)
            } else {
                1.0
            };
            let kept = smooth(rise)[0] * (1.0 - smooth(slope)[0]);
            let gain = Complex::new(0.0, 2.0 * PI * f).powi(3 - part as i32);
            *to += from * gain * (whole * kept);
        }
    }
    back.process(&mut narrow, &mut out)
        .expect("lengths of the plan");
    out
}

/// A series faded at both ends. It keeps its trend: without it the four parts would no longer cancel.
fn faded(mut series: Vec<f64>, margin: usize) -> Vec<f64> {
    let n = series.len();
    for (i, x) in series.iter_mut().enumerate() {
        let end = i.min(n - 1 - i) as f64 + 0.5;
        *x *= smooth(end / margin.max(1) as f64)[0];
    }
    series
}
