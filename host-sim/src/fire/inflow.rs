//! What flows in: a mean speed and random eddies that it carries along, frozen (Kraichnan's sum of solenoidal waves).
//!
//! A continuous function of place and time, so that the inflow adds no noise of its own to the sound, and a step can be
//! taken again after an interruption.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use super::grid::Grid;
use crate::cloud::synthetic::Random;

type C = Complex<f64>;

/// Waves that share their lengths across the flow.
const ALONG: usize = 6;
/// Shortest wave, cells.
const SHORTEST: f64 = 4.0;

/// Eddies carried into the box.
pub struct Inflow {
    /// Mean speed, m/s.
    pub speed: f64,
    grid: Grid,
    waves: Vec<Wave>,
    /// e^{2πi·ax/n} at faces and middles of cells.
    phase: [[Vec<C>; 2]; 2],
}

/// Waves of one length across.
struct Wave {
    /// Periods across the box.
    across: [i32; 2],
    /// Wave number along the flow, 1/m, and amplitude of each component.
    along: Vec<(f64, [C; 3])>,
}

impl Inflow {
    /// Eddies of about `eddy` metres, whose components have an rms of `part` of the speed.
    pub fn new(grid: Grid, speed: f64, part: f64, eddy: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let normal = |random: &mut Random| {
            let size = (-2.0 * (1.0 - random.unit()).ln()).sqrt();
            C::from_polar(size, TAU * random.unit())
        };
        let size = [0, 1].map(|axis| grid.cells[axis] as f64 * grid.h);
        let (peak, last) = (TAU / eddy, TAU / (SHORTEST * grid.h));
        let most = size.map(|size| (last * size / TAU) as i32);
        let mut waves = Vec::new();
        let mut energy = 0.0;
        for a in 0..=most[0] {
            for b in -most[1]..=most[1] {
                let k = [TAU * f64::from(a) / size[0], TAU * f64::from(b) / size[1]];
                let across = k[0].hypot(k[1]);
                // The mean flow is no eddy, and a wave is its own mirror image.
                if (a == 0 && b <= 0) || across >= last {
                    continue;
                }
                let reach = (last * last - across * across).sqrt();
                let mut along = Vec::new();
                for n in 0..ALONG {
                    // Spread over the reach, at random, so that no two ever come round together.
                    let part = (n as f64 + random.unit()) / ALONG as f64;
                    let k = [k[0], k[1], reach * (2.0 * part - 1.0)];
                    let square: f64 = k.iter().map(|k| k * k).sum();
                    // Energy a volume of wave numbers: E(k)/k², E ∝ k⁴/(1 + (k/k₀)²)^{17/6} (von Kármán).
                    let ratio = square / (peak * peak);
                    let power = ratio / (1.0 + ratio).powf(17.0 / 6.0) * reach;
                    let wild = [(); 3].map(|()| normal(&mut random) * power.sqrt());
                    let flux: C = (0..3).map(|c| wild[c] * k[c]).sum::<C>() / square;
                    let amplitude = [0, 1, 2].map(|c| wild[c] - flux * k[c]);
                    energy += amplitude.iter().map(C::norm_sqr).sum::<f64>() / 2.0;
                    along.push((k[2], amplitude));
                }
                waves.push(Wave {
                    across: [a, b],
                    along,
                });
            }
        }
        let rms = (energy / 3.0).sqrt();
        let gain = if rms > 0.0 { part * speed / rms } else { 0.0 };
        for (_, amplitude) in waves.iter_mut().flat_map(|wave| &mut wave.along) {
            *amplitude = amplitude.map(|x| x * gain);
        }
        let phase = [0, 1].map(|axis| {
            let n = grid.cells[axis];
            [0.0, 0.5].map(|middle| {
                let turn = |i: usize| C::from_polar(1.0, TAU * (i as f64 + middle) / n as f64);
                (0..n).map(turn).collect()
            })
        });
        Self {
            speed,
            grid,
            waves,
            phase,
        }
    }

    /// What flows in at time `t`: both outer layers of the lower end, the second one of component 2 alone.
    pub fn fill(&self, velocity: &mut [Vec<f64>; 3], t: f64) {
        for (component, field) in velocity.iter_mut().enumerate() {
            let layers = if component == 2 { 2 } else { 1 };
            for layer in 0..layers {
                self.layer(field, component, layer, t);
            }
        }
    }

    /// The whole box full of it, as if nothing but the mean flow carried it.
    pub fn fill_box(&self, velocity: &mut [Vec<f64>; 3], t: f64) {
        for (component, field) in velocity.iter_mut().enumerate() {
            for layer in 0..self.grid.cells[2] + 2 {
                self.layer(field, component, layer, t);
            }
        }
    }

    fn layer(&self, field: &mut [f64], component: usize, layer: usize, t: f64) {
        let [nx, ny, _] = self.grid.cells;
        let place = Grid::place(component, 0, 0, 0);
        // Frozen eddies: what is here now was further down before.
        let z = (layer as f64 - 1.0 + place[2]) * self.grid.h - self.speed * t;
        let out = &mut field[layer * nx * ny..][..nx * ny];
        out.fill(if component == 2 { self.speed } else { 0.0 });
        let [px, py] = [0, 1].map(|axis| &self.phase[axis][usize::from(place[axis] > 0.0)]);
        // e^{i·a·x} by its index: exact powers of a root of one, but for the half cell.
        let power = |phase: &[C], i: usize, a: i32| phase[i].powi(a);
        let mut row = vec![C::default(); nx];
        for wave in &self.waves {
            let sum: C = wave
                .along
                .iter()
                .map(|(k, amplitude)| amplitude[component] * C::from_polar(1.0, k * z))
                .sum();
            for (i, x) in row.iter_mut().enumerate() {
                *x = power(px, i, wave.across[0]);
            }
            for j in 0..ny {
                let sum = sum * power(py, j, wave.across[1]);
                for (out, x) in out[j * nx..][..nx].iter_mut().zip(&row) {
                    *out += sum.re * x.re - sum.im * x.im;
                }
            }
        }
    }
}
