//! One row of a texture: the flow at one speed, and what each receiver hears of it.
//!
//! All times go as h/u, so that every row is resolved alike whatever its speed: an eddy of four cells, carried past, is
//! the end of the band; a row has 3.125 samples for each period of that, and a step is a third of a sample.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::energy_spectrum::EnergySpectrum;
use super::fire_file::Fire;
use super::flow::{Flow, Forces, Spent, State};
use super::inflow::Inflow;
use super::vortex_sound::{Band, Moments, Volume, pressure, third_derivative, toward};

/// Cells in the shortest period that is heard.
const SHORTEST: f64 = 4.0;
/// Samples in that period.
const OVERSAMPLING: f64 = 3.125;
/// Steps a sample.
pub const STEPS: usize = 3;
/// Samples before and after what is used, for the derivative's sake.
const MARGIN: usize = 64;
/// Part of the loop over which its end goes over into its beginning.
const FADE: f64 = 1.0 / 8.0;
/// The source volume is windowed all the way, from either end to the middle: the smoother, the less is heard of what
/// merely passes.
pub const TAPER: [f64; 3] = [0.5; 3];
/// Flow-throughs compared to tell whether the flow is steady, and how alike the mean energies must be.
const COMPARED: usize = 4;
const ALIKE: f64 = 0.1;
/// Most flow-throughs before it is recorded nevertheless, and said.
const PATIENCE: usize = 40;

/// What there is to do for one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Samples of the loop.
    pub samples: usize,
    /// Samples of the fade.
    pub fade: usize,
    /// Length of a step, s.
    pub dt: f64,
    /// Steps while the flow crosses the box once.
    pub crossing: usize,
    /// Steps that are recorded.
    pub recorded: usize,
    /// What is heard.
    pub band: Band,
}

impl Plan {
    /// The plan for one speed of a fire.
    pub fn new(fire: &Fire, speed: f64) -> Self {
        let grid = fire.grid();
        let stop = speed / (SHORTEST * grid.h);
        let samples = (fire.seconds * stop * OVERSAMPLING)
            .ceil()
            .max(2.0 * MARGIN as f64) as usize;
        let dt = fire.seconds / (samples * STEPS) as f64;
        let fade = (samples as f64 * FADE) as usize;
        let height = fire.cells[2] as f64 * grid.h;
        Self {
            samples,
            fade,
            dt,
            crossing: (height / speed / dt).ceil() as usize,
            recorded: (samples + fade + 2 * MARGIN) * STEPS,
            band: Band {
                from: speed / height,
                pass: 0.7 * stop,
                stop,
            },
        }
    }

    /// Steps in all, if the flow settles as soon as can be.
    pub fn steps(&self) -> usize {
        2 * COMPARED * self.crossing + self.recorded
    }
}

/// How far a row has come; kept in a file while it is computed.
#[derive(Clone, Default, Serialize, Deserialize)]
pub struct Progress {
    /// Energy of the flow after each step until it was steady.
    pub settling: Vec<f64>,
    /// Whether it is.
    pub settled: bool,
    /// The source after each step from then on.
    pub moments: Vec<Moments>,
    /// Energy after each of them.
    pub energies: Vec<f64>,
    /// By size of the eddies.
    pub spectrum: EnergySpectrum,
    /// Largest relative divergence seen.
    pub divergence: f64,
}

/// A row in the making.
pub struct Row {
    /// What is to be done.
    pub plan: Plan,
    /// What has been done.
    pub progress: Progress,
    /// The flow.
    pub flow: Flow,
    /// Time spent on the source and its statistics.
    pub listening: Duration,
    speed: f64,
    inflow: Inflow,
    volume: Volume,
}

impl Row {
    /// The flow at `speed` before its first step; `index` makes rows differ.
    pub fn new(fire: &Fire, speed: f64, index: usize) -> Self {
        let grid = fire.grid();
        let seed = fire.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ index as u64;
        let inflow = Inflow::new(grid, speed, fire.perturbation, fire.eddy, seed);
        let forces = Forces {
            confinement: fire.confinement * speed,
            viscosity: fire.viscosity,
        };
        let mut flow = Flow::new(grid, forces);
        inflow.fill_box(&mut flow.velocity, 0.0);
        flow.start();
        Self {
            plan: Plan::new(fire, speed),
            progress: Progress {
                spectrum: EnergySpectrum::new(&grid),
                ..Progress::default()
            },
            flow,
            listening: Duration::ZERO,
            speed,
            inflow,
            volume: Volume::new(&grid, TAPER),
        }
    }

    /// What [`resume`](Self::resume) takes.
    pub fn state(&self) -> (Progress, State) {
        (self.progress.clone(), self.flow.state())
    }

    /// Goes on where an earlier run was; false where that does not fit.
    pub fn resume(&mut self, (progress, state): (Progress, State)) -> bool {
        let fits = progress.moments.len() <= self.plan.recorded && self.flow.resume(state);
        if fits {
            self.progress = progress;
        }
        fits
    }

    /// Whether all is recorded.
    pub fn is_done(&self) -> bool {
        self.progress.moments.len() == self.plan.recorded
    }

    /// One step.
    pub fn step(&mut self) {
        let progress = &self.progress;
        let step = progress.settling.len() + progress.moments.len() + 1;
        let time = step as f64 * self.plan.dt;
        self.flow.step(self.plan.dt, Some((&self.inflow, time)));
        let start = Instant::now();
        let energy = self.flow.energy(self.speed);
        let crossing = self.plan.crossing;
        let progress = &mut self.progress;
        if !progress.settled {
            progress.settling.push(energy);
            let passed = progress.settling.len();
            if passed.is_multiple_of(crossing) {
                let patience = passed >= PATIENCE * crossing;
                progress.settled = patience || is_steady(&progress.settling, crossing);
            }
        } else {
            progress.moments.push(self.volume.moments(&self.flow.omega));
            progress.energies.push(energy);
            if progress.moments.len().is_multiple_of(crossing.div_ceil(4)) {
                progress.spectrum.add(&self.flow.grid, &self.flow.velocity);
                let divergence = self.flow.relative_divergence();
                progress.divergence = progress.divergence.max(divergence);
            }
        }
        self.listening += start.elapsed();
    }

    /// The pressure at 1 m toward a receiver, as a loop, Pa.
    pub fn sound(&self, receiver: [f64; 3]) -> Vec<f64> {
        let record = &self.progress.moments;
        let record: Vec<[f64; 4]> = record.iter().map(|m| toward(m, receiver)).collect();
        let Plan {
            samples,
            fade,
            dt,
            band,
            ..
        } = self.plan;
        let third = third_derivative(&record, self.speed, dt, MARGIN * STEPS / 2, band, STEPS);
        let heard: Vec<f64> = third[MARGIN..MARGIN + samples + fade]
            .iter()
            .map(|third| pressure(*third))
            .collect();
        closed(&heard, samples)
    }

    /// Mean energy in the second half of what was recorded over that in the first.
    pub fn drift(&self) -> f64 {
        let (first, second) = self
            .progress
            .energies
            .split_at(self.progress.energies.len() / 2);
        mean(second) / mean(first)
    }

    /// Crossings it took to become steady; none where patience ended first.
    pub fn settled_after(&self) -> Option<usize> {
        let passed = self.progress.settling.len() / self.plan.crossing;
        (passed < PATIENCE).then_some(passed)
    }

    /// Where the time went.
    pub fn spent(&self) -> (Spent, Duration) {
        (self.flow.spent, self.listening)
    }
}

/// Whether the last flow-throughs had as much energy as those before them.
fn is_steady(energies: &[f64], crossing: usize) -> bool {
    let window = COMPARED * crossing;
    let Some(start) = energies.len().checked_sub(2 * window) else {
        return false;
    };
    let (before, after) = energies[start..].split_at(window);
    (mean(after) / mean(before) - 1.0).abs() < ALIKE || mean(before) == 0.0
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

/// A loop of `samples`: what follows its end fades into its beginning, by equal power, for the two know nothing of each
/// other.
fn closed(sound: &[f64], samples: usize) -> Vec<f64> {
    let (body, tail) = sound.split_at(samples);
    let mut closed = body.to_vec();
    for (i, (to, after)) in closed.iter_mut().zip(tail).enumerate() {
        let x = i as f64 / tail.len() as f64;
        // Slopes of the angle are 0 at both ends: no corner where the fade begins.
        let angle = std::f64::consts::FRAC_PI_2 * x * x * (3.0 - 2.0 * x);
        *to = *to * angle.sin() + after * angle.cos();
    }
    closed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flow_that_still_grows_is_not_steady() {
        let crossing = 10;
        let energies = |of: fn(f64) -> f64| -> Vec<f64> {
            (0..2 * COMPARED * crossing).map(|i| of(i as f64)).collect()
        };
        assert!(!is_steady(&energies(|i| i), crossing));
        assert!(!is_steady(&energies(|i| (-i / 40.0).exp()), crossing));
        assert!(is_steady(
            &energies(|i| 1.0 + 0.5 * (i * 0.7).sin()),
            crossing
        ));
        // Not yet to be told.
        assert!(!is_steady(&energies(|_| 1.0)[1..], crossing));
    }

    #[test]
    fn a_loop_begins_as_its_end_goes_on() {
        let sound: Vec<f64> = (0..120).map(f64::from).collect();
        let closed = closed(&sound, 100);
        assert_eq!((closed[0], closed[99]), (100.0, 99.0));
        assert_eq!(closed[20..], sound[20..100]);
    }
}
