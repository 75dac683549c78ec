//! How the energy of a flow is spread over sizes of eddies: shells of wave numbers across the flow, half way up.

use rustfft::{FftPlanner, num_complex::Complex};
use serde::{Deserialize, Serialize};

use super::flow::Fields;
use super::grid::Grid;

/// A mean over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergySpectrum {
    sum: Vec<f64>,
    count: u32,
}

impl EnergySpectrum {
    /// Of nothing yet.
    pub fn new(grid: &Grid) -> Self {
        let [nx, ny, _] = grid.cells;
        Self {
            sum: vec![0.0; nx.min(ny) / 2 + 1],
            count: 0,
        }
    }

    /// Takes the velocities of the middle layer, m/s.
    pub fn add(&mut self, grid: &Grid, velocity: &Fields) {
        let [nx, ny, nz] = grid.cells;
        let mut planner = FftPlanner::new();
        let (along, across) = (planner.plan_fft_forward(nx), planner.plan_fft_forward(ny));
        let size = 1.0 / (nx * ny) as f64;
        for field in velocity {
            let start = grid.at(0, 0, nz / 2);
            let layer = field[start..start + nx * ny].iter();
            let mut plane: Vec<Complex<f64>> = layer.map(|v| Complex::new(v * size, 0.0)).collect();
            along.process(&mut plane);
            for i in 0..nx {
                let mut line: Vec<_> = (0..ny).map(|j| plane[j * nx + i]).collect();
                across.process(&mut line);
                for (j, x) in line.iter().enumerate() {
                    // Periods across the narrower side.
                    let [a, b] = [(i, nx), (j, ny)]
                        .map(|(i, n)| i.min(n - i) as f64 * nx.min(ny) as f64 / n as f64);
                    let shell = a.hypot(b).round() as usize;
                    if let Some(sum) = self.sum.get_mut(shell) {
                        *sum += 0.5 * x.norm_sqr();
                    }
                }
            }
        }
        self.count += 1;
    }

    /// Energy a mass in each shell of as many periods across the box, from 1, m²/s².
    pub fn shells(&self) -> Vec<f64> {
        let count = f64::from(self.count.max(1));
        self.sum.iter().skip(1).map(|sum| sum / count).collect()
    }
}
