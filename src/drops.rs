//! Falling drops: each makes one main bubble and a few smaller ones shortly after (vdD figure 4). Control path.

use heapless::Vec;

use crate::bubble::{RADIUS_MAX, RADIUS_MIN};
use crate::fixed::to_fixed;
use crate::frame::TICK;
use crate::random::{Random, Stream};
use crate::voices::{Pitch, Strike};

/// Most bubbles that drops start in one tick.
pub const STRIKES: usize = 24;

/// What the drops need of the parameters; see the parameter table.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Drops a second.
    pub rate: f64,
    /// 0: Poisson; 1: even but for 3 %.
    pub regularity: f64,
    /// Median radius of the main bubble, m.
    pub radius: f64,
    /// Deviation of its logarithm.
    pub spread: f64,
    /// Mean number of bubbles.
    pub bubbles: f64,
    /// Pressure of the main bubble, Pa.
    pub pressure: f64,
    /// Rise factor ξ.
    pub rise_factor: f64,
    /// Stage width.
    pub width: f64,
}

/// The drops' state.
#[derive(Clone, Debug)]
pub struct Drops {
    random: Random,
    /// Mean intervals until the next drop.
    next: f64,
}

/// A drop's small bubbles follow its main one within about this time, s.
const FOLLOW: f64 = 0.035;

impl Drops {
    /// The first drop falls within the first mean interval.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Drops);
        let next = 0.5 * random.uniform();
        Self { random, next }
    }

    /// The bubbles that begin in the next tick or shortly after, at `sample_rate` Hz.
    pub fn tick(&mut self, settings: &Settings, sample_rate: f64) -> Vec<Strike, STRIKES> {
        let mut strikes = Vec::new();
        let per_tick = settings.rate * TICK as f64 / sample_rate;
        while self.next < per_tick {
            let begin = self.next / per_tick * TICK as f64;
            self.drop(begin, settings, sample_rate, &mut strikes);
            let even = 1.0 + 0.03 * self.random.normal();
            let random = self.random.exponential();
            let gap = settings.regularity * even + (1.0 - settings.regularity) * random;
            self.next += gap.max(0.01);
        }
        self.next -= per_tick;
        strikes
    }

    /// One drop at `begin` frames into the tick.
    fn drop(
        &mut self,
        begin: f64,
        settings: &Settings,
        sample_rate: f64,
        strikes: &mut Vec<Strike, STRIKES>,
    ) {
        let random = &mut self.random;
        let main = settings.radius * libm::exp(settings.spread * random.normal());
        let angle = 0.5 + settings.width * (random.uniform() - 0.5);
        let loudness = 0.4 + 0.6 * random.uniform();
        // How many follow: geometric, of the wanted mean.
        let more = (settings.bubbles - 1.0) / settings.bubbles;
        let mut radius = main;
        let mut pressure = settings.pressure * loudness;
        let mut at = begin;
        loop {
            let rise = settings.rise_factor * 2.0 * random.uniform();
            let clamped = radius.clamp(RADIUS_MIN, RADIUS_MAX) as f32;
            let pitch = Pitch::new(clamped, rise as f32, sample_rate);
            let strike = Strike::new(pitch, at, pan(pressure, angle));
            if strikes.push(strike).is_err() || random.uniform() >= more {
                return;
            }
            radius = main * (0.25 + 0.6 * random.uniform());
            pressure = settings.pressure * loudness * (0.1 + 0.5 * random.uniform());
            at = begin + (FOLLOW * random.exponential()).min(0.3) * sample_rate;
        }
    }
}

/// The two ears' gains, Q28, of `pressure` Pa at `position` from 0 (left) to 1.
fn pan(pressure: f64, position: f64) -> [i32; 2] {
    let angle = core::f64::consts::FRAC_PI_2 * position;
    let gain = core::f64::consts::SQRT_2 * pressure;
    [gain * libm::cos(angle), gain * libm::sin(angle)].map(|g| to_fixed(g, 28))
}
