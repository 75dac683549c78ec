//! Waves that come and go: a slow, irregular envelope of the birth rate. Control path.

use crate::fixed::cosine;
use crate::random::{Random, Stream};

/// What the swell needs of the parameters; see the parameter table.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Mean time from wave to wave, s.
    pub period: f32,
    /// From 0 to 1.
    pub irregularity: f32,
    /// Part of a wave in which it grows.
    pub attack: f32,
}

/// The wave under way.
#[derive(Clone, Debug)]
pub struct Swell {
    random: Random,
    /// How far the wave has come, from 0 to 1.
    at: f32,
    /// Its length in periods, and its height.
    length: f32,
    height: f32,
}

impl Swell {
    /// No wave, until another takes its place.
    pub const OFF: Self = Self {
        random: Random::OFF,
        at: 0.0,
        length: 0.0,
        height: 0.0,
    };

    /// Somewhere in a wave.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Swell);
        let at = random.uniform();
        Self {
            random,
            at,
            length: 1.0,
            height: 1.0,
        }
    }

    /// Goes on by `seconds` and returns how high the water stands, from 0 to 1.
    pub fn advance(&mut self, seconds: f32, settings: &Settings) -> f32 {
        self.at += seconds / (settings.period * self.length).max(0.05);
        if self.at >= 1.0 {
            self.at -= 1.0;
            if self.at >= 1.0 {
                self.at = 0.0;
            }
            let free = settings.irregularity;
            self.length = 1.0 + free * (self.random.uniform() - 0.5);
            self.height = 1.0 - 0.5 * free * self.random.uniform();
        }
        // A raised cosine up, and a longer one down: no corner anywhere.
        let attack = settings.attack;
        let part = if self.at < attack {
            self.at / attack
        } else {
            (1.0 - self.at) / (1.0 - attack)
        };
        self.height * 0.5 * (1.0 - cosine(0.5 * part))
    }
}
