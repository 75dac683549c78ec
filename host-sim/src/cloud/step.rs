//! One bubble's step in time, exact when it is alone: pitch and decay to the last digits at any sample rate.
//!
//! With `a = y⁺ − 2y + y⁻` and `v = y − y⁻`, a step solves `(M̃ + E)·a = −(c v + k y) + f`, then `v += a`, `y += v`.
//! `E = E' + c/2` is diagonal. `c` and `k` are such that a bubble with nobody to hear (`M̃ = 1`) has the poles of the
//! continuous equation, whatever `E'` is. `E' = k/12` makes the step Numerov's, whose pitch for a coupled mode of angle
//! θ a sample is off by about `θ⁴/480` times what coupling changed; damping is central.
//!
//! The discrete energy `½dᵀ(M̃ + E' − K/4)d + ½mᵀKm` (d the step, m the midpoint) cannot grow without forcing where the
//! bracket is positive: so `E'` is raised to `k/4 − s` for bubbles near the top of the band, s being what is known of M̃'s
//! least eigenvalue. Those lose an order of accuracy, never their stability.

use std::f64::consts::PI;

use freshet::bubble::{C_WATER, GAMMA, GAS_DIFFUSIVITY, P0, RHO, VISCOSITY};

/// Pitch and decay of a bubble that may have been measured rather than computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Undamped angular frequency ω0, rad/s.
    pub omega0: f64,
    /// Decay rate β, 1/s.
    pub beta: f64,
}

impl Tone {
    /// From the radius in metres alone (physics §1).
    pub fn of_radius(radius: f64) -> Self {
        let bubble = freshet::bubble::Bubble::new(radius);
        Self {
            omega0: bubble.omega0,
            beta: bubble.beta,
        }
    }

    /// A bubble of `radius` metres whose undamped frequency, in Hz, a file says; the decay follows from both
    /// (HF 37–38, CB 3–5).
    pub fn of_frequency(radius: f64, hertz: f64) -> Self {
        let omega0 = 2.0 * PI * hertz;
        let radiation = omega0 * radius / C_WATER;
        let viscous = 4.0 * VISCOSITY / (RHO * omega0 * radius * radius);
        let g_thermal = 3.0 * GAMMA * P0 / (4.0 * PI * RHO * GAS_DIFFUSIVITY);
        let psi = 16.0 / (9.0 * (GAMMA - 1.0) * (GAMMA - 1.0)) * g_thermal / hertz;
        // Below ψ = 4 (about 4 MHz) the formula has no value; nothing near is heard.
        let psi = psi.max(5.0);
        let thermal =
            2.0 * ((psi - 3.0).sqrt() - (3.0 * GAMMA - 1.0) / (3.0 * (GAMMA - 1.0))) / (psi - 4.0);
        let delta = radiation + viscous + thermal;
        Self {
            omega0,
            beta: omega0 * delta / (delta * delta + 4.0).sqrt(),
        }
    }

    /// Angular frequency of the ringing, rad/s.
    pub fn omega_d(&self) -> f64 {
        (self.omega0 * self.omega0 - self.beta * self.beta)
            .max(0.0)
            .sqrt()
    }
}

/// A bubble's coefficients at a sample rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    /// What stands beside M̃ on the diagonal, `E' + c/2`.
    pub extra: f64,
    /// Damping.
    pub c: f64,
    /// Stiffness.
    pub k: f64,
    /// What a force in 1/s² of y is multiplied by: h², and what makes the answer to an impulse exact.
    pub push: f64,
}

impl Step {
    /// For a bubble in a cloud whose mass matrix has no eigenvalue below `least`.
    pub fn new(tone: &Tone, rate: f64, least: f64) -> Self {
        let h = 1.0 / rate;
        let theta = tone.omega_d() * h;
        let decay = (-tone.beta * h).exp();
        // y⁺ = z1·y − z2·y⁻.
        let z1 = 2.0 * decay * theta.cos();
        let z2 = decay * decay;
        // c and k over the whole diagonal 1 + E.
        let c = 1.0 - z2;
        let k = 1.0 - z1 + z2;
        let numerov = 1.0 / (1.0 - k / 12.0 - c / 2.0);
        let held = (1.0 - least) / (1.0 - k / 4.0 - c / 2.0);
        let whole = numerov.max(held);
        Self {
            extra: whole - 1.0,
            c: c * whole,
            k: k * whole,
            push: h * h * whole * decay * theta.sin() / theta.max(1e-12),
        }
    }

    /// The part of the diagonal that the discrete energy lacks, `E' − K/4`; at least −`least` of [`Step::new`].
    pub fn slack(&self) -> f64 {
        self.extra - self.c / 2.0 - self.k / 4.0
    }
}

/// From second differences to the second derivative: what `a` lacks at high pitch, the same for every bubble. A symmetric
/// filter, within 0.05 % of `θ²/(2 − 2cos θ)` up to a quarter of the sample rate and 1 % up to a third.
#[derive(Clone, Debug)]
pub struct Sharpen {
    taps: [f64; Sharpen::TAPS],
    past: [f64; Sharpen::TAPS],
}

impl Sharpen {
    /// Samples by which the output comes late.
    pub const REACH: usize = 6;
    const TAPS: usize = 2 * Self::REACH + 1;

    /// At rest.
    pub fn new() -> Self {
        // θ² is a series in δ² = 2 − 2cos θ, that of (arcsin x)² with x² = δ²/4.
        let mut taps = [0.0; Self::TAPS];
        let mut power = [0.0; Self::TAPS];
        power[Self::REACH] = 1.0;
        let mut weight = 1.0;
        for n in 0..=Self::REACH {
            for (tap, power) in taps.iter_mut().zip(&power) {
                *tap += weight * power;
            }
            let before = power;
            let at = |i: Option<usize>| i.and_then(|i| before.get(i)).copied().unwrap_or(0.0);
            for (i, power) in power.iter_mut().enumerate() {
                *power = 2.0 * before[i] - at(i.checked_sub(1)) - at(Some(i + 1));
            }
            let next = (n + 1) as f64;
            weight *= 2.0 * next * next / ((2.0 * next + 1.0) * (next + 1.0)) / 4.0;
        }
        Self {
            taps,
            past: [0.0; Self::TAPS],
        }
    }

    /// Takes the next second difference, gives the second derivative (times h²) of [`Self::REACH`] samples ago.
    pub fn next(&mut self, value: f64) -> f64 {
        self.past.rotate_left(1);
        self.past[Self::TAPS - 1] = value;
        self.taps.iter().zip(&self.past).map(|(a, b)| a * b).sum()
    }
}

impl Default for Sharpen {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_derivative_is_within_its_bounds() {
        for (turns, bound) in [
            (0.01, 1e-6),
            (0.1, 1e-6),
            (0.2, 1e-4),
            (0.25, 5e-4),
            (0.333, 0.0105),
        ] {
            let theta = 2.0 * PI * turns;
            let mut sharpen = Sharpen::new();
            let sine = |n: f64| (theta * n).sin();
            let mut worst = 0.0f64;
            for n in 0..200 {
                let n = f64::from(n);
                let got = sharpen.next(sine(n + 1.0) - 2.0 * sine(n) + sine(n - 1.0));
                let wanted = -theta * theta * sine(n - Sharpen::REACH as f64);
                if n > 20.0 {
                    worst = worst.max((got - wanted).abs() / (theta * theta));
                }
            }
            assert!(worst < bound, "{turns}: {worst}");
        }
    }

    #[test]
    fn a_lone_bubble_keeps_pitch_decay_and_amplitude_at_any_rate() {
        for radius in [0.2e-3, 0.3e-3, 1e-3, 3e-3, 10e-3, 150e-3] {
            for rate in [22_050.0, 48_000.0, 192_000.0] {
                let tone = Tone::of_radius(radius);
                let theta = tone.omega_d() / rate;
                if theta > 0.95 * PI {
                    continue;
                }
                for least in [0.0, 0.5, 0.9] {
                    let step = Step::new(&tone, rate, least);
                    let (mut y, mut v) = (0.0, 0.0);
                    let mut force = step.push;
                    for n in 1..400 {
                        let a = (force - step.c * v - step.k * y) / (1.0 + step.extra);
                        force = 0.0;
                        v += a;
                        y += v;
                        // Impulse of 1/h for a sample: y = e^(−βt) sin(ω_d t)·h/ω_d.
                        let n = f64::from(n);
                        let wanted = (-tone.beta * n / rate).exp() * (theta * n).sin();
                        let got = y * rate * tone.omega_d();
                        assert!(
                            (got - wanted).abs() < 1e-6,
                            "{radius} {rate} {n}: {got} {wanted}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_tone_by_frequency_is_the_one_by_radius() {
        for radius in [0.15e-3, 1e-3, 20e-3] {
            let a = Tone::of_radius(radius);
            let b = Tone::of_frequency(radius, a.omega0 / (2.0 * PI));
            assert!(
                (a.beta / b.beta - 1.0).abs() < 1e-9 && (a.omega0 / b.omega0 - 1.0).abs() < 1e-12
            );
        }
    }
}
