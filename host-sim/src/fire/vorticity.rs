//! The curl of a flow in the middle of its cells, and the confinement that keeps its small eddies (Fedkiw 2001 §5).

use super::grid::{Ends, Grid};

/// ω in the middle of each cell, three components, as fields without the layers beyond the ends.
pub fn vorticity(grid: &Grid, v: &[Vec<f64>; 3], out: &mut [Vec<f64>; 3]) {
    let [nx, ny, nz] = grid.cells;
    let layer = grid.layer();
    let half = 0.5 / grid.h;
    for k in 0..nz {
        for j in 0..ny {
            let (before, behind) = ((j + ny - 1) % ny, (j + 1) % ny);
            for i in 0..nx {
                let (left, right) = ((i + nx - 1) % nx, (i + 1) % nx);
                let at = grid.at(i, j, k);
                let [l, r] = [left, right].map(|i| grid.at(i, j, k));
                let [f, b] = [before, behind].map(|j| grid.at(i, j, k));
                let [d, u] = [at - layer, at + layer];
                let (rb, rf) = (grid.at(right, behind, k), grid.at(right, before, k));
                let lb = grid.at(left, behind, k);
                // In the middle of a cell a component is the mean of its two faces; differences over two cells.
                let mid = |c: usize, a: usize, b: usize| 0.5 * (v[c][a] + v[c][b]);
                let dwdy = mid(2, b, b + layer) - mid(2, f, f + layer);
                let dvdz = mid(1, u, b + layer) - mid(1, d, b - layer);
                let dudz = mid(0, u, r + layer) - mid(0, d, r - layer);
                let dwdx = mid(2, r, r + layer) - mid(2, l, l + layer);
                let dvdx = mid(1, r, rb) - mid(1, l, lb);
                let dudy = mid(0, b, rb) - mid(0, f, rf);
                let cell = at - layer;
                out[0][cell] = (dwdy - dvdz) * half;
                out[1][cell] = (dudz - dwdx) * half;
                out[2][cell] = (dvdx - dudy) * half;
            }
        }
    }
}

/// The confining acceleration ε·h·(N × ω) in the middle of each cell, N along the slope of |ω|; ε in m/s.
pub fn confinement(
    grid: &Grid,
    omega: &[Vec<f64>; 3],
    epsilon: f64,
    size: &mut [f64],
    out: &mut [Vec<f64>; 3],
) {
    let [nx, ny, nz] = grid.cells;
    let layer = grid.layer();
    for (at, size) in size.iter_mut().enumerate() {
        *size = (omega[0][at].powi(2) + omega[1][at].powi(2) + omega[2][at].powi(2)).sqrt();
    }
    for k in 0..nz {
        let (below, above) = match grid.ends {
            Ends::Periodic => ((k + nz - 1) % nz, (k + 1) % nz),
            Ends::Open => (k.saturating_sub(1), (k + 1).min(nz - 1)),
        };
        // Nothing pushes on what flows in and out.
        let here = match grid.ends {
            Ends::Open if k == 0 || k + 2 > nz => 0.0,
            _ => epsilon * grid.h,
        };
        for j in 0..ny {
            for i in 0..nx {
                let cell = |i: usize, j: usize, k: usize| (k * ny + j) * nx + i;
                let at = k * layer + j * nx + i;
                let slope = [
                    size[cell((i + 1) % nx, j, k)] - size[cell((i + nx - 1) % nx, j, k)],
                    size[cell(i, (j + 1) % ny, k)] - size[cell(i, (j + ny - 1) % ny, k)],
                    size[cell(i, j, above)] - size[cell(i, j, below)],
                ];
                let length = slope.iter().map(|x| x * x).sum::<f64>().sqrt();
                let gain = if length > 0.0 { here / length } else { 0.0 };
                let w = [omega[0][at], omega[1][at], omega[2][at]];
                out[0][at] = gain * (slope[1] * w[2] - slope[2] * w[1]);
                out[1][at] = gain * (slope[2] * w[0] - slope[0] * w[2]);
                out[2][at] = gain * (slope[0] * w[1] - slope[1] * w[0]);
            }
        }
    }
}
