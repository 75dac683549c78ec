//! A flat triangle that radiates: integrals of the Helmholtz kernel `G = e^{−ikR}/(4πR)` and of its
//! derivative along the panel's normal, against the three hat functions λ.
//!
//! Far from the triangle three points on it stand for it. Near it the static part is exact (Wilton et al.
//! 1984; Graglia 1993), and the three points only carry the smooth rest.

use std::f64::consts::PI;

use faer::c64;

use super::point::{Point, add, cross, distance, dot, norm, scale, sub};

/// Hat functions at the three points of a panel: exact for polynomials of degree 2.
pub const HATS: [[f64; 3]; 3] = [
    [2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0],
    [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
    [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0],
];

/// Nearer than so many longest edges the static part is exact.
const NEAR: f64 = 2.5;

/// A triangle, seen counter-clockwise from where its normal points.
#[derive(Clone, Debug)]
pub struct Panel {
    pub corners: [Point; 3],
    pub normal: Point,
    pub area: f64,
    pub centre: Point,
    /// The longest edge.
    pub size: f64,
    /// Three points, a third of the area each.
    pub samples: [Point; 3],
    /// n × ∇λ of each hat function, 1/m.
    pub curls: [Point; 3],
    gradients: [Point; 3],
    /// Of each edge: its direction, and outward in the plane.
    edges: [(Point, Point); 3],
}

/// Integrals over a panel for one field point x.
#[derive(Clone, Copy, Debug, Default)]
pub struct Integrals {
    /// ∫ λ_j G, m.
    pub single: [c64; 3],
    /// ∫ λ_j ∂G/∂n_y.
    pub double: [c64; 3],
}

impl Panel {
    pub fn new(corners: [Point; 3]) -> Self {
        let [a, b, c] = corners;
        let double = cross(sub(b, a), sub(c, a));
        let area = 0.5 * norm(double);
        let normal = scale(double, 0.5 / area);
        let opposite = [sub(c, b), sub(a, c), sub(b, a)];
        let gradients = opposite.map(|edge| scale(cross(normal, edge), 0.5 / area));
        let weigh = |[p, q, r]: [f64; 3]| add(add(scale(a, p), scale(b, q)), scale(c, r));
        Panel {
            corners,
            normal,
            area,
            centre: weigh([1.0 / 3.0; 3]),
            size: opposite.iter().map(|edge| norm(*edge)).fold(0.0, f64::max),
            samples: HATS.map(weigh),
            curls: gradients.map(|gradient| cross(normal, gradient)),
            gradients,
            edges: [(a, b), (b, c), (c, a)].map(|(from, to)| {
                let along = scale(sub(to, from), 1.0 / distance(from, to));
                (along, cross(along, normal))
            }),
        }
    }

    /// The integrals seen from `x`, wavenumber `k` in 1/m.
    pub fn integrals(&self, x: Point, k: f64) -> Integrals {
        let apart = sub(x, self.centre);
        let near = dot(apart, apart) < (NEAR * self.size).powi(2);
        let mut sum = if near {
            self.stationary(x)
        } else {
            Integrals::default()
        };
        let weight = self.area / (12.0 * PI);
        // n·(y − x) is the same all over the panel.
        let height = weight * dot(self.normal, apart);
        for (y, hats) in self.samples.iter().zip(&HATS) {
            let r = distance(*y, x);
            let (single, radial) = if near { rest(r, k) } else { kernel(r, k) };
            let (single, double) = (single * weight, radial * height);
            for (j, hat) in hats.iter().enumerate() {
                sum.single[j] += single * *hat;
                sum.double[j] += double * *hat;
            }
        }
        sum
    }

    /// Points, hat functions and areas that integrate what a source `apart` from the middle brings: finer where the
    /// source is near.
    pub fn points(&self, apart: f64) -> Vec<(Point, [f64; 3], f64)> {
        let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut parts = vec![unit];
        let mut size = self.size;
        for _ in 0..4 {
            if apart > NEAR * size {
                break;
            }
            size *= 0.5;
            parts = parts.into_iter().flat_map(quarters).collect();
        }
        let area = self.area / (3 * parts.len()) as f64;
        let weigh = |hats: &[f64; 3], corners: &[Point; 3]| -> Point {
            std::array::from_fn(|axis| (0..3).map(|i| hats[i] * corners[i][axis]).sum())
        };
        parts
            .iter()
            .flat_map(|part| HATS.map(|hats| weigh(&hats, part)))
            .map(|hats| (weigh(&hats, &self.corners), hats, area))
            .collect()
    }

    /// The solid angle under which `x` sees the panel, positive from behind.
    pub fn solid_angle(&self, x: Point) -> f64 {
        let [a, b, c] = self.corners.map(|corner| sub(corner, x));
        let (ra, rb, rc) = (norm(a), norm(b), norm(c));
        // Van Oosterom & Strackee 1983.
        let volume = dot(a, cross(b, c));
        2.0 * volume.atan2(ra * rb * rc + dot(a, b) * rc + dot(b, c) * ra + dot(c, a) * rb)
    }

    /// The integrals for k = 0.
    fn stationary(&self, x: Point) -> Integrals {
        let height = dot(self.normal, sub(x, self.corners[0]));
        let angle = if height.abs() < 1e-9 * self.size {
            // In the plane: the principal value.
            0.0
        } else {
            self.solid_angle(x)
        };
        let foot = sub(x, scale(self.normal, height));
        // ∫ 1/R; ∫ ρ/R and −∫ ρ/R³ with ρ in the plane from the foot.
        let mut inverse = height * angle;
        let (mut moment, mut slope) = ([0.0; 3], [0.0; 3]);
        for (i, (along, outward)) in self.edges.iter().enumerate() {
            let (from, to) = (sub(self.corners[i], x), sub(self.corners[(i + 1) % 3], x));
            let (s, e) = (dot(from, *along), dot(to, *along));
            let (rs, re) = (norm(from), norm(to));
            let side = dot(from, *outward);
            // The form that does not cancel.
            let ratio = if s + e > 0.0 {
                (re + e) / (rs + s).max(f64::MIN_POSITIVE)
            } else {
                (rs - s) / (re - e).max(f64::MIN_POSITIVE)
            };
            let log = ratio.ln();
            inverse += side * log;
            let square = side * side + height * height;
            moment = add(
                moment,
                scale(*outward, 0.5 * (square * log + e * re - s * rs)),
            );
            slope = add(slope, scale(*outward, log));
        }
        let unit = 1.0 / (4.0 * PI);
        let mut sum = Integrals::default();
        for (j, gradient) in self.gradients.iter().enumerate() {
            let value = if j == 0 { 1.0 } else { 0.0 } + dot(*gradient, sub(foot, self.corners[0]));
            let single = value * inverse + dot(*gradient, moment);
            // ∂/∂n_y (1/R) = height/R³.
            let double = -value * angle - height * dot(*gradient, slope);
            sum.single[j] = c64::new(unit * single, 0.0);
            sum.double[j] = c64::new(unit * double, 0.0);
        }
        sum
    }
}

/// A triangle cut into four.
fn quarters([a, b, c]: [Point; 3]) -> [[Point; 3]; 4] {
    let middle = |p: Point, q: Point| scale(add(p, q), 0.5);
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// 4πG and the factor of `x − y` in 4π∇_y G, at distance R.
pub fn kernel(r: f64, k: f64) -> (c64, c64) {
    let (sin, cos) = (k * r).sin_cos();
    let single = c64::new(cos / r, -sin / r);
    (single, single * c64::new(1.0, k * r) * (1.0 / (r * r)))
}

/// The same without the static part; finite at R = 0, where the direction does not matter.
fn rest(r: f64, k: f64) -> (c64, c64) {
    if k * r < 1e-3 {
        let radial = if r > 0.0 { 0.5 * k * k / r } else { 0.0 };
        return (
            c64::new(-0.5 * k * k * r, -k),
            c64::new(radial, -k * k * k / 3.0),
        );
    }
    let (single, radial) = kernel(r, k);
    (
        single - c64::new(1.0 / r, 0.0),
        radial - c64::new(1.0 / (r * r * r), 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the three-point rule on a panel cut into 4^n pieces.
    fn by_parts(corners: [Point; 3], hats: [[f64; 3]; 3], x: Point, k: f64, n: usize) -> Integrals {
        let mut sum = Integrals::default();
        if n > 0 {
            for (corners, hats) in quarters(corners).into_iter().zip(quarters(hats)) {
                let part = by_parts(corners, hats, x, k, n - 1);
                for j in 0..3 {
                    sum.single[j] += part.single[j];
                    sum.double[j] += part.double[j];
                }
            }
            return sum;
        }
        let panel = Panel::new(corners);
        for (y, at) in panel.samples.iter().zip(&HATS) {
            let (single, radial) = kernel(distance(*y, x), k);
            let height = dot(panel.normal, sub(x, *y));
            for (j, (to, double)) in sum.single.iter_mut().zip(&mut sum.double).enumerate() {
                let hat: f64 = at.iter().zip(&hats).map(|(at, hats)| at * hats[j]).sum();
                let weight = hat * panel.area / (12.0 * PI);
                *to += single * weight;
                *double += radial * (height * weight);
            }
        }
        sum
    }

    #[test]
    fn near_a_panel_the_integrals_are_those_of_many_small_ones() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2], [0.2, 0.9, -0.1]];
        let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let panel = Panel::new(corners);
        for x in [
            [0.3, 0.3, 0.4],
            [0.4, 0.3, -0.3],
            [1.4, 0.2, 0.1],
            [-0.5, -0.6, 0.2],
        ] {
            let exact = by_parts(corners, unit, x, 0.5, 7);
            let found = panel.integrals(x, 0.5);
            for j in 0..3 {
                assert!(
                    (found.single[j] - exact.single[j]).norm() < 2e-4,
                    "{x:?} {j}"
                );
                let off = found.double[j] - exact.double[j];
                assert!(off.norm() < 5e-4, "{x:?} {j}: {off}");
            }
        }
    }
}
