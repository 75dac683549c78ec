//! What a flow carries along: MacCormack's scheme (Selle and others 2008) over semi-Lagrangian steps (Fedkiw 2001).

use super::grid::Grid;

/// A step of advection; it keeps what both passes need.
pub struct Advection {
    grid: Grid,
    /// The carrying velocity at each place of the component in hand.
    here: Vec<[f64; 3]>,
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
            here: vec![[0.0; 3]; grid.len()],
            bounds: vec![[0.0; 2]; grid.len()],
            carrier: [(); 3].map(|()| vec![0.0; grid.len()]),
        }
    }

    /// The semi-Lagrangian step: `ahead` becomes `from` as it was where each place comes from.
    pub fn carry(&mut self, component: usize, from: &[f64], dt: f64, ahead: &mut [f64]) {
        let (grid, cells) = (self.grid, -dt / self.grid.h);
        for (at, point) in places(&grid, component) {
            let here = self.velocity(point);
            let middle = Grid::moved_by(point, here, 0.5 * cells);
            let source = Grid::moved_by(point, self.velocity(middle), cells);
            let (value, least, most) = grid.sample_between(from, component, source);
            ahead[at] = value;
            self.here[at] = here;
            self.bounds[at] = [least, most];
        }
    }

    /// The correction of the last [`carry`](Self::carry): going back from `ahead` should lead to `from`, and half of what
    /// is amiss is made good, as far as no new extremes come of it.
    pub fn correct(&self, component: usize, from: &[f64], ahead: &[f64], dt: f64, out: &mut [f64]) {
        let (grid, cells) = (self.grid, dt / self.grid.h);
        for (at, point) in places(&grid, component) {
            let middle = Grid::moved_by(point, self.here[at], 0.5 * cells);
            let target = Grid::moved_by(point, self.velocity(middle), cells);
            let back = grid.sample(ahead, component, target);
            let [least, most] = self.bounds[at];
            out[at] = (ahead[at] + 0.5 * (from[at] - back)).max(least).min(most);
        }
    }

    fn velocity(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|c| self.grid.sample(&self.carrier[c], c, point))
    }
}

/// Index and place (in cells) of every face of a component that moves.
#[inline(always)]
fn places(grid: &Grid, component: usize) -> impl Iterator<Item = (usize, [f64; 3])> {
    let grid = *grid;
    let [nx, ny, _] = grid.cells;
    grid.moved(component).flat_map(move |k| {
        (0..ny).flat_map(move |j| {
            (0..nx).map(move |i| (grid.at(i, j, k), Grid::place(component, i, j, k)))
        })
    })
}
