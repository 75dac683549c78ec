//! Boundary elements: pressure and its normal derivative, linear on each triangle and continuous over the edges,
//! from Green's second identity tested with the same functions (Galerkin), three points a triangle.
//!
//! Mirror planes split the problem into one that is even and one that is odd in each: four problems of a quarter of
//! the size for a vessel with two planes.

use faer::linalg::solvers::{PartialPivLu, Solve};
use faer::{Mat, c64};
use rayon::prelude::*;

use super::mesh::{images, reflect};
use super::panel::{HATS, kernel};
use super::point::{Point, distance, dot, norm, scale, sub};
use super::shape::Surface;

use std::f64::consts::PI;

/// Values at the nodes, one vector for each parity.
pub type Nodal = Vec<Vec<c64>>;

const ZERO: c64 = c64::new(0.0, 0.0);
/// Panels that a residual is taken at, about.
const MIDDLES: usize = 400;

/// Even or odd in each mirror plane: the sign that each reflection brings.
struct Parity {
    signs: Vec<f64>,
    odd: [bool; 2],
}

fn parities(mirrors: [bool; 2]) -> Vec<Parity> {
    let images = images(mirrors);
    // As many as reflections, and by the same signs: odd where the sign is −1.
    images
        .iter()
        .map(|parity| {
            let odd = [parity[0] < 0.0, parity[1] < 0.0];
            let sign = |image: &[f64; 2]| {
                (0..2)
                    .map(|axis| if odd[axis] { image[axis] } else { 1.0 })
                    .product()
            };
            Parity {
                signs: images.iter().map(sign).collect(),
                odd,
            }
        })
        .collect()
}

/// A field at a point, and its slope along a direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Value {
    pub pressure: c64,
    pub slope: c64,
}

/// A point source: (∇² + k²)P = strength·δ.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    pub place: Point,
    pub strength: f64,
    /// 1/m.
    pub k: f64,
}

impl Source {
    /// `−strength·e^{−ikR}/(4πR)`.
    pub fn at(&self, x: Point, normal: Point) -> Value {
        let away = sub(self.place, x);
        let (single, radial) = kernel(norm(away), self.k);
        let unit = -self.strength / (4.0 * PI);
        Value {
            pressure: single * unit,
            slope: radial * (unit * dot(away, normal)),
        }
    }
}

/// Which problem lies on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    /// Liquid: pressure given on the free surface, no flow through the rest.
    Water,
    /// Air: flow given on the free surface, none through the rest. Burton & Miller's weight of the derivative
    /// makes the solution unique at every frequency.
    Air(c64),
}

/// One problem, factored.
pub struct Problem<'a> {
    surface: &'a Surface,
    k: f64,
    side: Side,
    parities: Vec<Parity>,
    systems: Vec<System>,
}

struct System {
    /// The nodes that count: an odd field vanishes on its plane.
    active: Vec<usize>,
    factors: PartialPivLu<c64>,
    /// From what is given at the free surface's nodes to the right-hand side.
    given: Mat<c64>,
}

impl<'a> Problem<'a> {
    /// The liquid's.
    pub fn water(surface: &'a Surface, k: f64) -> Self {
        Self::new(surface, k, Side::Water)
    }

    /// The air's.
    pub fn air(surface: &'a Surface, k: f64) -> Self {
        // Outgoing e^{−ikR}: −i; never longer than the vessel where sound is longer than that.
        let weight = 1.0 / (k + 2.0 / surface.diagonal());
        Self::new(surface, k, Side::Air(c64::new(0.0, -weight)))
    }

    fn new(surface: &'a Surface, k: f64, side: Side) -> Self {
        let parities = parities(surface.mirrors);
        let mut problem = Problem {
            surface,
            k,
            side,
            parities,
            systems: Vec::new(),
        };
        problem.systems = problem.assemble();
        problem
    }

    /// Whether a panel tests the equation of a node.
    fn tests(&self, panel: usize, node: usize) -> bool {
        match self.side {
            Side::Water => self.surface.free[panel] == self.surface.free_node[node].is_some(),
            Side::Air(_) => true,
        }
    }

    fn assemble(&self) -> Vec<System> {
        let surface = self.surface;
        let (n, f) = (surface.nodes.len(), surface.free_nodes);
        let order = self.parities.len();
        let mut full: Vec<(Mat<c64>, Mat<c64>)> = (0..order)
            .map(|_| (Mat::zeros(n, n), Mat::zeros(n, f)))
            .collect();
        // So many panels at a time: their rows wait in memory.
        let chunk = 64;
        let all: Vec<usize> = (0..surface.panels.len()).collect();
        for panels in all.chunks(chunk) {
            let tested: Vec<Tested> = panels.par_iter().map(|panel| self.test(*panel)).collect();
            full.par_iter_mut().enumerate().for_each(|(parity, full)| {
                for tested in &tested {
                    for (node, rows) in &tested.rows {
                        let row = &rows[parity];
                        for (column, value) in row.unknown.iter().enumerate() {
                            full.0[(*node, column)] += *value;
                        }
                        for (column, value) in row.given.iter().enumerate() {
                            full.1[(*node, column)] += *value;
                        }
                    }
                    for (number, columns) in &tested.given {
                        for (node, value) in columns[parity].iter().enumerate() {
                            full.1[(node, *number)] += *value;
                        }
                    }
                }
            });
        }
        full.into_par_iter()
            .zip(&self.parities)
            .map(|((unknown, given), parity)| {
                let active: Vec<usize> = (0..n)
                    .filter(|node| {
                        let point = surface.nodes[*node];
                        !(0..2).any(|axis| parity.odd[axis] && point[axis].abs() < 1e-9)
                    })
                    .collect();
                let size = active.len();
                let matrix = Mat::from_fn(size, size, |i, j| unknown[(active[i], active[j])]);
                let given = Mat::from_fn(size, f, |i, j| given[(active[i], j)]);
                System {
                    active,
                    factors: matrix.partial_piv_lu(),
                    given,
                }
            })
            .collect()
    }

    /// What the three points of a panel bring to the equations.
    fn test(&self, panel: usize) -> Tested {
        let surface = self.surface;
        let (n, f) = (surface.nodes.len(), surface.free_nodes);
        let nodes = surface.corners[panel];
        let here = &surface.panels[panel];
        let share = here.area / 3.0;
        let corners: Vec<usize> = (0..3).filter(|c| self.tests(panel, nodes[*c])).collect();
        let air = match self.side {
            Side::Water => None,
            Side::Air(weight) => Some(weight),
        };
        let flows = air.is_some() && surface.free[panel];
        // For each reflection of the panel, then combined into parities.
        let images = images(surface.mirrors);
        let mut rows = vec![vec![Row::zeros(n, f); images.len()]; corners.len()];
        let mut given = vec![vec![vec![ZERO; n]; images.len()]; if flows { 3 } else { 0 }];
        for (image, signs) in images.iter().enumerate() {
            // ∫ G over each panel, from the three points together.
            let mut potentials = vec![ZERO; surface.panels.len()];
            for (point, hats) in here.samples.iter().zip(&HATS) {
                let (x, normal) = (reflect(*point, *signs), reflect(here.normal, *signs));
                let seen = self.row(x, normal, &mut potentials);
                for (rows, corner) in rows.iter_mut().zip(&corners) {
                    rows[image].add(&seen.row, hats[*corner] * share);
                }
                // ⟨K′q, v⟩ = ⟨q, Kv⟩: the kernel on the smoother of the two.
                for (given, hat) in given.iter_mut().zip(hats) {
                    for (to, double) in given[image].iter_mut().zip(&seen.double) {
                        *to -= *double * (*hat * share);
                    }
                }
            }
            let Some(weight) = air else { continue };
            // ⟨Dp, v⟩ = −⟨G n×∇p, n×∇v⟩ + k²⟨G n p, n v⟩ (Maue): nothing stronger than 1/R is left.
            for (rows, corner) in rows.iter_mut().zip(&corners) {
                let turn = signs[0] * signs[1] * share;
                let test = scale(reflect(here.curls[*corner], *signs), turn);
                for ((panel, nodes), potential) in
                    surface.panels.iter().zip(&surface.corners).zip(&potentials)
                {
                    let part = weight * *potential;
                    for (node, curl) in nodes.iter().zip(&panel.curls) {
                        rows[image].unknown[*node] += part * dot(test, *curl);
                    }
                }
            }
        }
        let rows = corners.iter().zip(rows).map(|(corner, rows)| {
            let mut rows = self.combine(&rows, || Row::zeros(n, f), Row::add);
            // The half of the surface's own values, the same for every parity.
            for row in &mut rows {
                for hats in &HATS {
                    self.add_jump(row, panel, hats, hats[*corner] * share);
                }
            }
            (nodes[*corner], rows)
        });
        let given = given.iter().zip(nodes).filter_map(|(columns, node)| {
            let weight = air?;
            let add = |to: &mut Vec<c64>, from: &Vec<c64>, sign: f64| {
                for (to, from) in to.iter_mut().zip(from) {
                    *to += weight * *from * sign;
                }
            };
            let columns = self.combine(columns, || vec![ZERO; n], add);
            Some((surface.free_node[node]?, columns))
        });
        Tested {
            rows: rows.collect(),
            given: given.collect(),
        }
    }

    /// From reflections to parities.
    fn combine<T>(
        &self,
        images: &[T],
        zero: impl Fn() -> T,
        add: impl Fn(&mut T, &T, f64),
    ) -> Vec<T> {
        self.parities
            .iter()
            .map(|parity| {
                let mut sum = zero();
                for (image, sign) in images.iter().zip(&parity.signs) {
                    add(&mut sum, image, *sign);
                }
                sum
            })
            .collect()
    }

    /// What all panels bring to the equation at a point, in the principal value if it lies on one of them; of the
    /// hypersingular part only `k² n·n′ G`, and ∫ G of each panel for the rest.
    fn row(&self, x: Point, normal: Point, potentials: &mut [c64]) -> Seen {
        let surface = self.surface;
        let (n, f) = (surface.nodes.len(), surface.free_nodes);
        let mut row = Row::zeros(n, f);
        let mut doubles = vec![ZERO; n];
        for (index, (panel, nodes)) in surface.panels.iter().zip(&surface.corners).enumerate() {
            let free = surface.free[index];
            let seen = panel.integrals(x, self.k);
            match self.side {
                Side::Water => {
                    for (j, &node) in nodes.iter().enumerate() {
                        match surface.free_node[node] {
                            None => row.unknown[node] += seen.double[j],
                            Some(number) => {
                                row.given[number] -= seen.double[j];
                                if free {
                                    row.unknown[node] -= seen.single[j];
                                }
                            }
                        }
                    }
                }
                Side::Air(weight) => {
                    let facing = weight * (self.k * self.k * dot(normal, panel.normal));
                    potentials[index] += seen.single[0] + seen.single[1] + seen.single[2];
                    for (j, &node) in nodes.iter().enumerate() {
                        doubles[node] += seen.double[j];
                        row.unknown[node] -= seen.double[j] + facing * seen.single[j];
                        if free && let Some(number) = surface.free_node[node] {
                            row.given[number] -= seen.single[j];
                        }
                    }
                }
            }
        }
        Seen {
            row,
            double: doubles,
        }
    }

    /// The half of the surface's own values at one of a panel's points.
    fn add_jump(&self, row: &mut Row, panel: usize, hats: &[f64; 3], share: f64) {
        let surface = self.surface;
        for (&node, hat) in surface.corners[panel].iter().zip(hats) {
            let half = c64::new(0.5 * hat * share, 0.0);
            match (self.side, surface.free_node[node]) {
                (Side::Water, Some(number)) => row.given[number] -= half,
                (Side::Water, None) => row.unknown[node] += half,
                (Side::Air(weight), number) => {
                    row.unknown[node] += half;
                    if surface.free[panel]
                        && let Some(number) = number
                    {
                        row.given[number] -= weight * half;
                    }
                }
            }
        }
    }

    /// The field that values on the surface radiate to `x`, each parity's part of it: at a reflection of `x` the sum
    /// is the same with the parity's signs.
    fn radiate<const N: usize>(&self, values: [(&Nodal, &Nodal); N], x: Point) -> Vec<[c64; N]> {
        let surface = self.surface;
        let mut sums = vec![[ZERO; N]; self.parities.len()];
        for (image, signs) in images(surface.mirrors).into_iter().enumerate() {
            let seen_from = reflect(x, signs);
            for (index, (panel, nodes)) in surface.panels.iter().zip(&surface.corners).enumerate() {
                let free = surface.free[index];
                let seen = panel.integrals(seen_from, self.k);
                let numbers = nodes.map(|node| surface.free_node[node]);
                for (parity, (sums, kind)) in sums.iter_mut().zip(&self.parities).enumerate() {
                    for (sum, (unknown, given)) in sums.iter_mut().zip(&values) {
                        let mut part = ZERO;
                        for j in 0..3 {
                            let value = unknown[parity][nodes[j]];
                            part += match (self.side, numbers[j]) {
                                (Side::Water, None) => -seen.double[j] * value,
                                (Side::Water, Some(number)) => {
                                    let pressure = seen.double[j] * given[parity][number];
                                    if free {
                                        seen.single[j] * value - pressure
                                    } else {
                                        -pressure
                                    }
                                }
                                (Side::Air(_), Some(number)) if free => {
                                    seen.double[j] * value - seen.single[j] * given[parity][number]
                                }
                                (Side::Air(_), _) => seen.double[j] * value,
                            };
                        }
                        *sum += part * kind.signs[image];
                    }
                }
            }
        }
        sums
    }

    /// Solves for a field that comes from elsewhere, and for what is given on the free surface: pressure in water,
    /// normal derivative in air.
    pub fn solve(&self, incident: Option<Source>, given: Option<&Nodal>) -> Solution<'_, 'a> {
        let surface = self.surface;
        let images = images(surface.mirrors);
        let share = 1.0 / images.len() as f64;
        let mut right: Nodal = vec![vec![ZERO; surface.nodes.len()]; self.parities.len()];
        if let Some(source) = incident {
            for (index, (panel, nodes)) in surface.panels.iter().zip(&surface.corners).enumerate() {
                for (image, signs) in images.iter().enumerate() {
                    let normal = reflect(panel.normal, *signs);
                    let apart = distance(reflect(panel.centre, *signs), source.place);
                    for (point, hats, area) in panel.points(apart) {
                        let field = source.at(reflect(point, *signs), normal);
                        let value = match self.side {
                            Side::Water => field.pressure,
                            Side::Air(weight) => field.pressure + weight * field.slope,
                        };
                        for (right, parity) in right.iter_mut().zip(&self.parities) {
                            let value = value * (parity.signs[image] * share * area);
                            for (node, hat) in nodes.iter().zip(&hats) {
                                if self.tests(index, *node) {
                                    right[*node] += value * *hat;
                                }
                            }
                        }
                    }
                }
            }
        }
        let unknown = self
            .systems
            .iter()
            .zip(&right)
            .enumerate()
            .map(|(parity, (system, right))| {
                let mut b = Mat::from_fn(system.active.len(), 1, |i, _| right[system.active[i]]);
                if let Some(given) = given {
                    let given = Mat::from_fn(surface.free_nodes, 1, |i, _| given[parity][i]);
                    b += &system.given * &given;
                }
                system.factors.solve_in_place(&mut b);
                let mut values = vec![ZERO; surface.nodes.len()];
                for (i, node) in system.active.iter().enumerate() {
                    values[*node] = b[(i, 0)];
                }
                values
            })
            .collect();
        Solution {
            problem: self,
            unknown,
            given: given
                .cloned()
                .unwrap_or_else(|| vec![vec![ZERO; surface.free_nodes]; self.parities.len()]),
        }
    }
}

/// A solved problem: the values on the surface, from which the field everywhere.
pub struct Solution<'p, 'a> {
    problem: &'p Problem<'a>,
    /// In air the pressure; in water the normal derivative on the free surface, the pressure elsewhere.
    unknown: Nodal,
    given: Nodal,
}

impl Solution<'_, '_> {
    /// The unknown at the free surface's nodes: what the other side is given.
    pub fn at_free(&self) -> Nodal {
        let surface = self.problem.surface;
        let pick = |values: &Vec<c64>| {
            let mut free = vec![ZERO; surface.free_nodes];
            for (value, number) in values.iter().zip(&surface.free_node) {
                if let Some(number) = number {
                    free[*number] = *value;
                }
            }
            free
        };
        self.unknown.iter().map(pick).collect()
    }

    /// The field that the surface radiates to `x`, which does not lie on it: without the incident one.
    pub fn radiated(&self, x: Point) -> c64 {
        let parts = self.problem.radiate([(&self.unknown, &self.given)], x);
        parts.iter().map(|part| part[0]).sum()
    }

    /// How far the field at the surface is from what the boundary says, at the middles of panels, points that no
    /// equation used: the rms over the surface, relative to that of what drives it.
    pub fn residual(&self, incident: Option<Source>) -> f64 {
        let problem = self.problem;
        let surface = problem.surface;
        let none = vec![vec![ZERO; surface.nodes.len()]; problem.parities.len()];
        // Evenly among them, where they are many.
        let step = surface.panels.len().div_ceil(MIDDLES);
        let panels: Vec<usize> = (0..surface.panels.len()).step_by(step).collect();
        let parts: Vec<(f64, f64)> = panels
            .par_iter()
            .map(|&index| {
                let panel = &surface.panels[index];
                let pairs = [(&self.unknown, &self.given), (&none, &self.given)];
                let radiated = problem.radiate(pairs, panel.centre);
                let own = self.own(index);
                let (mut off, mut drive) = (0.0, 0.0);
                for (image, signs) in images(surface.mirrors).into_iter().enumerate() {
                    let comes = incident.map_or(ZERO, |source| {
                        let (x, n) = (panel.centre, panel.normal);
                        source.at(reflect(x, signs), reflect(n, signs)).pressure
                    });
                    let (mut missed, mut driven) = (comes, comes);
                    for (parity, kind) in problem.parities.iter().enumerate() {
                        let sign = kind.signs[image];
                        let (value, given) = own[parity];
                        missed += (radiated[parity][0] - value * 0.5) * sign;
                        // Given pressure drives as itself, given flow by what it radiates.
                        driven += sign
                            * match problem.side {
                                Side::Water => given,
                                Side::Air(_) => radiated[parity][1],
                            };
                    }
                    off += missed.norm_sqr() * panel.area;
                    drive += driven.norm_sqr() * panel.area;
                }
                (off, drive)
            })
            .collect();
        let (off, drive) = parts.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (off / drive.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Of each parity: the pressure at the middle of a panel, and what of it is given.
    fn own(&self, panel: usize) -> Vec<(c64, c64)> {
        let problem = self.problem;
        let surface = problem.surface;
        (0..problem.parities.len())
            .map(|parity| {
                let (mut own, mut given) = (ZERO, ZERO);
                for &node in &surface.corners[panel] {
                    match (problem.side, surface.free_node[node]) {
                        (Side::Water, Some(number)) => given += self.given[parity][number] / 3.0,
                        _ => own += self.unknown[parity][node] / 3.0,
                    }
                }
                (own + given, given)
            })
            .collect()
    }
}

/// What a panel's points bring to the equations, one for each parity.
struct Tested {
    /// To its nodes' equations.
    rows: Vec<(usize, Vec<Row>)>,
    /// To every equation, by what is given at its own nodes on the free surface.
    given: Vec<(usize, Vec<Vec<c64>>)>,
}

/// What a point sees.
struct Seen {
    row: Row,
    /// ∫ λ ∂G/∂n of each node.
    double: Vec<c64>,
}

/// One equation: unknown's part = given's part + incident.
#[derive(Clone)]
struct Row {
    unknown: Vec<c64>,
    given: Vec<c64>,
}

impl Row {
    fn zeros(n: usize, f: usize) -> Self {
        Row {
            unknown: vec![ZERO; n],
            given: vec![ZERO; f],
        }
    }

    fn add(&mut self, other: &Row, factor: f64) {
        for (to, from) in self.unknown.iter_mut().zip(&other.unknown) {
            *to += *from * factor;
        }
        for (to, from) in self.given.iter_mut().zip(&other.given) {
            *to += *from * factor;
        }
    }
}
