//! The cloud's algorithm once more, in f64 and in its own words: what the core computes in f32 and plays in fixed point.
#![allow(clippy::needless_range_loop, reason = "matrices read as in the books")]

use std::f64::consts::PI;

use freshet::bubble::{Bubble, RHO};
use freshet::cloud::{Body, Message, Settings};

type Place = (usize, usize);
type Matrix<const N: usize> = [[f64; N]; N];

/// A bubble as it is in a matrix.
#[derive(Clone, Copy, Default)]
struct Member {
    there: bool,
    place: [f64; 3],
    radius: f64,
    omega: f64,
    beta: f64,
}

#[derive(Clone, Copy, Default)]
struct Mode {
    k: f64,
    c: f64,
    share: f64,
    gauge: f64,
    y: f64,
    v: f64,
}

#[derive(Clone, Copy, Default)]
struct Cluster {
    members: [Member; 8],
    modes: [Mode; 8],
    turn: Matrix<8>,
    yields: f64,
    radii: f64,
    pan: [f64; 2],
}

pub struct Model {
    rate: f64,
    clusters: Vec<Cluster>,
    alone: [Mode; 8],
    /// For each ear and cluster.
    rows: [Vec<f64>; 2],
    core: Vec<Vec<f64>>,
    sums: Vec<f64>,
    jump: [f64; 2],
    forces: Vec<(u32, u32, u32, Place, f64)>,
    raw: [Vec<f64>; 2],
}

fn member(body: &Body) -> Member {
    let bubble = Bubble::new(f64::from(body.radius));
    Member {
        there: true,
        place: body.place.map(f64::from),
        radius: f64::from(body.radius),
        omega: bubble.omega0,
        beta: bubble.beta,
    }
}

fn nearness(a: &Member, b: &Member) -> f64 {
    let apart: f64 = (0..3).map(|i| (a.place[i] - b.place[i]).powi(2)).sum();
    let apart = apart + 2.0 * (a.radius.powi(2) + b.radius.powi(2));
    1.0 / apart.sqrt() - 1.0 / (apart + 4.0 * a.place[2] * b.place[2]).sqrt()
}

/// Eigenvectors in columns; eigenvalues on the diagonal (Jacobi).
fn diagonalise<const N: usize>(a: &mut Matrix<N>) -> Matrix<N> {
    let mut u = [[0.0; N]; N];
    (0..N).for_each(|i| u[i][i] = 1.0);
    for _ in 0..30 {
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q].abs() < 1e-300 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for i in 0..N {
                    let (x, y) = (a[i][p], a[i][q]);
                    (a[i][p], a[i][q]) = (c * x - s * y, s * x + c * y);
                }
                for i in 0..N {
                    let (x, y) = (a[p][i], a[q][i]);
                    (a[p][i], a[q][i]) = (c * x - s * y, s * x + c * y);
                }
                for row in &mut u {
                    let (x, y) = (row[p], row[q]);
                    (row[p], row[q]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    u
}

impl Mode {
    fn new(omega: f64, beta: f64, sigma: f64, step: f64) -> Self {
        let kept = (-2.0 * beta * step).exp();
        let angle = (omega * omega - beta * beta).max(0.0).sqrt() * step;
        let c = 1.0 - kept;
        let k = 1.0 - 2.0 * kept.sqrt() * angle.cos() + kept;
        let mass = 1.0 / (1.0 - k / 12.0 - c / 2.0);
        Self {
            k,
            c,
            share: sigma / mass.sqrt(),
            gauge: omega * step / (PI * mass.sqrt()),
            ..Self::default()
        }
    }

    fn pull(&self) -> f64 {
        -self.k * self.y - self.c * self.v
    }
}

impl Cluster {
    fn new(members: [Member; 8], coupling: f64, step: f64) -> Self {
        let mut a = [[0.0; 8]; 8];
        for i in 0..8 {
            for j in 0..8 {
                let (one, other) = (&members[i], &members[j]);
                if one.there && other.there {
                    let m = coupling * (one.radius * other.radius).sqrt();
                    let m = if i == j {
                        1.0
                    } else {
                        m * nearness(one, other)
                    };
                    a[i][j] = m / (one.omega * other.omega);
                }
            }
        }
        let turn = diagonalise(&mut a);
        let mut cluster = Self {
            members,
            turn,
            ..Self::default()
        };
        for m in 0..8 {
            if a[m][m] <= 0.0 {
                continue;
            }
            let omega = 1.0 / a[m][m].sqrt();
            let (mut damp, mut sigma) = (0.0, 0.0);
            for (i, one) in members.iter().enumerate().filter(|(_, one)| one.there) {
                damp += turn[i][m].powi(2) * 2.0 * one.beta / one.omega.powi(2);
                sigma += omega * turn[i][m] * one.radius.sqrt() / one.omega;
            }
            let mode = Mode::new(omega, 0.5 * damp * omega * omega, sigma, step);
            cluster.yields += mode.share * mode.share;
            cluster.modes[m] = mode;
        }
        cluster.radii = members
            .iter()
            .filter(|one| one.there)
            .map(|one| one.radius)
            .sum();
        cluster
    }

    /// y and v of each bubble.
    fn swings(&self) -> [[f64; 2]; 8] {
        let swing = |i: usize| {
            self.modes
                .iter()
                .enumerate()
                .fold([0.0; 2], |[y, v], (m, mode)| {
                    let turn = self.turn[i][m] * mode.gauge;
                    [y + turn * mode.y, v + turn * mode.v]
                })
        };
        std::array::from_fn(swing)
    }

    fn sum(&self) -> f64 {
        self.modes.iter().map(|mode| mode.share * mode.pull()).sum()
    }
}

/// Half-band filter of the core.
const TAPS: [f64; 6] = [
    1_348_917_376.0,
    -398_033_124.0,
    185_352_038.0,
    -87_955_400.0,
    36_898_320.0,
    -11_437_386.0,
];
const HISTORY: usize = 16;

impl Model {
    pub fn new(rate: f64) -> Self {
        Self {
            rate: rate / 2.0,
            clusters: vec![Cluster::default(); 32],
            alone: [Mode::default(); 8],
            rows: [vec![0.0; 32], vec![0.0; 32]],
            core: vec![vec![0.0; 32]; 32],
            sums: vec![0.0; 32],
            jump: [0.0; 2],
            forces: Vec::new(),
            raw: [vec![0.0; HISTORY], vec![0.0; HISTORY]],
        }
    }

    fn ears(&self) -> [f64; 2] {
        let alone: f64 = self.alone.iter().map(|mode| mode.share * mode.pull()).sum();
        let pascal = RHO / (4.0 * PI) * self.rate * self.rate;
        [0, 1].map(|ear| {
            let row = self.rows[ear].iter().zip(&self.sums);
            pascal * (row.map(|(row, sum)| row * sum).sum::<f64>() + alone / 2f64.sqrt())
        })
    }

    /// A tick at twice the rate, pascal; `bodies` are those the message leads to.
    pub fn tick<'a>(
        &mut self,
        message: &Message,
        bodies: impl Iterator<Item = (Place, &'a Body)>,
        settings: &Settings,
    ) -> Vec<[f64; 2]> {
        if message.commit.is_some() {
            self.commit(message, bodies, settings);
        }
        for force in &message.forces {
            let place = (usize::from(force.cluster), usize::from(force.member));
            let push = f64::from(force.push) / 2f64.powi(51);
            self.forces.push((
                u32::from(force.start),
                u32::from(force.steps),
                1,
                place,
                push,
            ));
        }
        let mut out = Vec::new();
        for _ in 0..64 {
            let sample = self.step();
            for (raw, sample) in self.raw.iter_mut().zip(sample) {
                raw.remove(0);
                raw.push(sample);
            }
            let droop = 472_446_402.0 / 2f64.powi(32);
            let bright = |raw: &[f64], n: usize| {
                // Sample n of 13, the newest last, as it left the brightener.
                let at = HISTORY - 14 + n;
                raw[at] + droop * (2.0 * raw[at] - raw[at - 1] - raw[at + 1])
            };
            let frames = [0, 1].map(|ear| {
                let x: Vec<f64> = (0..13).map(|n| bright(&self.raw[ear], n)).collect();
                let window = &x[1..];
                let half: f64 = (0..6)
                    .map(|k| TAPS[k] * (window[5 - k] + window[6 + k]))
                    .sum();
                [window[5], half / 2f64.powi(31)]
            });
            out.push([frames[0][0], frames[1][0]]);
            out.push([frames[0][1], frames[1][1]]);
        }
        out
    }

    fn step(&mut self) -> [f64; 2] {
        let mut forces = std::mem::take(&mut self.forces);
        forces.retain_mut(|(wait, steps, n, (cluster, member), push)| {
            if *wait > 0 {
                *wait -= 1;
                return true;
            }
            let cluster_of = &mut self.clusters[*cluster];
            for (m, mode) in cluster_of.modes.iter_mut().enumerate() {
                let kick = cluster_of.turn[*member][m] * mode.gauge * *push * f64::from(*n * *n);
                mode.v += kick;
                self.sums[*cluster] += mode.share * kick;
            }
            *n += 1;
            *n <= *steps
        });
        self.forces = forces;
        let mut out = self.ears();
        for (out, jump) in out.iter_mut().zip(&mut self.jump) {
            *out += *jump;
            *jump *= 1.0 - 1.0 / 32.0;
        }
        for (p, cluster) in self.clusters.iter_mut().enumerate() {
            let drive: f64 = self.core[p]
                .iter()
                .zip(&self.sums)
                .map(|(w, sum)| -w * sum)
                .sum();
            for mode in &mut cluster.modes {
                mode.v += mode.pull() + mode.share * drive;
                mode.y += mode.v;
            }
        }
        for mode in &mut self.alone {
            mode.v += mode.pull();
            mode.y += mode.v;
        }
        for (sum, cluster) in self.sums.iter_mut().zip(&self.clusters) {
            *sum = cluster.sum();
        }
        out
    }

    fn commit<'a>(
        &mut self,
        message: &Message,
        bodies: impl Iterator<Item = (Place, &'a Body)>,
        settings: &Settings,
    ) {
        let commit = message.commit.as_ref().expect("the caller has looked");
        let before = self.ears();
        let step = 1.0 / self.rate;
        let mut members = vec![[Member::default(); 8]; 32];
        for ((cluster, i), body) in bodies {
            members[cluster][i] = member(body);
        }
        let changed: Vec<usize> = commit
            .changed
            .iter()
            .map(|changed| usize::from(changed.cluster))
            .collect();
        let swings: Vec<_> = changed.iter().map(|p| self.clusters[*p].swings()).collect();
        for retired in &commit.retired {
            let (from, i) = (usize::from(retired.from) / 8, usize::from(retired.from) % 8);
            let one = self.clusters[changed[from]].members[i];
            let mut mode = Mode::new(one.omega, one.beta, one.radius.sqrt(), step);
            mode.y = swings[from][i][0] / mode.gauge;
            mode.v = swings[from][i][1] / mode.gauge;
            self.alone[usize::from(retired.to)] = mode;
        }
        for (p, change) in changed.iter().zip(&commit.changed) {
            let mut cluster = Cluster::new(members[*p], f64::from(settings.coupling), step);
            for m in 0..8 {
                let gauge = cluster.modes[m].gauge;
                for i in 0..8 {
                    if change.from[i] != u8::MAX && gauge > 0.0 {
                        let (from, j) = (
                            usize::from(change.from[i]) / 8,
                            usize::from(change.from[i]) % 8,
                        );
                        cluster.modes[m].y += cluster.turn[i][m] * swings[from][j][0] / gauge;
                        cluster.modes[m].v += cluster.turn[i][m] * swings[from][j][1] / gauge;
                    }
                }
            }
            let there = || cluster.members.iter().filter(|one| one.there);
            let moment: f64 = there().map(|one| one.radius * one.place[0]).sum();
            let middle = if cluster.radii > 0.0 {
                moment / cluster.radii
            } else {
                0.0
            };
            let place =
                0.5 + 0.5 * f64::from(settings.width) * middle / f64::from(settings.extent());
            let place = place.clamp(0.0, 1.0);
            cluster.pan = [place, 1.0 - place].map(|place| (PI / 2.0 * place).cos());
            self.clusters[*p] = cluster;
        }
        // W = G·(1 + H·G)⁻¹, by elimination.
        let n = 32;
        let mut between = vec![vec![0.0; n]; n];
        for p in 0..n {
            for q in (0..n).filter(|q| *q != p) {
                let (one, other) = (&self.clusters[p], &self.clusters[q]);
                let mut near = 0.0;
                for a in one.members.iter().filter(|a| a.there) {
                    for b in other.members.iter().filter(|b| b.there) {
                        near += a.radius * b.radius * nearness(a, b);
                    }
                }
                if near > 0.0 {
                    between[p][q] = f64::from(settings.coupling) * near / (one.radii * other.radii);
                }
            }
        }
        // Solve W·(1 + H·G) = G: transposed, (1 + G·H)·Wᵀ = G.
        let mut left: Vec<Vec<f64>> = (0..n)
            .map(|p| {
                (0..n)
                    .map(|q| between[p][q] * self.clusters[q].yields + f64::from(u8::from(p == q)))
                    .collect()
            })
            .collect();
        let mut right = between;
        for p in 0..n {
            let pivot = left[p][p];
            left[p].iter_mut().for_each(|x| *x /= pivot);
            right[p].iter_mut().for_each(|x| *x /= pivot);
            for q in (0..n).filter(|q| *q != p) {
                let part = left[q][p];
                for i in 0..n {
                    left[q][i] -= part * left[p][i];
                    right[q][i] -= part * right[p][i];
                }
            }
        }
        self.core = right;
        for ear in 0..2 {
            self.rows[ear] = (0..n)
                .map(|q| {
                    let back: f64 = (0..n)
                        .map(|p| {
                            self.clusters[p].pan[ear] * self.clusters[p].yields * self.core[p][q]
                        })
                        .sum();
                    self.clusters[q].pan[ear] - back
                })
                .collect();
        }
        for (sum, cluster) in self.sums.iter_mut().zip(&self.clusters) {
            *sum = cluster.sum();
        }
        let after = self.ears();
        for ear in 0..2 {
            self.jump[ear] += before[ear] - after[ear];
        }
    }
}

/// Undamped frequencies with all pairs and in clusters, each in order, of bubbles that hear all of each other.
pub fn frequencies<'a, const N: usize>(
    bodies: impl Iterator<Item = (Place, &'a Body)>,
) -> (Vec<f64>, Vec<f64>) {
    let all: Vec<(usize, Member)> = bodies.map(|((p, _), body)| (p, member(body))).collect();
    assert!(all.len() <= N);
    let pair = |a: &Member, b: &Member| a.radius * b.radius * nearness(a, b);
    let radii = |p: usize| {
        all.iter()
            .filter(|(q, _)| *q == p)
            .map(|(_, one)| one.radius)
            .sum::<f64>()
    };
    let between = |p: usize, q: usize| {
        let here = || all.iter().filter(move |(c, _)| *c == p);
        let near: f64 = here()
            .map(|(_, a)| {
                all.iter()
                    .filter(|(c, _)| *c == q)
                    .map(|(_, b)| pair(a, b))
                    .sum::<f64>()
            })
            .sum();
        near / (radii(p) * radii(q))
    };
    let clusters = all.iter().map(|(p, _)| *p).max().unwrap_or(0) + 1;
    let core: Vec<Vec<f64>> = (0..clusters)
        .map(|p| (0..clusters).map(|q| between(p, q)).collect())
        .collect();
    let solve = |clustered: bool| {
        let mut a = [[0.0; N]; N];
        for (i, (p, one)) in all.iter().enumerate() {
            for (j, (q, other)) in all.iter().enumerate() {
                let root = (one.radius * other.radius).sqrt();
                let m = match i == j {
                    true => 1.0,
                    false if clustered && p != q => root * core[*p][*q],
                    false => root * nearness(one, other),
                };
                a[i][j] = m / (one.omega * other.omega);
            }
        }
        diagonalise(&mut a);
        let mut found: Vec<f64> = (0..all.len())
            .map(|i| 1.0 / a[i][i].sqrt() / (2.0 * PI))
            .collect();
        found.sort_by(f64::total_cmp);
        found
    };
    (solve(false), solve(true))
}

/// Pitch (Hz) and decay (1/s) of `N` damped sinusoids in `sound`, none above `highest` Hz, the lowest first: linear
/// prediction over where it is loud, by a fifth of a period.
pub fn modes<const N: usize>(sound: &[f64], rate: f64, highest: f64) -> Vec<(f64, f64)> {
    let begin = (0..sound.len()).max_by(|a, b| sound[*a].abs().total_cmp(&sound[*b].abs()));
    let begin = begin.expect("a sound") + 96;
    let floor = sound[begin..begin + 480]
        .iter()
        .fold(0.0f64, |peak, x| peak.max(x.abs()))
        * 1e-2;
    let end = (begin..sound.len())
        .rev()
        .find(|n| sound[*n].abs() > floor)
        .expect("it is loud");
    let order = 2 * N;
    let lag = ((rate / (5.0 * highest)) as usize).max(1);
    let mut normal = vec![vec![0.0; order + 1]; order];
    for n in begin + order * lag..end {
        let row: Vec<f64> = (1..=order).map(|k| sound[n - k * lag]).collect();
        for i in 0..order {
            for j in 0..order {
                normal[i][j] += row[i] * row[j];
            }
            normal[i][order] += row[i] * sound[n];
        }
    }
    for p in 0..order {
        let best = (p..order).max_by(|a, b| normal[*a][p].abs().total_cmp(&normal[*b][p].abs()));
        normal.swap(p, best.expect("a row"));
        for q in (0..order).filter(|q| *q != p) {
            let part = normal[q][p] / normal[p][p];
            for i in 0..=order {
                normal[q][i] -= part * normal[p][i];
            }
        }
    }
    let a: Vec<f64> = (0..order)
        .map(|p| normal[p][order] / normal[p][p])
        .collect();
    // Roots of z^order − Σ a_k z^(order − k) (Durand and Kerner).
    type Complex = realfft::num_complex::Complex<f64>;
    let mut roots: Vec<Complex> = (0..order)
        .map(|k| Complex::new(0.4, 0.9).powu(k as u32))
        .collect();
    for _ in 0..500 {
        for i in 0..order {
            let z = roots[i];
            let value = a
                .iter()
                .fold(Complex::new(1.0, 0.0), |value, a| value * z - a);
            let others = (0..order).filter(|j| *j != i).map(|j| z - roots[j]);
            let others: Complex = others.product();
            roots[i] -= value / others;
        }
    }
    let mut modes: Vec<(f64, f64)> = (roots.iter().filter(|z| z.im > 0.0))
        .map(|z| {
            let s = z.ln() * rate / lag as f64;
            (s.im / (2.0 * PI), -s.re)
        })
        .collect();
    modes.sort_by(|a, b| a.0.total_cmp(&b.0));
    modes
}
