//! A bubble below an endless plane surface: mirror images solve the water and the air exactly, and the flow through
//! the surface, summed, is the answer (Rayleigh's integral).

use std::f64::consts::PI;

use faer::c64;

use super::point::Point;
use super::{AIR, WATER};

/// Nodes and weights on −1…1, exact to degree 11; the other half by symmetry.
const GAUSS: [(f64, f64); 3] = [
    (0.238_619_186_083_196_9, 0.467_913_934_572_691_04),
    (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (0.932_469_514_203_152, 0.171_324_492_379_170_35),
];
/// Wanted relative accuracy, and the most cells spent on it.
const TOLERANCE: f64 = 1e-6;
const CELLS: usize = 200_000;

/// P/S_b in 1/m, before the density ratio, and how far off it may be, relative.
pub fn transfer(bubble: Point, ear: Point, frequency: f64) -> (c64, f64) {
    let omega = 2.0 * PI * frequency;
    let (kw, ka) = (omega / WATER.speed, omega / AIR.speed);
    let (depth, height) = (-bubble[2], ear[2]);
    let aside = (ear[0] - bubble[0]).hypot(ear[1] - bubble[1]);
    let i = c64::new(0.0, 1.0);
    // Around the point above the bubble; `rho` may be complex.
    let integrand = |rho: c64, angle: f64| {
        let square = rho * rho;
        let rw = (square + depth * depth).sqrt();
        let ra =
            (square - rho * (2.0 * aside * angle.cos()) + (aside * aside + height * height)).sqrt();
        let flow = (c64::new(1.0, 0.0) + i * rw * kw) * depth / (rw * rw * rw * (2.0 * PI));
        // Both exponents in one: each alone may leave the range of numbers.
        -(flow / (ra * (2.0 * PI)) * (-i * (rw * kw + ra * ka)).exp() * rho * 2.0)
    };
    // Out to where all is simple, then into the complex plane, where the waves decay: ρ = far − i s.
    let far = 2.0 * (aside + height + depth);
    let near = |u: f64, angle: f64| {
        // Dense at the middle, as deep as the bubble lies.
        let stretch = (far / depth).asinh();
        let rho = depth * (u * stretch).sinh();
        integrand(c64::new(rho, 0.0), angle) * (depth * stretch * (u * stretch).cosh())
    };
    let beyond = |u: f64, angle: f64| {
        let s = far * u / (1.0 - u);
        integrand(c64::new(far, -s), angle) * -i * (far / (1.0 - u).powi(2))
    };
    let mut left = CELLS;
    let (mut sum, mut error) = (c64::new(0.0, 0.0), 0.0);
    for part in [&near as &dyn Fn(f64, f64) -> c64, &beyond] {
        let (value, off) = integrate(part, &mut left);
        sum += value;
        error += off;
    }
    (sum, error / sum.norm().max(f64::MIN_POSITIVE))
}

/// Over u from 0 to 1 and the angle from 0 to π, halving where it is rough.
fn integrate(f: &dyn Fn(f64, f64) -> c64, left: &mut usize) -> (c64, f64) {
    let whole = [0.0, 1.0, 0.0, PI];
    let mut rough = vec![(whole, cell(f, whole))];
    let (mut sum, mut error, mut scale) = (c64::new(0.0, 0.0), 0.0, 0.0);
    let mut depth = 0;
    while !rough.is_empty() {
        let mut next = Vec::new();
        scale = f64::max(
            scale,
            (rough.iter().map(|cell| cell.1).sum::<c64>() + sum).norm(),
        );
        for (at, value) in rough {
            let [u0, u1, a0, a1] = at;
            let (u, a) = (0.5 * (u0 + u1), 0.5 * (a0 + a1));
            let parts = [
                [u0, u, a0, a],
                [u, u1, a0, a],
                [u0, u, a, a1],
                [u, u1, a, a1],
            ]
            .map(|at| (at, cell(f, at)));
            let finer: c64 = parts.iter().map(|part| part.1).sum();
            let off = (finer - value).norm();
            *left = left.saturating_sub(4);
            // The first three halvings find what a coarse look misses.
            let fine = depth >= 3 && off < TOLERANCE * scale * 2f64.powi(-depth);
            if fine || *left == 0 || depth > 30 {
                sum += finer;
                // Of order 12: the finer one is much closer than the two are.
                error += off;
            } else {
                next.extend(parts);
            }
        }
        rough = next;
        depth += 1;
    }
    (sum, error)
}

fn cell(f: &dyn Fn(f64, f64) -> c64, [u0, u1, a0, a1]: [f64; 4]) -> c64 {
    let points = || GAUSS.iter().flat_map(|(x, w)| [(*x, *w), (-*x, *w)]);
    let (hu, ha) = (0.5 * (u1 - u0), 0.5 * (a1 - a0));
    let mut sum = c64::new(0.0, 0.0);
    for (x, wx) in points() {
        for (y, wy) in points() {
            let value = f(u0 + hu * (1.0 + x), a0 + ha * (1.0 + y));
            if value.re.is_finite() && value.im.is_finite() {
                sum += value * (wx * wy * hu * ha);
            }
        }
    }
    sum
}
