//! What sets a bubble ringing: the pressure `W·t²` for t < t_c of an entrainment, a split or a merger (physics §1, after
//! Czerski and Deane, as in CB's own code).

use freshet::bubble::{GAMMA, P0, RHO, SIGMA};

/// How a bubble came to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// Closed off from the air.
    Entrained,
    /// Broken off a larger bubble.
    Split,
    /// Grown together from bubbles of these radii, m.
    Merged([f64; 2]),
}

/// A pressure pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// W, Pa/s².
    pub growth: f64,
    /// t_c, s.
    pub length: f64,
}

/// Longest pulse, s.
const LONGEST: f64 = 0.6e-3;
/// η of entrainment and split.
const ETA: f64 = 0.95;

impl Pulse {
    /// For a bubble of `radius` metres. `roundness` is the merger's ξ, 0.4 to 0.8.
    pub fn new(cause: Cause, radius: f64, roundness: f64) -> Self {
        let inside = P0 + 2.0 * SIGMA / radius;
        let cube = RHO * radius.powi(3);
        let length = LONGEST.min(radius / 6.0);
        match cause {
            Cause::Entrained | Cause::Split => Self {
                growth: -9.0 * GAMMA * SIGMA * ETA * inside * (1.0 + ETA * ETA).sqrt()
                    / (4.0 * cube),
                length,
            },
            Cause::Merged([r1, r2]) => {
                let neck = roundness * r1.min(r2) / 2.0;
                let speed = (2.0 * SIGMA * r1 * r2 / (RHO * (r1 + r2))).sqrt();
                Self {
                    growth: 6.0 * SIGMA * GAMMA * inside / cube,
                    length: length.min(neck * neck / speed),
                }
            }
        }
    }

    /// Its second integral at `t` seconds after it began, Pa·s².
    fn twice_integrated(&self, t: f64) -> f64 {
        if t <= 0.0 {
            return 0.0;
        }
        let within = t.min(self.length);
        let rest = t - within;
        self.growth * (within.powi(4) / 12.0 + within.powi(3) / 3.0 * rest)
    }

    /// Mean pressure around a sample at `t` seconds after the pulse began, weighted by a triangle two samples of `h`
    /// seconds wide: impulse and timing come out exact wherever the pulse falls.
    pub fn around(&self, t: f64, h: f64) -> f64 {
        let before = self.twice_integrated(t - h);
        let now = self.twice_integrated(t);
        let after = self.twice_integrated(t + h);
        (before - 2.0 * now + after) / (h * h)
    }

    /// Whether nothing of it is left at `t`.
    pub fn is_over(&self, t: f64, h: f64) -> bool {
        t - h >= self.length
    }
}

/// Force on y in 1/s² for a pressure in Pa on a bubble of `radius` metres: `p/(√r·m)`, `m = ρ/(4πr)`.
pub fn force(pressure: f64, radius: f64) -> f64 {
    pressure * 4.0 * std::f64::consts::PI * radius.sqrt() / RHO
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sampled_pulse_keeps_impulse_and_centre_wherever_it_falls() {
        let h = 1.0 / 48_000.0;
        for radius in [0.2e-3, 1e-3, 5e-3] {
            let pulse = Pulse::new(Cause::Entrained, radius, 0.6);
            let impulse = pulse.growth * pulse.length.powi(3) / 3.0;
            for offset in [0.0, 0.3, 0.99] {
                let times = (-2..60).map(|n| (f64::from(n) - offset) * h);
                let sum: f64 = times.clone().map(|t| pulse.around(t, h) * h).sum();
                let centre: f64 = times.map(|t| t * pulse.around(t, h) * h).sum::<f64>() / sum;
                assert!((sum / impulse - 1.0).abs() < 1e-9, "{sum} {impulse}");
                assert!(
                    (centre / (0.75 * pulse.length) - 1.0).abs() < 1e-6,
                    "{centre}"
                );
            }
        }
    }
}
