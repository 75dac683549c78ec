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

    /// A component at a point (in cells) between its eight neighbours in proportion, and the least and greatest of them.
    #[inline(always)]
    pub fn sample(&self, field: &[f64], component: usize, point: [f64; 3]) -> (f64, [f64; 2]) {
        let place = PLACE[component];
        let near = self.near(
            field,
            self.turn(0, point[0] - place[0]),
            self.turn(1, point[1] - place[1]),
            self.rise(point[2] - place[2]),
        );
        let least = near.0.iter().copied().fold(f64::INFINITY, f64::min);
        let most = near.0.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (mix(near), [least, most])
    }

    /// All three components at a point (in cells).
    #[inline(always)]
    pub fn velocity(&self, fields: &[Vec<f64>; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
        // Faces lie half a cell before the middles.
        let (x_face, x_mid) = (self.turn(0, x), self.turn(0, x - 0.5));
        let (y_face, y_mid) = (self.turn(1, y), self.turn(1, y - 0.5));
        let (z_face, z_mid) = (self.rise(z), self.rise(z - 0.5));
        [
            mix(self.near(&fields[0], x_face, y_mid, z_mid)),
            mix(self.near(&fields[1], x_mid, y_face, z_mid)),
            mix(self.near(&fields[2], x_mid, y_mid, z_face)),
        ]
    }

    /// A place along a periodic axis: the cell, the next one, and the part between. Never further than a box outside.
    #[inline(always)]
    fn turn(&self, axis: usize, x: f64) -> Between {
        let n = self.cells[axis];
        let whole = n as f64;
        let x = if x < 0.0 {
            x + whole
        } else if x >= whole {
            x - whole
        } else {
            x
        };
        // Rounding may leave it at the end; not a number counts as 0.
        let low = (x as i32 as usize).min(n - 1);
        let high = if low + 1 == n { 0 } else { low + 1 };
        Between {
            low,
            high,
            part: x - low as f64,
        }
    }

    /// A place along the flow, by the layers of a field; beyond the outer ones it is as there.
    #[inline(always)]
    fn rise(&self, z: f64) -> Between {
        let whole = self.cells[2] as f64;
        let z = match self.ends {
            Ends::Periodic if z < 0.0 => z + whole,
            Ends::Periodic if z >= whole => z - whole,
            _ => z,
        };
        let z = (z + 1.0).max(0.0).min(whole + 1.0);
        let low = (z as i32 as usize).min(self.cells[2]);
        Between {
            low,
            high: low + 1,
            part: z - low as f64,
        }
    }

    /// The eight neighbours, and how far the point is from the first of them.
    #[inline(always)]
    fn near(&self, field: &[f64], x: Between, y: Between, z: Between) -> ([f64; 8], [f64; 3]) {
        let [nx, ny, _] = self.cells;
        let (a, b) = ((z.low * ny + y.low) * nx, (z.low * ny + y.high) * nx);
        let layer = nx * ny;
        let near = [
            field[a + x.low],
            field[a + x.high],
            field[b + x.low],
            field[b + x.high],
            field[a + layer + x.low],
            field[a + layer + x.high],
            field[b + layer + x.low],
            field[b + layer + x.high],
        ];
        (near, [x.part, y.part, z.part])
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

/// Two neighbours along an axis, and the part of the way from one to the other.
#[derive(Clone, Copy)]
struct Between {
    low: usize,
    high: usize,
    part: f64,
}

#[inline(always)]
fn mix((near, [x, y, z]): ([f64; 8], [f64; 3])) -> f64 {
    let between = |a: f64, b: f64, part: f64| a + part * (b - a);
    let low = between(
        between(near[0], near[1], x),
        between(near[2], near[3], x),
        y,
    );
    let high = between(
        between(near[4], near[5], x),
        between(near[6], near[7], x),
        y,
    );
    between(low, high, z)
}
