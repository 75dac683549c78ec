//! A scene: values over the parameter table, and the curves that its intensity moves.

use heapless::Vec;

use crate::param::{self, Param};

/// Most parameters a scene may set.
pub const VALUES: usize = param::COUNT;
/// Most parameters an intensity may move.
pub const CURVES: usize = 16;
/// Most points of a curve.
pub const POINTS: usize = 8;

/// What an intensity does to one parameter: points `(intensity, value)`, in order of intensity.
#[derive(Clone, Debug, PartialEq)]
pub struct IntensityCurve {
    /// Index in the parameter table.
    pub param: usize,
    /// At least one point.
    pub points: Vec<(f32, f32), POINTS>,
}

impl IntensityCurve {
    /// The parameter's value at `intensity`, along its own curve between the points and flat beyond them.
    pub fn at(&self, intensity: f32) -> f32 {
        let param: &Param = &param::TABLE[self.param];
        let mut before = self.points[0];
        for &(x, value) in &self.points {
            if x > intensity {
                let part = (intensity - before.0) / (x - before.0);
                return param.between(before.1, value, part);
            }
            before = (x, value);
        }
        before.1
    }
}

/// A scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// `(index in the table, value)`; what is not named has its default.
    pub values: Vec<(usize, f32), VALUES>,
    /// What the intensity moves.
    pub curves: Vec<IntensityCurve, CURVES>,
}
