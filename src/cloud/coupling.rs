//! What clusters are to each other: the core of Woodbury's identity. Control path, f32.

use super::matrix::{UNIT_BITS, fixed, over_root, sqrt};
use crate::bubble::RHO;
use crate::kernel::cloud::{GROUP, Row, SUM_BITS};

/// What has to be left of a coupled mass of 1.
const MARGIN: f32 = 0.05;

/// One cluster, to the others.
#[derive(Clone, Copy, Debug)]
pub struct Peer {
    /// What its sum gives way to a push of 1.
    pub yields: f32,
    /// The same, as light as the step allows.
    pub yields_most: f32,
    /// Sum of its members' radii, m.
    pub radii: f32,
    /// Loudness in each ear.
    pub pan: [f32; 2],
}

impl Peer {
    /// Nobody.
    pub const NONE: Self = Self {
        yields: 0.0,
        yields_most: 0.0,
        radii: 0.0,
        pan: [0.0; 2],
    };
}

/// Bits of a pascal in a sample of the cloud.
const SAMPLE_BITS: i32 = 20;

/// What a word of the core is to an ear whose gain is 1; too loud for a word above 384 kHz.
pub fn loudness(sample_rate: f64) -> f32 {
    // p = ρ/4π·v̈ at 1 m; v̈ is a sum over the square of a step.
    let rate = sample_rate / 2.0;
    let pascal = RHO / (4.0 * core::f64::consts::PI) * rate * rate;
    libm::scalbn(pascal, SAMPLE_BITS + 3 - SUM_BITS as i32 - UNIT_BITS) as f32
}

/// The core, worked out in place.
#[derive(Clone, Debug)]
pub struct Core<const K: usize> {
    /// What is between two clusters, then what they do to each other.
    pub between: [[f32; K]; K],
}

impl<const K: usize> Core<K> {
    /// Nothing.
    pub const NONE: Self = Self {
        between: [[0.0; K]; K],
    };

    /// Makes what `k` clusters do to each other (W) of what is between them (G).
    pub fn solve(&mut self, peers: &[Peer; K], k: usize) {
        let root = |yields: fn(&Peer) -> f32| peers.each_ref().map(|peer| sqrt(yields(peer)));
        let most = root(|peer| peer.yields_most);
        if !self.holds(&most, k) {
            // No row of it sums up to more than this: a part of it is definite whatever the rest is (Gershgorin).
            let row = |i: usize| {
                (0..k)
                    .map(|j| most[i] * self.between[i][j].abs() * most[j])
                    .sum()
            };
            let largest = (0..k).map(row).fold(0.0, f32::max);
            let part = (1.0 - 2.0 * MARGIN) / largest;
            (self.between.iter_mut().flatten()).for_each(|between| *between *= part);
        }
        let root = root(|peer| peer.yields);
        // (1 + X)⁻¹ of X = √H·G·√H, by sweeping each row and column in turn; the lower half only.
        let x = &mut self.between;
        for i in 0..k {
            for j in 0..i {
                x[i][j] *= root[i] * root[j];
            }
            x[i][i] = 1.0;
        }
        for p in 0..k {
            let pivot = 1.0 / x[p][p];
            let mut column = [0.0; K];
            for i in 0..k {
                column[i] = if i < p { x[p][i] } else { x[i][p] };
            }
            for i in 0..k {
                if i == p {
                    continue;
                }
                let part = column[i] * pivot;
                for (x, other) in x[i][..=i].iter_mut().zip(&column) {
                    *x -= part * other;
                }
                // The swept column itself.
                if p < i {
                    x[i][p] = part;
                } else {
                    x[p][i] = part;
                }
            }
            x[p][p] = -pivot;
        }
        // W = √H⁻¹·(1 − (1 + X)⁻¹)·√H⁻¹; the sweep leaves −(1 + X)⁻¹.
        let over = root.map(|root| if root > 0.0 { 1.0 / root } else { 0.0 });
        for i in 0..k {
            for j in 0..=i {
                let one = if i == j { 1.0 } else { 0.0 };
                let w = (one + x[i][j]) * over[i] * over[j];
                x[i][j] = w;
                x[j][i] = w;
            }
        }
    }

    /// Whether `1 + √H·G·√H` is positive definite with a margin (Cholesky).
    #[inline(never)]
    fn holds(&self, root: &[f32; K], k: usize) -> bool {
        let mut l = [[0.0; K]; K];
        for i in 0..k {
            for j in 0..=i {
                let own = if i == j { 1.0 - MARGIN } else { 0.0 };
                let x = own + root[i] * self.between[i][j] * root[j];
                let (head, tail) = l.split_at_mut(i);
                let row = &mut tail[0];
                let other = if i == j { &*row } else { &head[j] };
                let x = (row[..j].iter().zip(other)).fold(x, |x, (a, b)| x - a * b);
                if i != j {
                    row[j] = x * head[j][j];
                } else if x > MARGIN {
                    // Over the diagonal, for the rows below.
                    row[i] = over_root(x);
                } else {
                    return false;
                }
            }
        }
        true
    }

    /// Row `index` of the audio path's core, of `groups` groups: one for each ear and one for each cluster, and again for
    /// the next group.
    pub fn row(&self, peers: &[Peer; K], groups: usize, loudness: f32, index: usize) -> Row {
        let k = groups * GROUP;
        let (group, line) = (index / (k + 2), index % (k + 2));
        core::array::from_fn(|n| {
            let q = group * GROUP + n;
            if line >= 2 {
                // A push is of v, a sum 2^11 of it.
                return -fixed(self.between[line - 2][q], 32 - SUM_BITS);
            }
            let given = |p: usize| peers[p].pan[line] * peers[p].yields * self.between[p][q];
            let back: f32 = (0..k).map(given).sum();
            fixed(loudness * (peers[q].pan[line] - back), 32)
        })
    }
}
