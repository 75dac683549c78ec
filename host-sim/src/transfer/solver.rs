//! From bubble to ear through a frozen shape at one frequency.
//!
//! The bubble's field in the water moves the free surface, and the moving surface radiates into the air (HF §5).
//! The direct way follows that, bubble by bubble. The adjoint way starts at the ear: a unit source there, scattered
//! off the rigid surface, gives the pressure on the free surface, and that, taken as given for the water, gives every
//! bubble its transfer at once (physics.md §5).

use std::f64::consts::PI;

use anyhow::{Result, bail};
use faer::c64;
use rayon::prelude::*;

use super::elements::{Nodal, Problem, Solution, Source};
use super::mesh::show;
use super::plane;
use super::point::Point;
use super::shape::Shape;
use super::{AIR, WATER};

/// What was found for one bubble and one ear.
#[derive(Clone, Copy, Debug)]
pub struct Transfer {
    /// P/S_b, 1/m, before the density ratio.
    pub ratio: c64,
    /// How far the boundary conditions are missed, relative, in water and in air.
    pub residual: Residual,
}

/// How far the boundary conditions are missed, rms over the surface, relative to what drives the field.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual {
    /// Of the liquid's problem.
    pub water: f64,
    /// Of the air's problem.
    pub air: f64,
}

/// A shape at a frequency, factored once.
pub struct Solver<'a> {
    shape: &'a Shape,
    frequency: f64,
    problems: Option<(Problem<'a>, Problem<'a>)>,
}

/// A dense matrix of so many rows takes 0.6 GB.
const MOST_UNKNOWNS: usize = 6_000;

/// Wavenumbers in water and in air, 1/m.
pub fn wavenumbers(frequency: f64) -> (f64, f64) {
    let omega = 2.0 * PI * frequency;
    (omega / WATER.speed, omega / AIR.speed)
}

impl<'a> Solver<'a> {
    /// Factors the water's and the air's problem at `frequency` in Hz.
    ///
    /// # Errors
    /// A frequency that the mesh does not resolve, or a mesh too fine to solve.
    pub fn new(shape: &'a Shape, frequency: f64) -> Result<Self> {
        shape.check_frequency(frequency)?;
        let (kw, ka) = wavenumbers(frequency);
        if let Shape::Closed(closed) = shape {
            let nodes = closed.water.unknowns().max(closed.air.unknowns());
            if nodes > MOST_UNKNOWNS {
                bail!(
                    "{nodes} unknowns: boundary elements take {MOST_UNKNOWNS} at most here; make `edge` longer, or the mesh coarser"
                );
            }
        }
        let problems = match shape {
            Shape::Pool => None,
            Shape::Closed(closed) => Some((
                Problem::water(&closed.water, kw),
                Problem::air(&closed.air, ka),
            )),
        };
        Ok(Solver {
            shape,
            frequency,
            problems,
        })
    }

    /// Everything that an ear hears: one solve in air, one in water.
    ///
    /// # Errors
    /// An ear that is not in the air.
    pub fn hear(&self, ear: Point) -> Result<Field<'_, 'a>> {
        self.shape.check_ear(ear)?;
        let Some((water, air)) = &self.problems else {
            return Ok(Field {
                solver: self,
                ear,
                solved: None,
            });
        };
        let scattered = air.solve(Some(self.at_ear(ear)), None);
        let heard = scattered.at_free();
        let inside = water.solve(None, Some(&heard));
        Ok(Field {
            solver: self,
            ear,
            solved: Some((inside, scattered)),
        })
    }

    /// Everything that a bubble sounds like: one solve in water, one in air (HF §5).
    ///
    /// # Errors
    /// A bubble that is not in the liquid.
    pub fn sound(&self, bubble: Point) -> Result<Sound<'_, 'a>> {
        self.shape.check_bubble(bubble)?;
        let Some((water, air)) = &self.problems else {
            return Ok(Sound {
                solver: self,
                bubble,
                solved: None,
            });
        };
        let inside = water.solve(Some(self.at_bubble(bubble)), None);
        let flow: Nodal = inside.at_free();
        let outside = air.solve(None, Some(&flow));
        Ok(Sound {
            solver: self,
            bubble,
            solved: Some((inside, outside)),
        })
    }

    /// A unit source (∇²P + k²P = −δ) in the air.
    fn at_ear(&self, place: Point) -> Source {
        Source {
            place,
            strength: -1.0,
            k: wavenumbers(self.frequency).1,
        }
    }

    /// S_b = 1.
    fn at_bubble(&self, place: Point) -> Source {
        Source {
            place,
            strength: 1.0,
            k: wavenumbers(self.frequency).0,
        }
    }
}

fn over_plane(bubble: Point, ear: Point, frequency: f64) -> Result<c64> {
    let (ratio, off) = plane::transfer(bubble, ear, frequency);
    if off > 0.03 {
        bail!(
            "bubble at {}, ear at {}: too many waves between them over the pool's surface to sum; expected them nearer",
            show(bubble),
            show(ear)
        );
    }
    Ok(ratio)
}

/// In the water and in the air.
type Pair<'s, 'a> = (Solution<'s, 'a>, Solution<'s, 'a>);

/// What one ear hears of bubbles anywhere.
pub struct Field<'s, 'a> {
    solver: &'s Solver<'a>,
    ear: Point,
    solved: Option<Pair<'s, 'a>>,
}

impl Field<'_, '_> {
    /// P/S_b in 1/m for bubbles at many places, in parallel.
    ///
    /// # Errors
    /// A place that is not inside the liquid.
    pub fn at(&self, bubbles: &[Point]) -> Result<Vec<c64>> {
        bubbles.par_iter().map(|bubble| self.one(*bubble)).collect()
    }

    fn one(&self, bubble: Point) -> Result<c64> {
        self.solver.shape.check_bubble(bubble)?;
        Ok(match &self.solved {
            None => over_plane(bubble, self.ear, self.solver.frequency)?,
            Some((inside, _)) => -inside.radiated(bubble),
        })
    }

    /// The pressure at a point of the air with a unit source (∇²P + k²P = −δ) at the ear and every surface rigid.
    ///
    /// # Errors
    /// A place that is not in the air.
    pub fn in_air(&self, at: Point) -> Result<c64> {
        self.solver.shape.check_ear(at)?;
        let comes = |from: Point| self.solver.at_ear(from).at(at, [0.0; 3]).pressure;
        Ok(match &self.solved {
            None => {
                let [x, y, z] = self.ear;
                comes(self.ear) + comes([x, y, -z])
            }
            Some((_, scattered)) => comes(self.ear) + scattered.radiated(at),
        })
    }

    /// Of both solves. Over the pool there is nothing to solve; there it is the integral's error for a bubble.
    pub fn residual(&self, bubble: Point) -> Residual {
        match &self.solved {
            None => {
                let (_, off) = plane::transfer(bubble, self.ear, self.solver.frequency);
                Residual {
                    water: 0.0,
                    air: off,
                }
            }
            Some((inside, scattered)) => Residual {
                water: inside.residual(None),
                air: scattered.residual(Some(self.solver.at_ear(self.ear))),
            },
        }
    }
}

/// What one bubble sounds like anywhere.
pub struct Sound<'s, 'a> {
    solver: &'s Solver<'a>,
    bubble: Point,
    solved: Option<Pair<'s, 'a>>,
}

impl Sound<'_, '_> {
    /// P/S_b in 1/m at many ears.
    ///
    /// # Errors
    /// An ear that is not in the air.
    pub fn at(&self, ears: &[Point]) -> Result<Vec<c64>> {
        ears.par_iter()
            .map(|ear| {
                self.solver.shape.check_ear(*ear)?;
                Ok(match &self.solved {
                    None => over_plane(self.bubble, *ear, self.solver.frequency)?,
                    Some((_, outside)) => outside.radiated(*ear),
                })
            })
            .collect()
    }

    /// Of both solves. Over the pool there is nothing to solve; there it is the integral's error for an ear.
    pub fn residual(&self, ear: Point) -> Residual {
        match &self.solved {
            None => {
                let (_, off) = plane::transfer(self.bubble, ear, self.solver.frequency);
                Residual {
                    water: 0.0,
                    air: off,
                }
            }
            Some((inside, outside)) => Residual {
                water: inside.residual(Some(self.solver.at_bubble(self.bubble))),
                air: outside.residual(None),
            },
        }
    }
}
