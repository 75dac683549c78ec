//! The staggered grid: pressure in the middle of each cell, each component of velocity on the faces it crosses.

/// What is at the lower and upper end of the box. The sides are periodic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// Inflow below, free outflow (no pressure) above.
    Open,
    /// The upper end is the lower one.
    Periodic,
}

/// Cubic cells in a box. z points up and along the flow.
///
/// Every field has `cells[2] + 2` layers: one below the box, one above it. Component 2 lies on the lower faces, so that
/// its layer 1 is the lower end itself and its last one the upper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Cells along x, y, z.
    pub cells: [usize; 3],
    /// Edge of a cell, m.
    pub h: f64,
    /// Above and below.
    pub ends: Ends,
}

/// Where each component lies in its cell, in cells.
const PLACE: [[f64; 3]; 3] = [[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]];
/// Furthest that a step looks for where something comes from, cells.
const FURTHEST: f64 = 4.0;

impl Grid {
    /// Cells of a layer.
    pub fn layer(&self) -> usize {
        self.cells[0] * self.cells[1]
    }

    /// Length of a field.
    pub fn len(&self) -> usize {
        self.layer() * (self.cells[2] + 2)
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of a cell in a field; layer 0 of the box is layer 1 of the field.
    pub fn at(&self, i: usize, j: usize, k: usize) -> usize {
        ((k + 1) * self.cells[1] + j) * self.cells[0] + i
    }

    /// The layers of a component that the flow moves: the lower end is what flows in.
    pub fn moved(&self, component: usize) -> std::ops::Range<usize> {
        let nz = self.cells[2];
        match (component, self.ends) {
            (2, Ends::Open) => 1..nz + 1,
            _ => 0..nz,
        }
    }

    /// Where a component of cell `(i, j, k)` lies, in cells.
    pub fn place(component: usize, i: usize, j: usize, k: usize) -> [f64; 3] {
        let place = PLACE[component];
        [
            i as f64 + place[0],
            j as f64 + place[1],
            k as f64 + place[2],
        ]
    }

    /// Fills the layers beyond the ends: as they come round, or outside as at the end. What flows in is filled elsewhere.
    pub fn wrap(&self, field: &mut [f64], component: usize) {
        let (n, nz) = (self.layer(), self.cells[2]);
        match self.ends {
            Ends::Periodic => {
                field.copy_within(n * nz..n * (nz + 1), 0);
                field.copy_within(n..2 * n, n * (nz + 1));
            }
            // The upper face is moved itself.
            Ends::Open if component == 2 => {}
            Ends::Open => field.copy_within(n * nz..n * (nz + 1), n * (nz + 1)),
        }
    }

    /// The eight neighbours of a point (in cells) within `component`, and their weights along x, y, z.
    #[inline(always)]
    fn around(&self, component: usize, point: [f64; 3]) -> ([usize; 8], [f64; 3]) {
        let [nx, ny, nz] = self.cells;
        let place = PLACE[component];
        let (x, i) = turn(point[0] - place[0], nx);
        let (y, j) = turn(point[1] - place[1], ny);
        let mut up = point[2] - place[2];
        if self.ends == Ends::Periodic {
            let whole = nz as f64;
            if up < 0.0 {
                up += whole;
            } else if up >= whole {
                up -= whole;
            }
        }
        let up = (up + 1.0).clamp(0.0, nz as f64 + 1.0);
        // Not a number counts as 0.
        let k = (up as usize).min(nz);
        let z = up - k as f64;
        let (i1, j1) = (
            if i + 1 == nx { 0 } else { i + 1 },
            if j + 1 == ny { 0 } else { j + 1 },
        );
        let (a, b) = ((k * ny + j) * nx, (k * ny + j1) * nx);
        let layer = nx * ny;
        let (c, d) = (a + layer, b + layer);
        (
            [a + i, a + i1, b + i, b + i1, c + i, c + i1, d + i, d + i1],
            [x, y, z],
        )
    }

    /// A component at a point (in cells), between its neighbours in proportion.
    #[inline(always)]
    pub fn sample(&self, field: &[f64], component: usize, point: [f64; 3]) -> f64 {
        let (near, weight) = self.around(component, point);
        mix(near.map(|at| field[at]), weight)
    }

    /// The same, with the least and the greatest of the neighbours.
    #[inline(always)]
    pub fn sample_between(
        &self,
        field: &[f64],
        component: usize,
        point: [f64; 3],
    ) -> (f64, f64, f64) {
        let (near, weight) = self.around(component, point);
        let near = near.map(|at| field[at]);
        let least = near.iter().copied().fold(f64::INFINITY, f64::min);
        let most = near.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (mix(near, weight), least, most)
    }

    /// `point` moved by `velocity` for `cells_a_unit`, not further than a few cells.
    #[inline(always)]
    pub fn moved_by(point: [f64; 3], velocity: [f64; 3], cells_a_unit: f64) -> [f64; 3] {
        let mut to = point;
        for (x, v) in to.iter_mut().zip(velocity) {
            *x += (v * cells_a_unit).clamp(-FURTHEST, FURTHEST);
        }
        to
    }
}

/// A place along a periodic axis: the part of a cell, and the cell. A point is never further than a box outside.
#[inline(always)]
fn turn(x: f64, n: usize) -> (f64, usize) {
    let whole = n as f64;
    let x = if x < 0.0 {
        x + whole
    } else if x >= whole {
        x - whole
    } else {
        x
    };
    // Rounding may leave it at the end; not a number counts as 0.
    let i = (x as usize).min(n - 1);
    (x - i as f64, i)
}

#[inline(always)]
fn mix(near: [f64; 8], [x, y, z]: [f64; 3]) -> f64 {
    let along = |a: f64, b: f64| a + x * (b - a);
    let low = along(near[0], near[1]) * (1.0 - y) + along(near[2], near[3]) * y;
    let high = along(near[4], near[5]) * (1.0 - y) + along(near[6], near[7]) * y;
    low * (1.0 - z) + high * z
}
