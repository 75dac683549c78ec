//! Where the liquid is: what the solvers know of a vessel, whatever it was made from.

use anyhow::{Result, bail};

use super::AIR;
use super::mesh::{Mesh, Part, images, reflect, show};
use super::panel::Panel;
use super::point::{Point, sub};

/// Edges to a wavelength in air, at least.
const EDGES: f64 = 6.0;

/// A frozen liquid, its walls, and the air around.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Closed surfaces.
    Closed(Box<Closed>),
    /// Water below z = 0, air above, without end.
    Pool,
}

/// A liquid and its walls in the open air.
#[derive(Clone, Debug)]
pub struct Closed {
    /// The liquid's whole surface.
    pub water: Surface,
    /// What the air touches: the free surface and the dry sides of the walls.
    pub air: Surface,
    /// What both were made from.
    pub mesh: Mesh,
}

/// Panels, oriented: the normal points out of the liquid, or into the air.
#[derive(Clone, Debug)]
pub struct Surface {
    pub(super) panels: Vec<Panel>,
    /// The nodes of each panel.
    pub(super) corners: Vec<[usize; 3]>,
    /// Which panels are free surface.
    pub(super) free: Vec<bool>,
    pub(super) nodes: Vec<Point>,
    /// Of each node on the free surface, its number among those; the same for water and air.
    pub(super) free_node: Vec<Option<usize>>,
    /// Nodes on the free surface.
    pub(super) free_nodes: usize,
    pub(super) mirrors: [bool; 2],
}

/// A point on a surface that stands for some of it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// m.
    pub point: Point,
    /// Out of the liquid, or into the air.
    pub normal: Point,
    /// m².
    pub area: f64,
    /// On the free surface; else on something rigid.
    pub free: bool,
}

impl Shape {
    /// From a mesh that is closed and oriented.
    pub fn new(mesh: Mesh) -> Result<Self> {
        mesh.check()?;
        Ok(Shape::Closed(Box::new(Closed {
            water: Surface::new(&mesh, Part::bounds_water),
            air: Surface::new(&mesh, Part::bounds_air),
            mesh,
        })))
    }

    /// The highest frequency that the mesh resolves, Hz.
    pub fn highest(&self) -> f64 {
        match self {
            Shape::Pool => f64::INFINITY,
            Shape::Closed(closed) => {
                let edge = closed.water.edge().max(closed.air.edge());
                AIR.speed / (EDGES * edge)
            }
        }
    }

    /// Refuses a frequency that is none, or that the mesh does not resolve.
    pub fn check_frequency(&self, frequency: f64) -> Result<()> {
        let highest = self.highest();
        if !(frequency.is_finite() && frequency > 0.0) {
            bail!("frequency {frequency} Hz: expected a number above 0");
        }
        if frequency > highest {
            bail!(
                "frequency {frequency} Hz: this mesh resolves up to {highest:.0} Hz ({EDGES} edges to a wavelength in air); \
                 make `edge` {:.2} times as long, or smaller",
                highest / frequency
            );
        }
        if frequency < 1.0 {
            bail!("frequency {frequency} Hz: expected at least 1 Hz");
        }
        Ok(())
    }

    /// Refuses a place that is not inside the liquid.
    pub fn check_bubble(&self, at: Point) -> Result<()> {
        check_finite("bubble", at)?;
        let (inside, hint) = match self {
            Shape::Pool => (at[2] < 0.0, "expected z below 0".to_owned()),
            Shape::Closed(closed) => {
                let (low, high) = closed.water.bounds();
                let hint = format!("the liquid lies between {} and {}", show(low), show(high));
                (closed.water.encloses(at), hint)
            }
        };
        if !inside {
            bail!("bubble at {}: not inside the liquid ({hint}, m)", show(at));
        }
        Ok(())
    }

    /// Refuses a place that is not in the air.
    pub fn check_ear(&self, at: Point) -> Result<()> {
        check_finite("ear", at)?;
        let (outside, hint) = match self {
            Shape::Pool => (at[2] > 0.0, "expected z above 0"),
            Shape::Closed(closed) => (
                !closed.air.encloses(at),
                "expected it outside the liquid and the walls",
            ),
        };
        if !outside {
            bail!("ear at {}: not in the air ({hint})", show(at));
        }
        Ok(())
    }
}

fn check_finite(what: &str, at: Point) -> Result<()> {
    // Farther than that there is nothing to hear, and numbers overflow.
    if !at.iter().all(|x| x.is_finite() && x.abs() <= 1e6) {
        bail!("{what} at {at:?}: expected three numbers in metres, within ±1e6");
    }
    Ok(())
}

impl Surface {
    fn new(mesh: &Mesh, belongs: fn(Part) -> bool) -> Self {
        let mut free_number = vec![None; mesh.points.len()];
        let mut free_nodes = 0;
        for (corners, part) in &mesh.triangles {
            if *part == Part::Free {
                for &corner in corners {
                    free_number[corner].get_or_insert_with(|| {
                        free_nodes += 1;
                        free_nodes - 1
                    });
                }
            }
        }
        let mut surface = Surface {
            panels: Vec::new(),
            corners: Vec::new(),
            free: Vec::new(),
            nodes: Vec::new(),
            free_node: Vec::new(),
            free_nodes,
            mirrors: mesh.mirrors,
        };
        let mut number = vec![None; mesh.points.len()];
        for (corners, part) in mesh.triangles.iter().filter(|t| belongs(t.1)) {
            surface
                .panels
                .push(Panel::new(corners.map(|i| mesh.points[i])));
            surface.free.push(*part == Part::Free);
            surface.corners.push(corners.map(|i| {
                *number[i].get_or_insert_with(|| {
                    surface.nodes.push(mesh.points[i]);
                    surface.free_node.push(free_number[i]);
                    surface.nodes.len() - 1
                })
            }));
        }
        surface
    }

    /// The longest edge, m.
    pub fn edge(&self) -> f64 {
        self.panels
            .iter()
            .map(|panel| panel.size)
            .fold(0.0, f64::max)
    }

    /// Area in m², the reflections included.
    pub fn area(&self, free: bool) -> f64 {
        let panels = self.panels.iter().zip(&self.free);
        let meshed: f64 = panels.filter(|p| *p.1 == free).map(|p| p.0.area).sum();
        meshed * images(self.mirrors).len() as f64
    }

    /// Two corners of the box around it, the reflections included.
    pub fn bounds(&self) -> (Point, Point) {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for signs in images(self.mirrors) {
            for node in &self.nodes {
                let node = reflect(*node, signs);
                for axis in 0..3 {
                    low[axis] = low[axis].min(node[axis]);
                    high[axis] = high[axis].max(node[axis]);
                }
            }
        }
        (low, high)
    }

    /// The diagonal of that box.
    pub fn diagonal(&self) -> f64 {
        let (low, high) = self.bounds();
        super::point::norm(sub(high, low))
    }

    /// Whether a point is inside: the surface is all around it.
    pub fn encloses(&self, point: Point) -> bool {
        let angle: f64 = images(self.mirrors)
            .into_iter()
            .map(|signs| {
                let seen_from = reflect(point, signs);
                self.panels
                    .iter()
                    .map(|panel| panel.solid_angle(seen_from))
                    .sum::<f64>()
            })
            .sum();
        angle > 2.0 * std::f64::consts::PI
    }

    /// One sample a panel, the reflections included.
    pub fn samples(&self) -> Vec<Sample> {
        let mut samples = Vec::new();
        for signs in images(self.mirrors) {
            for (panel, free) in self.panels.iter().zip(&self.free) {
                samples.push(Sample {
                    point: reflect(panel.centre, signs),
                    normal: reflect(panel.normal, signs),
                    area: panel.area,
                    free: *free,
                });
            }
        }
        samples
    }

    /// Of one parity's equations.
    pub(super) fn unknowns(&self) -> usize {
        self.nodes.len()
    }

    /// Panels and nodes, the reflections included.
    pub fn count(&self) -> (usize, usize) {
        let n = images(self.mirrors).len();
        (n * self.panels.len(), n * self.nodes.len())
    }
}
