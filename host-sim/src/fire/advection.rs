//! What a flow carries along: MacCormack's scheme (Selle and others 2008) over semi-Lagrangian steps (Fedkiw 2001).

use super::grid::Grid;

/// A step of advection; it keeps what both passes need.
pub struct Advection {
    grid: Grid,
    /// Where each place of the component in hand is carried to, from there, m/s.
    onward: Vec<[f64; 3]>,
    /// Least and greatest value around where each comes from.
    bounds: Vec<[f64; 2]>,
    /// The carrying velocity in the middle of the step, m/s.
    pub carrier: [Vec<f64>; 3],
}

impl Advection {
    /// For a grid.
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            onward: vec![[0.0; 3]; grid.len()],
            bounds: vec![[0.0; 2]; grid.len()],
            carrier: [(); 3].map(|()| vec![0.0; grid.len()]),
        }
    }

    /// The semi-Lagrangian step: `ahead` becomes `from` as it was where each place comes from.
    pub fn carry(&mut self, component: usize, from: &[f64], dt: f64, ahead: &mut [f64]) {
        let (grid, cells) = (self.grid, -dt / self.grid.h);
        let carrier = &self.carrier;
        let (onward, bounds) = (&mut self.onward, &mut self.bounds);
        each(&grid, component, |at, point| {
            let here = grid.velocity(carrier, point);
            let middle = Grid::moved_by(point, here, 0.5 * cells);
            let past = grid.velocity(carrier, middle);
            let source = Grid::moved_by(point, past, cells);
            (ahead[at], bounds[at]) = grid.sample(from, component, source);
            // Half a step ahead as it was half a step back, mirrored: second order, and nothing to look up.
            onward[at] = [0, 1, 2].map(|c| 2.0 * here[c] - past[c]);
        });
    }

    /// The correction of the last [`carry`](Self::carry): going back from `ahead` should lead to `from`, and half of what
    /// is amiss is made good, as far as no new extremes come of it.
    pub fn correct(&self, component: usize, from: &[f64], ahead: &[f64], dt: f64, out: &mut [f64]) {
        let (grid, cells) = (self.grid, dt / self.grid.h);
        each(&grid, component, |at, point| {
            let target = Grid::moved_by(point, self.onward[at], cells);
            let (back, _) = grid.sample(ahead, component, target);
            let [least, most] = self.bounds[at];
            out[at] = (ahead[at] + 0.5 * (from[at] - back)).max(least).min(most);
        });
    }
}

/// Calls with index and place (in cells) of every face of a component that moves.
#[inline(always)]
fn each(grid: &Grid, component: usize, mut of: impl FnMut(usize, [f64; 3])) {
    let [nx, ny, _] = grid.cells;
    for k in grid.moved(component) {
        for j in 0..ny {
            for i in 0..nx {
                of(grid.at(i, j, k), Grid::place(component, i, j, k));
            }
        }
    }
}
