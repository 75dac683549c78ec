//! The exact projection: pressure that leaves no divergence, by Fourier transforms across and a tridiagonal solve (or a
//! third transform) along the flow.

use std::f64::consts::TAU;
use std::sync::Arc;

use rustfft::{Fft, FftPlanner, num_complex::Complex};

use super::grid::{Ends, Grid};

type C = Complex<f64>;

/// Solves ∇²φ = ∇·v on a grid and takes ∇φ off v.
pub struct Projection {
    grid: Grid,
    /// Two transforms an axis: there and back.
    fft: [[Arc<dyn Fft<f64>>; 2]; 3],
    /// Open ends: the two factors of the tridiagonal solve, for each cell. Periodic: minus the reciprocal eigenvalues.
    factor: Vec<f64>,
    phi: Vec<C>,
    line: Vec<C>,
    scratch: Vec<C>,
}

impl Projection {
    /// Plans it.
    pub fn new(grid: Grid) -> Self {
        let mut planner = FftPlanner::new();
        let fft = grid
            .cells
            .map(|n| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)]);
        let [nx, ny, nz] = grid.cells;
        // Eigenvalue of the second difference.
        let eigen = |m: usize, n: usize| 2.0 - 2.0 * (TAU * m as f64 / n as f64).cos();
        let layer = grid.layer();
        let mut factor = vec![0.0; layer * nz];
        for mode in 0..layer {
            let across = eigen(mode % nx, nx) + eigen(mode / nx, ny);
            match grid.ends {
                Ends::Periodic => {
                    for k in 0..nz {
                        let all = across + eigen(k, nz);
                        // The mean of a pressure is nobody's business.
                        let inverse = if all > 1e-12 { 1.0 / all } else { 0.0 };
                        factor[k * layer + mode] = -inverse;
                    }
                }
                Ends::Open => {
                    // φ_{k−1} − (across + 2)·φ_k + φ_{k+1}; no slope below, φ = 0 above (Thomas).
                    let mut before = 0.0;
                    for k in 0..nz {
                        let diagonal = across + if k == 0 { 1.0 } else { 2.0 };
                        before = 1.0 / (diagonal - before);
                        factor[k * layer + mode] = before;
                    }
                }
            }
        }
        let most = nx.max(ny).max(nz);
        let scratch = fft
            .iter()
            .flatten()
            .map(|fft| fft.get_inplace_scratch_len());
        let scratch = scratch.max().unwrap_or(0);
        Self {
            grid,
            fft,
            factor,
            phi: vec![C::default(); layer * nz],
            line: vec![C::default(); most],
            scratch: vec![C::default(); scratch],
        }
    }

    /// Makes `velocity` free of divergence; the layers beyond the ends are not touched.
    pub fn project(&mut self, velocity: &mut [Vec<f64>; 3]) {
        let grid = self.grid;
        let [nx, ny, nz] = grid.cells;
        let layer = grid.layer();
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    let at = grid.at(i, j, k) - layer;
                    self.phi[at] = C::new(divergence(&grid, velocity, i, j, k), 0.0);
                }
            }
        }
        self.across(0);
        match grid.ends {
            Ends::Periodic => {
                self.lines(2, 0);
                for (phi, factor) in self.phi.iter_mut().zip(&self.factor) {
                    *phi *= *factor;
                }
                self.lines(2, 1);
            }
            Ends::Open => {
                for k in 0..nz {
                    let (done, rest) = self.phi.split_at_mut(k * layer);
                    let before = k.checked_sub(1).map(|k| &done[k * layer..]);
                    for (mode, phi) in rest[..layer].iter_mut().enumerate() {
                        let below = before.map_or(C::default(), |before| before[mode]);
                        *phi = (below - *phi) * self.factor[k * layer + mode];
                    }
                }
                for k in (0..nz - 1).rev() {
                    let (below, above) = self.phi.split_at_mut((k + 1) * layer);
                    let factor = &self.factor[k * layer..];
                    for (mode, phi) in below[k * layer..].iter_mut().enumerate() {
                        *phi += above[mode] * factor[mode];
                    }
                }
            }
        }
        self.across(1);
        // The transforms come back larger by their lengths.
        let depth = if grid.ends == Ends::Periodic { nz } else { 1 };
        let size = 1.0 / (layer * depth) as f64;
        for (component, field) in velocity.iter_mut().enumerate() {
            for k in grid.moved(component) {
                for j in 0..ny {
                    for i in 0..nx {
                        let inside = |i: usize, j: usize, k: usize| {
                            self.phi
                                .get((k * ny + j) * nx + i)
                                .map_or(0.0, |phi| phi.re)
                        };
                        let before = match component {
                            0 => inside((i + nx - 1) % nx, j, k),
                            1 => inside(i, (j + ny - 1) % ny, k),
                            _ if k == 0 => inside(i, j, nz - 1),
                            _ => inside(i, j, k - 1),
                        };
                        field[grid.at(i, j, k)] -= (inside(i, j, k) - before) * size;
                    }
                }
            }
        }
    }

    /// Transforms along x and y.
    fn across(&mut self, back: usize) {
        let nx = self.grid.cells[0];
        let fft = &self.fft[0][back];
        for line in self.phi.chunks_exact_mut(nx) {
            fft.process_with_scratch(line, &mut self.scratch);
        }
        self.lines(1, back);
    }

    /// Transforms along `axis`, line by line.
    fn lines(&mut self, axis: usize, back: usize) {
        let [nx, ny, nz] = self.grid.cells;
        let (n, stride) = if axis == 1 { (ny, nx) } else { (nz, nx * ny) };
        let fft = &self.fft[axis][back];
        let line = &mut self.line[..n];
        for start in 0..self.phi.len() / n {
            let start = start / stride * stride * n + start % stride;
            for (m, x) in line.iter_mut().enumerate() {
                *x = self.phi[start + m * stride];
            }
            fft.process_with_scratch(line, &mut self.scratch);
            for (m, x) in line.iter().enumerate() {
                self.phi[start + m * stride] = *x;
            }
        }
    }
}

/// What flows out of a cell, as a speed: the divergence times h.
pub fn divergence(grid: &Grid, v: &[Vec<f64>; 3], i: usize, j: usize, k: usize) -> f64 {
    let [nx, ny, nz] = grid.cells;
    let at = grid.at(i, j, k);
    let right = grid.at((i + 1) % nx, j, k);
    let behind = grid.at(i, (j + 1) % ny, k);
    let above = match grid.ends {
        Ends::Periodic if k + 1 == nz => grid.at(i, j, 0),
        _ => at + grid.layer(),
    };
    v[0][right] - v[0][at] + v[1][behind] - v[1][at] + v[2][above] - v[2][at]
}
