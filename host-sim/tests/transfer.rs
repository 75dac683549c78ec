//! Transfer against exact solutions, both ways against each other, and what the command says.

use std::f64::consts::PI;

use faer::c64;
use freshet_host::transfer::point::Point;
use freshet_host::transfer::shape::Shape;
use freshet_host::transfer::solver::Solver;
use freshet_host::transfer::vessel;

/// Terms of a series: far more than kL = 10 asks for.
const TERMS: usize = 60;

/// Spherical Bessel functions j_l(z) and h_l⁽²⁾(z) = j_l − i y_l, with their derivatives.
struct Spherical {
    j: Vec<f64>,
    dj: Vec<f64>,
    h: Vec<c64>,
    dh: Vec<c64>,
}

impl Spherical {
    fn new(z: f64) -> Self {
        // Miller: downwards from where it does not matter, then to the scale of j_0 or j_1.
        let start = TERMS + 40 + z as usize;
        let mut j = vec![0.0; start + 2];
        j[start] = 1e-200;
        for l in (1..=start).rev() {
            j[l - 1] = (2 * l + 1) as f64 / z * j[l] - j[l + 1];
            if j[l - 1].abs() > 1e200 {
                j[l - 1..].iter_mut().for_each(|x| *x *= 1e-250);
            }
        }
        let (j0, j1) = (z.sin() / z, z.sin() / (z * z) - z.cos() / z);
        let scale = if j0.abs() > j1.abs() { j0 / j[0] } else { j1 / j[1] };
        j.iter_mut().for_each(|x| *x *= scale);
        let mut y = vec![-z.cos() / z, -z.cos() / (z * z) - z.sin() / z];
        for l in 1..=TERMS {
            y.push((2 * l + 1) as f64 / z * y[l] - y[l - 1]);
        }
        let slope = |f: &[f64], l: usize| l as f64 / z * f[l] - f[l + 1];
        let dj: Vec<f64> = (0..TERMS).map(|l| slope(&j, l)).collect();
        Spherical {
            h: (0..TERMS).map(|l| c64::new(j[l], -y[l])).collect(),
            dh: (0..TERMS).map(|l| c64::new(dj[l], -slope(&y, l))).collect(),
            dj,
            j,
        }
    }
}

fn legendre(x: f64) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for l in 1..TERMS {
        p.push(((2 * l + 1) as f64 * x * p[l] - l as f64 * p[l - 1]) / (l + 1) as f64);
    }
    p
}

fn norm(a: Point) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn cosine(a: Point, b: Point) -> f64 {
    let dot: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
    dot / (norm(a) * norm(b)).max(1e-300)
}

fn wavenumbers(frequency: f64) -> (f64, f64) {
    (2.0 * PI * frequency / 1497.0, 2.0 * PI * frequency / 343.0)
}

/// P/S_b of a bubble in a spherical drop: Dirichlet inside, the modes of the sphere outside.
fn drop_series(radius: f64, bubble: Point, ear: Point, frequency: f64) -> c64 {
    let (kw, ka) = wavenumbers(frequency);
    let p = legendre(cosine(bubble, ear));
    let (inside, surface) = (
        Spherical::new((kw * norm(bubble)).max(1e-9)),
        Spherical::new(kw * radius),
    );
    let (outside, far) = (Spherical::new(ka * radius), Spherical::new(ka * norm(ear)));
    let terms = if norm(bubble) == 0.0 { 1 } else { TERMS };
    (0..terms)
        .map(|l| {
            // Flow through the surface, then the pressure it makes.
            let flow = (2 * l + 1) as f64 / (4.0 * PI * radius * radius) * inside.j[l] / surface.j[l];
            far.h[l] / (outside.dh[l] * ka) * flow * p[l]
        })
        .take_while(|term| term.re.is_finite())
        .sum()
}

/// The pressure of a unit source at `from` with a rigid sphere at the origin.
fn sphere_series(radius: f64, from: Point, at: Point, frequency: f64) -> c64 {
    let (_, k) = wavenumbers(frequency);
    let p = legendre(cosine(from, at));
    let (near, far) = if norm(from) < norm(at) { (from, at) } else { (at, from) };
    let (near, far) = (Spherical::new(k * norm(near)), Spherical::new(k * norm(far)));
    let surface = Spherical::new(k * radius);
    (0..TERMS)
        .map(|l| {
            let scattered = near.h[l] / surface.dh[l] * surface.dj[l];
            let radial = far.h[l] * (-scattered + near.j[l]);
            radial * c64::new(0.0, -k / (4.0 * PI) * (2 * l + 1) as f64) * p[l]
        })
        .take_while(|term| term.re.is_finite())
        .sum()
}

fn off(found: c64, exact: c64) -> f64 {
    (found - exact).norm() / exact.norm()
}

#[test]
fn explore() {
    for name in ["glass", "tank"] {
        let shape = vessel::Vessel::open(std::path::Path::new(&format!("../vessels/{name}.toml"))).unwrap().shape().unwrap();
        let b = std::time::Instant::now();
        let solver = Solver::new(&shape, 1500.0).unwrap();
        println!("factor {:.2}", b.elapsed().as_secs_f64());
        let b = std::time::Instant::now();
        let field = solver.hear([0.3, 0.2, 0.4]).unwrap();
        println!("hear {:.2}", b.elapsed().as_secs_f64());
        let b = std::time::Instant::now();
        println!("{:?}", field.residual([0.0, 0.0, 0.02]));
        println!("residual {:.2}", b.elapsed().as_secs_f64());
        let b = std::time::Instant::now();
        let many = vec![[0.0, 0.01, 0.02]; 4800];
        field.at(&many).unwrap();
        println!("4800 {:.2}", b.elapsed().as_secs_f64());
    }
}
