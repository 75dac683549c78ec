//! Boundary elements: pressure and its normal derivative, linear on each triangle and continuous over the edges,
//! from Green's second identity tested with the same functions (Galerkin), three points a triangle.
//!
//! Mirror planes split the problem into one that is even and one that is odd in each: four problems of a quarter of
//! the size for a vessel with two planes.

use faer::linalg::solvers::{PartialPivLu, Solve};
use faer::{Mat, c64};
use rayon::prelude::*;

use super::mesh::{images, reflect};
use super::panel::{HATS, Integrals, kernel};
use super::point::{Point, cross, dot, norm, sub};
use super::shape::Surface;

use std::f64::consts::PI;

/// Values at the nodes, one vector for each parity.
pub type Nodal = Vec<Vec<c64>>;

const ZERO: c64 = c64::new(0.0, 0.0);

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

/// What a field is at a point, and along a direction: of a source, or of the surface's values.
#[derive(Clone, Copy, Debug, Default)]
pub struct Value {
    pub pressure: c64,
    pub slope: c64,
}

/// The field `−e^{−ikR}/(4πR)` of a unit source, S = 1 in (∇² + k²)P = S δ.
pub fn source(from: Point, at: Point, normal: Point, k: f64) -> Value {
    let away = sub(from, at);
    let (single, radial) = kernel(norm(away), k);
    let unit = -1.0 / (4.0 * PI);
    Value {
        pressure: single * unit,
        slope: radial * (unit * dot(away, normal)),
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
            let rows: Vec<Vec<(usize, Vec<Row>)>> =
                panels.par_iter().map(|panel| self.rows(*panel)).collect();
            full.par_iter_mut().enumerate().for_each(|(parity, full)| {
                for (node, row) in rows.iter().flatten() {
                    let row = &row[parity];
                    // Row-wise into columns: the matrices are small next to the kernel's work.
                    for (column, value) in row.unknown.iter().enumerate() {
                        full.0[(*node, column)] += *value;
                    }
                    for (column, value) in row.given.iter().enumerate() {
                        full.1[(*node, column)] += *value;
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

    /// The equations of a panel's nodes, as far as its three points make them; one row for each parity.
    fn rows(&self, panel: usize) -> Vec<(usize, Vec<Row>)> {
        let surface = self.surface;
        let (n, f) = (surface.nodes.len(), surface.free_nodes);
        let order = self.parities.len();
        let nodes = surface.corners[panel];
        let here = &surface.panels[panel];
        let mut rows: Vec<(usize, Vec<Row>)> = nodes
            .iter()
            .map(|node| (*node, vec![Row::zeros(n, f); order]))
            .collect();
        for (point, hats) in here.samples.iter().zip(&HATS) {
            let seen: Vec<Row> = images(surface.mirrors)
                .into_iter()
                .map(|signs| self.row(reflect(*point, signs), reflect(here.normal, signs)))
                .collect();
            for (parity, kind) in self.parities.iter().enumerate() {
                let mut row = Row::zeros(n, f);
                for (seen, sign) in seen.iter().zip(&kind.signs) {
                    row.add(seen, *sign);
                }
                self.add_jump(&mut row, panel, hats);
                for (corner, (node, rows)) in rows.iter_mut().enumerate() {
                    if self.tests(panel, *node) {
                        rows[parity].add(&row, hats[corner] * here.area / 3.0);
                    }
                }
            }
        }
        rows.retain(|(node, _)| self.tests(panel, *node));
        rows
    }

    /// What all panels bring to the equation at a point that lies on none of them, or in the principal value.
    fn row(&self, x: Point, normal: Point) -> Row {
        let surface = self.surface;
        let mut row = Row::zeros(surface.nodes.len(), surface.free_nodes);
        for (panel, nodes) in surface.panels.iter().zip(&surface.corners).enumerate() {
            let (index, (panel, nodes)) = (panel, nodes);
            let free = surface.free[index];
            let seen = panel.integrals(x, self.k);
            match self.side {
                Side::Water => {
                    for (j, &node) in nodes.iter().enumerate() {
                        let double = double(&seen, panel.normal, j);
                        match surface.free_node[node] {
                            None => row.unknown[node] += double,
                            Some(number) => {
                                row.given[number] -= double;
                                if free {
                                    row.unknown[node] -= seen.single[j];
                                }
                            }
                        }
                    }
                }
                Side::Air(weight) => {
                    let steep = hypersingular(&seen, panel, normal, self.k);
                    for (j, &node) in nodes.iter().enumerate() {
                        let double = double(&seen, panel.normal, j);
                        row.unknown[node] -= double + weight * steep[j];
                        if free && let Some(number) = surface.free_node[node] {
                            let slope = along(&seen.gradient[j], normal);
                            row.given[number] -= seen.single[j] + weight * slope;
                        }
                    }
                }
            }
        }
        row
    }

    /// The half of the surface's own values.
    fn add_jump(&self, row: &mut Row, panel: usize, hats: &[f64; 3]) {
        let surface = self.surface;
        for (&node, hat) in surface.corners[panel].iter().zip(hats) {
            let half = c64::new(0.5 * hat, 0.0);
            match self.side {
                Side::Water => match surface.free_node[node] {
                    None => row.unknown[node] += half,
                    Some(number) => row.given[number] -= half,
                },
                Side::Air(weight) => {
                    row.unknown[node] += half;
                    if surface.free[panel]
                        && let Some(number) = surface.free_node[node]
                    {
                        row.given[number] -= weight * half;
                    }
                }
            }
        }
    }

    /// Solves for a field that comes from elsewhere, and for what is given on the free surface: pressure in water,
    /// normal derivative in air.
    pub fn solve(
        &self,
        incident: Option<&(dyn Fn(Point, Point) -> Value + Sync)>,
        given: Option<&Nodal>,
    ) -> Solution<'_, 'a> {
        let surface = self.surface;
        let images = images(surface.mirrors);
        let share = 1.0 / images.len() as f64;
        let mut right: Nodal = vec![vec![ZERO; surface.nodes.len()]; self.parities.len()];
        if let Some(incident) = incident {
            for (index, (panel, nodes)) in surface.panels.iter().zip(&surface.corners).enumerate() {
                for (point, hats) in panel.samples.iter().zip(&HATS) {
                    let seen: Vec<c64> = images
                        .iter()
                        .map(|signs| {
                            let field =
                                incident(reflect(*point, *signs), reflect(panel.normal, *signs));
                            match self.side {
                                Side::Water => field.pressure,
                                Side::Air(weight) => field.pressure + weight * field.slope,
                            }
                        })
                        .collect();
                    for (right, parity) in right.iter_mut().zip(&self.parities) {
                        let parts = seen.iter().zip(&parity.signs);
                        let value: c64 = parts.map(|(seen, sign)| *seen * *sign).sum();
                        for (node, hat) in nodes.iter().zip(hats) {
                            if self.tests(index, *node) {
                                right[*node] += value * (share * hat * panel.area / 3.0);
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
        self.radiated_by([(&self.unknown, &self.given)], x)[0]
    }

    fn radiated_by<const N: usize>(&self, values: [(&Nodal, &Nodal); N], x: Point) -> [c64; N] {
        let problem = self.problem;
        let surface = problem.surface;
        let mut sums = [ZERO; N];
        // Normals of the field point do not matter: only Air's derivative would use one, with no weight here.
        let plain = Problem {
            side: match problem.side {
                Side::Water => Side::Water,
                Side::Air(_) => Side::Air(ZERO),
            },
            parities: Vec::new(),
            systems: Vec::new(),
            surface,
            k: problem.k,
        };
        for (image, signs) in images(surface.mirrors).into_iter().enumerate() {
            let row = plain.row(reflect(x, signs), [0.0; 3]);
            for (parity, kind) in problem.parities.iter().enumerate() {
                let sign = kind.signs[image];
                for (sum, (unknown, given)) in sums.iter_mut().zip(&values) {
                    let product = |a: &[c64], b: &[c64]| -> c64 {
                        a.iter().zip(b).map(|(a, b)| *a * *b).sum()
                    };
                    // The row says: unknown's part = given's part + incident. Radiated is what is left.
                    let total =
                        product(&row.given, &given[parity]) - product(&row.unknown, &unknown[parity]);
                    *sum += total * sign;
                }
            }
        }
        sums
    }

    /// How far the field at the surface is from what the boundary says, at the middle of every panel, a point that
    /// no equation used: the rms over the surface, relative to that of what drives it.
    pub fn residual(&self, incident: Option<&(dyn Fn(Point, Point) -> Value + Sync)>) -> f64 {
        let problem = self.problem;
        let surface = problem.surface;
        let none = vec![vec![ZERO; surface.nodes.len()]; problem.parities.len()];
        let parts: Vec<(f64, f64)> = (0..surface.panels.len())
            .into_par_iter()
            .map(|index| {
                let panel = &surface.panels[index];
                images(surface.mirrors)
                    .into_iter()
                    .map(|signs| {
                        let x = reflect(panel.centre, signs);
                        let pairs = [(&self.unknown, &self.given), (&none, &self.given)];
                        let [radiated, driven] = self.radiated_by(pairs, x);
                        let comes = incident.map_or(ZERO, |incident| {
                            incident(x, reflect(panel.normal, signs)).pressure
                        });
                        let (own, given) = self.own(index, signs);
                        let off = radiated + comes - own * 0.5;
                        let drive = match problem.side {
                            // Given pressure drives as itself.
                            Side::Water => comes + given,
                            Side::Air(_) => comes + driven,
                        };
                        (off.norm_sqr() * panel.area, drive.norm_sqr() * panel.area)
                    })
                    .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1))
            })
            .collect();
        let (off, drive) = parts
            .iter()
            .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (off / drive.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// The pressure at the middle of a panel's reflection, and what of it is given.
    fn own(&self, panel: usize, signs: [f64; 2]) -> (c64, c64) {
        let problem = self.problem;
        let surface = problem.surface;
        let all = images(surface.mirrors);
        let image = all.iter().position(|s| *s == signs).unwrap_or(0);
        let (mut own, mut given) = (ZERO, ZERO);
        for (parity, kind) in problem.parities.iter().enumerate() {
            let sign = kind.signs[image] / 3.0;
            for &node in &surface.corners[panel] {
                match (problem.side, surface.free_node[node]) {
                    (Side::Water, Some(number)) => {
                        own += self.given[parity][number] * sign;
                        given += self.given[parity][number] * sign;
                    }
                    _ => own += self.unknown[parity][node] * sign,
                }
            }
        }
        (own, given)
    }
}

/// ∫ λ_j ∂G/∂n_y.
fn double(seen: &Integrals, normal: Point, j: usize) -> c64 {
    -along(&seen.gradient[j], normal)
}

fn along(gradient: &[c64; 3], direction: Point) -> c64 {
    gradient[0] * direction[0] + gradient[1] * direction[1] + gradient[2] * direction[2]
}

/// ∂/∂n_x ∫ λ_j ∂G/∂n_y, integrated by parts (Maue): the line integrals cancel between neighbours.
fn hypersingular(
    seen: &Integrals,
    panel: &super::panel::Panel,
    normal: Point,
    k: f64,
) -> [c64; 3] {
    let total: [c64; 3] = std::array::from_fn(|axis| {
        seen.gradient[0][axis] + seen.gradient[1][axis] + seen.gradient[2][axis]
    });
    let facing = k * k * dot(normal, panel.normal);
    std::array::from_fn(|j| {
        // n·(∇G × c) = ∇G·(c × n).
        along(&total, cross(panel.curls[j], normal)) + seen.single[j] * facing
    })
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
