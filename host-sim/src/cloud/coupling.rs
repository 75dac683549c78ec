//! How much one bubble feels another: the mass matrix M̃ of `M̃ÿ + Cẏ + Ky = F` (CB §4.1–4.2), where the volume
//! displaced is `√r·y`.

use anyhow::{Result, bail};
use clap::ValueEnum;
use faer::Mat;

/// Regularised coupling between two bubbles at distance d.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kernel {
    /// `√(r s)/√(d² + ε²(r² + s²)/2)`: positive definite for every cloud (physics §3)
    Definite,
    /// CB (13), `1/√(d²/(r s) + ε²)`: positive definite only for similar radii
    Cb,
}

/// What couples, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// The form of the regularisation.
    pub kernel: Kernel,
    /// ε, without unit; CB's default is 2.
    pub epsilon: f64,
    /// Subtract the image in the surface (CB §3.3): shallow bubbles hear deep ones less.
    pub dipole: bool,
}

impl Coupling {
    /// CB's ε with the definite kernel, monopoles only.
    pub const DEFAULT: Self = Self {
        kernel: Kernel::Definite,
        epsilon: 2.0,
        dipole: false,
    };
}

impl Default for Coupling {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Where a bubble is and how large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// m; y is up.
    pub at: [f64; 3],
    /// m.
    pub radius: f64,
    /// Distance below the surface, m; only the dipole asks.
    pub depth: f64,
}

impl Coupling {
    /// Checks ε: above 1 for the definite kernel, from 0 for CB's.
    ///
    /// # Errors
    /// A number outside, with the reason.
    pub fn checked(self) -> Result<Self> {
        let epsilon = self.epsilon;
        match self.kernel {
            Kernel::Definite if !(epsilon > 1.0 && epsilon <= 1e6) => bail!(
                "--epsilon {epsilon}: expected a number above 1, to 1e6 (at 1 and below, bubbles that overlap would \
                 have no positive mass)"
            ),
            Kernel::Cb if !(0.0..=1e6).contains(&epsilon) => {
                bail!("--epsilon {epsilon}: expected a number from 0 to 1e6")
            }
            _ => Ok(self),
        }
    }

    /// M̃ of two different bubbles, without unit, below 1/ε.
    #[inline(always)]
    pub fn between(&self, a: &Place, b: &Place) -> f64 {
        let mut square = 0.0;
        for axis in 0..3 {
            let step = a.at[axis] - b.at[axis];
            square += step * step;
        }
        let product = a.radius * b.radius;
        let soft = match self.kernel {
            Kernel::Definite => 0.5 * (a.radius * a.radius + b.radius * b.radius),
            Kernel::Cb => product,
        };
        let near = square + self.epsilon * self.epsilon * soft;
        let direct = (product / near).sqrt();
        if self.dipole {
            // d'² = d² + (H + h)² − (H − h)².
            direct - (product / (near + 4.0 * a.depth.max(0.0) * b.depth.max(0.0))).sqrt()
        } else {
            direct
        }
    }

    /// The whole matrix, N × N, symmetric, with ones on its diagonal.
    pub fn matrix(&self, places: &[Place]) -> Mat<f64> {
        let n = places.len();
        let mut mass = Mat::identity(n, n);
        for j in 0..n {
            for i in j + 1..n {
                let m = self.between(&places[i], &places[j]);
                mass[(i, j)] = m;
                mass[(j, i)] = m;
            }
        }
        mass
    }

    /// What the least eigenvalue of M̃ is at least, for any cloud: `1 − 1/ε` for the definite kernel (a mixture of
    /// Gaussian kernels plus that much identity); nothing is known of CB's.
    ///
    /// With the dipole the bound holds where depths are those under one plane.
    pub fn least_eigenvalue(&self) -> f64 {
        match self.kernel {
            Kernel::Definite => 1.0 - 1.0 / self.epsilon,
            Kernel::Cb => 0.0,
        }
    }

    /// Whether that bound needs no check.
    pub fn is_always_definite(&self) -> bool {
        self.kernel == Kernel::Definite && !self.dipole
    }
}
