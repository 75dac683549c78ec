//! A cluster's modes: its mass matrix diagonalised, and what that is to the audio path. Control path, f32.
//!
//! In the terms of `z = ω·y` the undamped cluster is `A·z̈ + z = 0` with `A_ij = M_ij/(ω_i·ω_j)`: an eigenvalue of A is
//! `1/ω²` of a mode, and modes are orthogonal to each other, so that bubbles may come and go and no energy with them.

use core::f32::consts::PI;

use super::birth::Body;
use crate::kernel::cloud::{Cluster, MEMBERS, Mode};

/// Units of y in a unit of a mode, `m^(3/2)`, as a power of two: a bubble of 12 mm and 1 Pa at 1 m fills a third.
pub const UNIT_BITS: i32 = 54;
/// The same for v.
pub const UNIT: f32 = (1u64 << (UNIT_BITS - 3)) as f32;
/// ε²/2, ε = 2.
const EPSILON: f32 = 2.0;
/// Turns about each pair of axes: so many rounds leave next to nothing off the diagonal.
const ROUNDS: usize = 5;
/// No mode is turned faster than this a step, rad: a bubble at the limit of the cloud's band, 1.41 times as high.
const FASTEST: f32 = 0.93 * PI;

/// The members of a cluster; nobody is in some places.
pub type Members = [Option<Body>; MEMBERS];
/// Rows of a small symmetric matrix.
type Matrix = [[f32; MEMBERS]; MEMBERS];

/// Over the root of the product of their radii, what two bubbles are to each other (definite kernel, physics.md §3; dipole
/// by images above the surface, CB §3.3), 1/m.
#[inline]
pub fn nearness(a: &Body, b: &Body) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|i| a.place[i] - b.place[i]);
    let apart = x * x + y * y + z * z + EPSILON * (a.radius * a.radius + b.radius * b.radius);
    let image = apart + 4.0 * a.place[2] * b.place[2];
    over_root(apart) - over_root(image)
}

/// Diagonalises `a`; returns what turns its bubbles into modes, bubble by mode. Whatever is left off the diagonal, that is
/// orthogonal.
fn diagonalise(a: &mut Matrix) -> Matrix {
    let mut turn = [[0.0; MEMBERS]; MEMBERS];
    for (i, row) in turn.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _ in 0..ROUNDS {
        let mut turned = false;
        for p in 0..MEMBERS - 1 {
            for q in p + 1..MEMBERS {
                turned |= turn_pair(a, &mut turn, p, q);
            }
        }
        if !turned {
            break;
        }
    }
    turn
}

/// One turn of Jacobi's, where it matters.
#[inline(never)]
fn turn_pair(a: &mut Matrix, turn: &mut Matrix, p: usize, q: usize) -> bool {
    /// Square of what is nothing beside the diagonal.
    const NOTHING: f32 = 1e-9;
    let (app, aqq, apq) = (a[p][p], a[q][q], a[p][q]);
    if apq * apq <= NOTHING * app * aqq {
        return false;
    }
    let theta = (aqq - app) / (2.0 * apq);
    let t = 1.0 / (theta.abs() + sqrt(theta * theta + 1.0));
    let t = if theta < 0.0 { -t } else { t };
    let c = over_root(t * t + 1.0);
    let s = t * c;
    let tau = s / (1.0 + c);
    a[p][p] = app - t * apq;
    a[q][q] = aqq + t * apq;
    a[p][q] = 0.0;
    // The upper half only.
    let mut rotate = |i: usize, j: usize, k: usize, l: usize| {
        let (g, h) = (a[i][j], a[k][l]);
        a[i][j] = g - s * (h + g * tau);
        a[k][l] = h + s * (g - h * tau);
    };
    for i in 0..p {
        rotate(i, p, i, q);
    }
    for i in p + 1..q {
        rotate(p, i, i, q);
    }
    for i in q + 1..MEMBERS {
        rotate(p, i, q, i);
    }
    for row in turn {
        let (g, h) = (row[p], row[q]);
        row[p] = g - s * (h + g * tau);
        row[q] = h + s * (g - h * tau);
    }
    true
}

/// A mode alone: exact at any rate, for a step `a = −(c·v + k·y)`, `v += a`, `y += v`.
#[derive(Clone, Copy, Debug)]
pub struct Spring {
    /// k.
    pub k: f32,
    /// c.
    pub c: f32,
    /// Its mass in the coupled step: with `k/12` the error of the second difference is of the fourth order (Numerov), with
    /// `c/2` damping is centred.
    pub mass: f32,
    /// Rad a step, undamped.
    pub pace: f32,
}

impl Spring {
    /// Squares of the angle and the decay, a step.
    #[inline(never)]
    pub fn new(square: f32, decay: f32) -> Self {
        let square = square.min(FASTEST * FASTEST);
        let kept = exp_neg(decay);
        let lost = 1.0 - kept;
        let k = lost * lost + kept * twice_versine((square - decay * decay).max(0.0));
        let c = lost * (1.0 + kept);
        Self {
            k,
            c,
            mass: 1.0 / (1.0 - k / 12.0 - c / 2.0),
            pace: sqrt(square),
        }
    }

    /// What is left of its mass against what the step's springs and losses take from it; above 0.
    pub fn margin(&self) -> f32 {
        1.0 - self.c / 2.0 - self.k / 4.0
    }

    /// For the audio path, with `share` in the sum.
    pub fn mode(&self, share: f32) -> Mode {
        Mode {
            spring: -fixed(self.k, 29),
            loss: -fixed(self.c, 32),
            share: fixed(share, 32),
            ..Mode::default()
        }
    }

    /// What its y is to the bubbles, over what it would be half a turn a step.
    pub fn gauge(&self) -> f32 {
        self.pace / (PI * sqrt(self.mass))
    }
}

/// `1/√x`, within 3e-7: by a first guess on the exponent and Newton's steps, the same on every machine, and in place of a
/// call to a function.
#[inline(always)]
pub fn over_root(x: f32) -> f32 {
    let mut y = f32::from_bits(0x5f37_5a86 - (x.to_bits() >> 1));
    let half = 0.5 * x;
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// `√x`, as exact.
#[inline(always)]
pub fn sqrt(x: f32) -> f32 {
    x * over_root(x)
}

/// `e^-x` for `x` from 0 to 0.5, within 1e-7.
#[inline(never)]
fn exp_neg(x: f32) -> f32 {
    (1..9).rev().fold(1.0, |sum, n| 1.0 - x / n as f32 * sum)
}

/// `2 − 2·cos(sqrt(x))` for `x` from 0 to π², within 2e-7 of it.
#[inline(never)]
fn twice_versine(x: f32) -> f32 {
    let series = (2..11).rev().fold(1.0, |sum, n| {
        let n = n as f32;
        1.0 - x / (2.0 * n * (2.0 * n - 1.0)) * sum
    });
    x * series
}

/// Cut to an i32 of so many bits after the point, and to its range.
pub fn fixed(value: f32, bits: u32) -> i32 {
    (value * (1u64 << bits) as f32) as i32
}

/// A cluster worked out.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// For the audio path, at rest.
    pub cluster: Cluster,
    /// What its sum gives way to a push of 1.
    pub yields: f32,
    /// The same, of a cluster as light as the step allows.
    pub yields_most: f32,
}

/// Works out a cluster whose members hear each other by `coupling`, in steps of `step` seconds.
pub fn solve(members: &Members, coupling: f32, step: f32) -> Solved {
    let mut a = [[0.0; MEMBERS]; MEMBERS];
    for i in 0..MEMBERS {
        let Some(one) = &members[i] else { continue };
        a[i][i] = 1.0 / (one.omega * one.omega);
        for j in i + 1..MEMBERS {
            if let Some(other) = &members[j] {
                a[i][j] = coupling * one.weight * other.weight * nearness(one, other);
            }
        }
    }
    let turn = diagonalise(&mut a);
    let mut cluster = Cluster::REST;
    let (mut yields, mut yields_most) = (0.0, 0.0);
    for m in 0..MEMBERS {
        if members[m].is_none() {
            // Its row and column are 0: the mode is nobody's.
            continue;
        }
        let square = 1.0 / a[m][m];
        let (mut damp, mut share) = (0.0, 0.0);
        for (member, row) in members.iter().zip(&turn) {
            if let Some(body) = member {
                damp += row[m] * row[m] * body.damp;
                share += row[m] * body.weight;
            }
        }
        let spring = Spring::new(square * step * step, 0.5 * damp * square * step);
        let share = share * spring.pace / step / sqrt(spring.mass);
        cluster.modes[m] = spring.mode(share);
        let gauge = spring.gauge();
        cluster.shape.gauge[m] = fixed(gauge, 31);
        cluster.shape.inverse[m] = fixed(1.0 / gauge, 23);
        yields += share * share;
        yields_most += share * share / spring.margin();
    }
    cluster.shape.turn = turn.map(|row| row.map(|x| fixed(x, 31)));
    for (i, member) in members.iter().enumerate() {
        if member.is_none() {
            cluster.shape.turn[i] = [0; MEMBERS];
        }
    }
    Solved {
        cluster,
        yields,
        yields_most,
    }
}

impl Solved {
    /// Nobody in it.
    pub fn empty() -> Self {
        Self {
            cluster: Cluster::REST,
            yields: 0.0,
            yields_most: 0.0,
        }
    }
}
