//! HF's own way (§5), to compare with: monopoles, dipoles and quadrupoles about random points in the liquid, regular
//! ones for the water and outgoing ones for the air, fitted to the boundary conditions at the surface's samples by
//! least squares with a ridge. The cost is linear in the samples.

use std::f64::consts::PI;

use anyhow::{Result, bail};
use faer::linalg::solvers::{Qr, SolveLstsq};
use faer::{Mat, c64};
use rayon::prelude::*;

use super::elements::Source;
use super::point::{Point, add, dot, norm, scale, sub};
use super::shape::{Closed, Sample, Shape};
use super::solver::{Residual, Transfer, wavenumbers};

/// Functions about a point: orders 0, 1 and 2.
pub const FUNCTIONS: usize = 9;
/// Ridge over the matrix's Frobenius norm (HF §5.6).
const RIDGE: f64 = 1e-8;
/// The surface is grown by a voxel (HF §5.5). HF table 1 has voxels of 2 to 12 mm, and its greatest kL say that the
/// liquid is 8 to 15 of them long.
const VOXELS: f64 = 12.0;

/// A shape at a frequency, factored for HF's functions.
pub struct Multipoles {
    wavenumbers: (f64, f64),
    water: Fit,
    air: Fit,
}

/// A least-squares problem on samples, factored.
struct Fit {
    k: f64,
    outgoing: bool,
    centres: Vec<Point>,
    samples: Vec<Sample>,
    /// Of the rows that ask for a slope.
    alpha: f64,
    matrix: Mat<c64>,
    /// By which the functions were divided.
    norms: Vec<f64>,
    factors: Qr<c64>,
}

impl Multipoles {
    /// With so many points for the water and for the air.
    ///
    /// # Errors
    /// A pool, which has no samples; a frequency that the mesh does not resolve.
    pub fn new(shape: &Shape, frequency: f64, water: usize, air: usize) -> Result<Self> {
        shape.check_frequency(frequency)?;
        let Shape::Closed(closed) = shape else {
            bail!("multipoles need a closed surface; a pool has none: use `--basis elements`");
        };
        let (inside, outside) = samples(closed);
        let centres = scatter(closed, water.max(air), 1);
        Self::on(closed, frequency, inside, outside, &centres, [water, air])
    }

    /// On given samples of the liquid's surface and of the air's, about the first of `centres`.
    ///
    /// # Errors
    /// Fewer centres than asked for.
    pub fn on(
        closed: &Closed,
        frequency: f64,
        inside: Vec<Sample>,
        outside: Vec<Sample>,
        centres: &[Point],
        [water, air]: [usize; 2],
    ) -> Result<Self> {
        if centres.len() < water.max(air) {
            bail!(
                "no room for {} points in the liquid: found {}; use fewer",
                water.max(air),
                centres.len()
            );
        }
        let (kw, ka) = wavenumbers(frequency);
        // HF §5.2: the ratio of the areas, for domains about as large as the unit: here times that length.
        let alpha = length(closed) * closed.water.area(false) / closed.water.area(true);
        let new = |k, outgoing, count: usize, samples, alpha| {
            Fit::new(k, outgoing, centres[..count].to_vec(), samples, alpha)
        };
        Ok(Multipoles {
            wavenumbers: (kw, ka),
            water: new(kw, false, water, inside, alpha),
            air: new(ka, true, air, outside, 1.0),
        })
    }

    /// HF's two passes for one bubble.
    ///
    /// # Errors
    /// None; it fits the adjoint's form.
    pub fn direct(&self, bubble: Point, ear: Point) -> Result<Transfer> {
        let comes = source(bubble, self.wavenumbers.0);
        let (inside, water) = self.water.solve(|sample| {
            let comes = comes.at(sample.point, sample.normal);
            if sample.free {
                -comes.pressure
            } else {
                -comes.slope
            }
        });
        let (outside, air) = self.air.solve(|sample| {
            if sample.free {
                comes.at(sample.point, sample.normal).slope
                    + self.water.value(&inside, sample.point, Some(sample.normal))
            } else {
                c64::new(0.0, 0.0)
            }
        });
        Ok(Transfer {
            ratio: self.air.value(&outside, ear, None),
            residual: Residual { water, air },
        })
    }

    /// The same from the ear.
    ///
    /// # Errors
    /// None; it fits the direct one's form.
    pub fn adjoint(&self, bubble: Point, ear: Point) -> Result<Transfer> {
        let comes = source(ear, self.wavenumbers.1);
        let (outside, air) = self
            .air
            .solve(|sample| comes.at(sample.point, sample.normal).slope);
        let (inside, water) = self.water.solve(|sample| {
            if sample.free {
                self.air.value(&outside, sample.point, None)
                    - comes.at(sample.point, sample.normal).pressure
            } else {
                c64::new(0.0, 0.0)
            }
        });
        Ok(Transfer {
            ratio: -self.water.value(&inside, bubble, None),
            residual: Residual { water, air },
        })
    }
}

fn source(place: Point, k: f64) -> Source {
    Source {
        place,
        strength: 1.0,
        k,
    }
}

/// The surface's samples, grown by a voxel.
pub fn samples(closed: &Closed) -> (Vec<Sample>, Vec<Sample>) {
    let voxel = length(closed) / VOXELS;
    let grow = |mut samples: Vec<Sample>| {
        for sample in &mut samples {
            sample.point = add(sample.point, scale(sample.normal, voxel));
        }
        samples
    };
    (grow(closed.water.samples()), grow(closed.air.samples()))
}

/// HF's L: the edge of a cube as long across as the liquid, m.
fn length(closed: &Closed) -> f64 {
    closed.water.diagonal() / 3f64.sqrt()
}

/// Random points in the liquid, always the same for one seed; fewer where they hardly ever fall into it.
pub fn scatter(closed: &Closed, count: usize, seed: u64) -> Vec<Point> {
    let (low, high) = closed.water.bounds();
    let mut state = seed;
    let mut uniform = || {
        // Splitmix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut centres = Vec::new();
    for _ in 0..1000 * count {
        if centres.len() == count {
            break;
        }
        let point = std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) * uniform());
        if closed.water.encloses(point) {
            centres.push(point);
        }
    }
    centres
}

impl Fit {
    fn new(k: f64, outgoing: bool, centres: Vec<Point>, samples: Vec<Sample>, alpha: f64) -> Self {
        let unknowns = FUNCTIONS * centres.len();
        let rows: Vec<Vec<c64>> = samples
            .par_iter()
            .map(|sample| {
                let along = (outgoing || !sample.free).then_some(sample.normal);
                let weight = weight(sample, outgoing, alpha);
                centres
                    .iter()
                    .flat_map(|centre| functions(sub(sample.point, *centre), k, outgoing, along))
                    .map(|value| value * weight)
                    .collect()
            })
            .collect();
        // To unit norm: at small kL the quadrupoles are so much smaller that the ridge would drown them.
        let norms: Vec<f64> = (0..unknowns)
            .map(|j| {
                let column = rows.iter().map(|row| row[j].norm_sqr());
                column.sum::<f64>().sqrt().max(f64::MIN_POSITIVE)
            })
            .collect();
        let matrix = Mat::from_fn(rows.len(), unknowns, |i, j| rows[i][j] / norms[j]);
        let ridge = c64::new(RIDGE * matrix.norm_l2(), 0.0);
        let padded = Mat::from_fn(rows.len() + unknowns, unknowns, |i, j| {
            match i.checked_sub(rows.len()) {
                None => matrix[(i, j)],
                Some(i) if i == j => ridge,
                Some(_) => c64::new(0.0, 0.0),
            }
        });
        Fit {
            k,
            outgoing,
            factors: padded.qr(),
            matrix,
            norms,
            centres,
            samples,
            alpha,
        }
    }

    /// Coefficients, and ‖Ac − b‖/‖b‖.
    fn solve(&self, wanted: impl Fn(&Sample) -> c64 + Sync) -> (Mat<c64>, f64) {
        let (rows, unknowns) = (self.matrix.nrows(), self.matrix.ncols());
        let right: Vec<c64> = self
            .samples
            .par_iter()
            .map(|sample| wanted(sample) * weight(sample, self.outgoing, self.alpha))
            .collect();
        let padded = Mat::from_fn(rows + unknowns, 1, |i, _| {
            right.get(i).copied().unwrap_or(c64::new(0.0, 0.0))
        });
        let solved = self.factors.solve_lstsq(&padded);
        let coefficients = Mat::from_fn(unknowns, 1, |i, _| solved[(i, 0)]);
        let fitted = &self.matrix * &coefficients;
        let off: f64 = (0..rows)
            .map(|i| (fitted[(i, 0)] - right[i]).norm_sqr())
            .sum();
        let all: f64 = right.iter().map(c64::norm_sqr).sum();
        (coefficients, (off / all.max(f64::MIN_POSITIVE)).sqrt())
    }

    /// The field at a point, or its slope along a direction.
    fn value(&self, coefficients: &Mat<c64>, at: Point, along: Option<Point>) -> c64 {
        self.centres
            .iter()
            .flat_map(|centre| functions(sub(at, *centre), self.k, self.outgoing, along))
            .enumerate()
            .map(|(i, value)| value * coefficients[(i, 0)] / self.norms[i])
            .sum()
    }
}

fn weight(sample: &Sample, outgoing: bool, alpha: f64) -> f64 {
    let scale = if outgoing || sample.free { 1.0 } else { alpha };
    scale * sample.area.sqrt()
}

/// `f_l(kR) Y_lm` for l = 0, 1, 2 with f = j or h⁽²⁾ (HF (23), (30)), or its slope along a direction.
fn functions(x: Point, k: f64, outgoing: bool, along: Option<Point>) -> [c64; FUNCTIONS] {
    let r = norm(x).max(1e-12);
    let f = if outgoing {
        hankel(k * r)
    } else {
        bessel(k * r)
    };
    let [a, b, c] = x;
    // Harmonic polynomials with the norms of real Y_lm.
    let n = [1.0, 3.0, 15.0, 3.75, 1.25].map(|n: f64| (n / (4.0 * PI)).sqrt());
    let polynomials = [
        (0, n[0], [0.0; 3]),
        (1, n[1] * a, [n[1], 0.0, 0.0]),
        (1, n[1] * b, [0.0, n[1], 0.0]),
        (1, n[1] * c, [0.0, 0.0, n[1]]),
        (2, n[2] * a * b, [n[2] * b, n[2] * a, 0.0]),
        (2, n[2] * b * c, [0.0, n[2] * c, n[2] * b]),
        (2, n[2] * c * a, [n[2] * c, 0.0, n[2] * a]),
        (
            2,
            n[3] * (a * a - b * b),
            [2.0 * n[3] * a, -2.0 * n[3] * b, 0.0],
        ),
        (
            2,
            n[4] * (2.0 * c * c - a * a - b * b),
            [-2.0 * n[4] * a, -2.0 * n[4] * b, 4.0 * n[4] * c],
        ),
    ];
    polynomials.map(|(l, value, gradient)| {
        let over = r.powi(-l);
        let radial = f[l as usize] * over;
        match along {
            None => radial * value,
            Some(along) => {
                // d(z^−l f_l)/dz = −z^−l f_{l+1}.
                let steep = f[l as usize + 1] * (-k * over);
                steep * (value * dot(x, along) / r) + radial * dot(gradient, along)
            }
        }
    })
}

/// j_0 … j_3.
fn bessel(z: f64) -> [c64; 4] {
    if z < 1.0 {
        // The closed forms cancel here.
        let mut first = 1.0;
        return std::array::from_fn(|l| {
            let l = l as f64;
            if l > 0.0 {
                first *= z / (2.0 * l + 1.0);
            }
            let (mut sum, mut term) = (0.0, 1.0);
            for m in 1..12 {
                sum += term;
                term *= -0.5 * z * z / (m as f64 * (2.0 * (l + m as f64) + 1.0));
            }
            c64::new(first * sum, 0.0)
        });
    }
    let (sin, cos) = z.sin_cos();
    let j0 = sin / z;
    let j1 = j0 / z - cos / z;
    let j2 = 3.0 / z * j1 - j0;
    let j3 = 5.0 / z * j2 - j1;
    [j0, j1, j2, j3].map(|x| c64::new(x, 0.0))
}

/// h⁽²⁾_0 … h⁽²⁾_3.
fn hankel(z: f64) -> [c64; 4] {
    let wave = c64::new(z.sin(), z.cos());
    let h0 = wave * (1.0 / z);
    let h1 = wave * c64::new(1.0 / (z * z), 1.0 / z);
    let h2 = h1 * (3.0 / z) - h0;
    let h3 = h2 * (5.0 / z) - h1;
    [h0, h1, h2, h3]
}
