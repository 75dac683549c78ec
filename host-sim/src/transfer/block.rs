//! A quarter of an open box with walls.

use super::mesh::{Builder, Mesh, Part};

/// Inner width (x), depth (y), height and wall thickness, 0 for a thin interface around the liquid; `level` is the
/// liquid's height above the inner bottom.
pub fn open_box(size: [f64; 3], wall: f64, level: f64, edge: f64) -> Mesh {
    let [x, y, z] = [0.5 * size[0], 0.5 * size[1], size[2]];
    let mut quarter = Quarter::default();
    quarter.builder.mesh.mirrors = [true, true];
    let inner = if wall > 0.0 { Part::Wet } else { Part::Solid };
    let (xs, ys) = (steps(0.0, x, edge), steps(0.0, y, edge));
    let (rim_x, rim_y) = (steps(x, x + wall, edge), steps(y, y + wall, edge));
    let all = |inner: &[f64], rim: &[f64]| [inner, &rim[1..]].concat();
    let (all_x, all_y) = (all(&xs, &rim_x), all(&ys, &rim_y));
    let wet = steps(0.0, level, edge);
    quarter.face(2, -1.0, 0.0, &xs, &ys, inner);
    quarter.face(0, 1.0, x, &ys, &wet, inner);
    quarter.face(1, 1.0, y, &wet, &xs, inner);
    quarter.face(2, 1.0, level, &xs, &ys, Part::Free);
    if wall == 0.0 {
        return quarter.builder.mesh;
    }
    if level < z {
        let dry = steps(level, z, edge);
        quarter.face(0, -1.0, x, &ys, &dry, Part::Dry);
        quarter.face(1, -1.0, y, &dry, &xs, Part::Dry);
    }
    for (xs, ys) in [(&rim_x, &ys), (&xs, &rim_y), (&rim_x, &rim_y)] {
        quarter.face(2, 1.0, z, xs, ys, Part::Dry);
    }
    let outside = steps(-wall, z, edge);
    quarter.face(0, 1.0, x + wall, &all_y, &outside, Part::Dry);
    quarter.face(1, 1.0, y + wall, &outside, &all_x, Part::Dry);
    quarter.face(2, -1.0, -wall, &all_x, &all_y, Part::Dry);
    quarter.builder.mesh
}

/// From one end to the other in equal steps of about `edge`.
fn steps(from: f64, to: f64, edge: f64) -> Vec<f64> {
    let n = ((to - from) / edge).round().max(1.0) as usize;
    (0..=n)
        .map(|i| from + (to - from) * i as f64 / n as f64)
        .collect()
}

#[derive(Default)]
struct Quarter {
    builder: Builder,
}

impl Quarter {
    /// A rectangle across `axis`; `us` and `vs` run along the next two axes in turn.
    fn face(&mut self, axis: usize, sign: f64, at: f64, us: &[f64], vs: &[f64], part: Part) {
        let point = |u: f64, v: f64| {
            let mut point = [0.0; 3];
            point[axis] = at;
            point[(axis + 1) % 3] = u;
            point[(axis + 2) % 3] = v;
            point
        };
        for u in us.windows(2) {
            for v in vs.windows(2) {
                let [a, b, c, d] = [
                    point(u[0], v[0]),
                    point(u[1], v[0]),
                    point(u[1], v[1]),
                    point(u[0], v[1]),
                ];
                for [p, q, r] in [[a, b, c], [a, c, d]] {
                    let turned = if sign > 0.0 { [p, q, r] } else { [p, r, q] };
                    self.builder.triangle(turned, part);
                }
            }
        }
    }
}
