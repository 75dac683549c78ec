//! One bubble: pitch and decay from its radius (HF 36–38, CB 3–5). f64, computed when a parameter changes.

use core::f64::consts::PI;

/// Density of water, kg/m³.
pub const RHO: f64 = 1000.0;
/// Ambient pressure, Pa.
pub const P0: f64 = 101_325.0;
/// Ratio of specific heats of air.
pub const GAMMA: f64 = 1.4;
/// Surface tension of water, N/m.
pub const SIGMA: f64 = 0.0726;
/// Thermal diffusivity of the gas, m²/s.
pub const GAS_DIFFUSIVITY: f64 = 2.122e-5;
/// Speed of sound in water, m/s.
pub const C_WATER: f64 = 1497.0;
/// Viscosity of water, Pa·s.
pub const VISCOSITY: f64 = 8.9e-4;

/// Smallest radius the instrument accepts, m.
pub const RADIUS_MIN: f64 = 0.15e-3;
/// Largest radius the instrument accepts, m.
pub const RADIUS_MAX: f64 = 150e-3;

/// Pitch and decay of a free bubble.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bubble {
    /// Undamped angular frequency ω0, rad/s.
    pub omega0: f64,
    /// Decay rate β, 1/s.
    pub beta: f64,
}

impl Bubble {
    /// A bubble of `radius` metres.
    pub fn new(radius: f64) -> Self {
        let omega0 =
            libm::sqrt(3.0 * GAMMA * P0 - 2.0 * SIGMA / radius) / (radius * libm::sqrt(RHO));
        let f0 = omega0 / (2.0 * PI);
        let radiation = omega0 * radius / C_WATER;
        let viscous = 4.0 * VISCOSITY / (RHO * omega0 * radius * radius);
        let g_thermal = 3.0 * GAMMA * P0 / (4.0 * PI * RHO * GAS_DIFFUSIVITY);
        // The quotient takes f0 in Hz, and the second term stands outside the root.
        let psi = 16.0 / (9.0 * (GAMMA - 1.0) * (GAMMA - 1.0)) * g_thermal / f0;
        let thermal = 2.0 * (libm::sqrt(psi - 3.0) - (3.0 * GAMMA - 1.0) / (3.0 * (GAMMA - 1.0)))
            / (psi - 4.0);
        let delta = radiation + viscous + thermal;
        Self {
            omega0,
            beta: omega0 * delta / libm::sqrt(delta * delta + 4.0),
        }
    }

    /// Angular frequency of the ringing, `sqrt(ω0² − β²)`, rad/s.
    pub fn omega_d(&self) -> f64 {
        libm::sqrt(self.omega0 * self.omega0 - self.beta * self.beta)
    }

    /// Pitch of the ringing, Hz.
    pub fn pitch(&self) -> f64 {
        self.omega_d() / (2.0 * PI)
    }
}

/// How a bubble rings at a sample rate; what resonators and voices are tuned by.
#[derive(Clone, Copy, Debug)]
pub struct Ringing {
    /// Radius, m.
    pub radius: f32,
    /// Angle a sample, rad.
    pub angle: f64,
    /// The same in turns.
    pub turns: f64,
    /// Decay β a sample.
    pub decay: f64,
    /// Part lost in a sample, `1 − e^−β`.
    pub loss: f64,
}

impl Ringing {
    /// A bubble of `radius` metres at `rate` Hz.
    pub fn new(radius: f32, rate: f64) -> Self {
        let bubble = Bubble::new(f64::from(radius));
        let angle = bubble.omega_d() / rate;
        let decay = bubble.beta / rate;
        Self {
            radius,
            angle,
            turns: angle / (2.0 * PI),
            decay,
            loss: -libm::expm1(-decay),
        }
    }
}

/// Pressure at 1 m of a bubble just cut off from the air, Pa: the surface-tension step `2σ/R` (physics §1).
pub const ENTRAINMENT: f64 = 2.0 * SIGMA;
