//! Falling drops: each makes one main bubble and a few smaller ones shortly after (vdD figure 4). Control path.

use heapless::Vec;

use crate::bubble::{RADIUS_MAX, RADIUS_MIN};
use crate::fixed::cosine;
use crate::frame::{BLOCKS_PER_TICK, TICK};
use crate::random::{Random, Stream};
use crate::voices::{Pitch, Strike};

/// Most bubbles that drops start in one tick; others wait for the next one. The densest rain has 1.1 on average.
pub const STRIKES: usize = 3;
// The audio path takes one in a block.
const _: () = assert!(STRIKES <= BLOCKS_PER_TICK);

/// What the drops need of the parameters; see the parameter table.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Drops a second.
    pub rate: f32,
    /// 0: Poisson; 1: even but for 3 %.
    pub regularity: f32,
    /// Median radius of the main bubble, m.
    pub radius: f32,
    /// Deviation of its logarithm.
    pub spread: f32,
    /// Mean number of bubbles.
    pub bubbles: f32,
    /// Pressure of the main bubble, Pa.
    pub pressure: f32,
    /// Rise factor ξ.
    pub rise_factor: f32,
    /// Stage width.
    pub width: f32,
}

/// The drops' state.
#[derive(Clone, Debug)]
pub struct Drops {
    random: Random,
    sample_rate: f64,
    /// Mean intervals until the next drop.
    next: f64,
    /// The drop that is falling.
    drop: Option<Falling>,
}

/// A drop with bubbles to come.
#[derive(Clone, Copy, Debug)]
struct Falling {
    /// When it falls, frames from the tick's first.
    begin: f32,
    /// Radius of the main bubble, m.
    main: f32,
    /// Where it fell, from 0 (left) to 1.
    place: f32,
    /// Pressure of the main bubble, Pa.
    loudness: f32,
    /// Its next bubble: after how many frames, how large (m) and how loud (Pa).
    after: f32,
    radius: f32,
    pressure: f32,
}

/// A drop's small bubbles follow its main one within about this time, s.
const FOLLOW: f32 = 0.035;

impl Drops {
    /// No drops, until others take their place.
    pub const OFF: Self = Self {
        random: Random::OFF,
        sample_rate: 0.0,
        next: 0.0,
        drop: None,
    };

    /// The first drop falls within the first mean interval.
    pub fn new(seed: u64, sample_rate: f64) -> Self {
        let mut random = Random::new(seed, Stream::Drops);
        let next = 0.5 * f64::from(random.uniform());
        Self {
            random,
            sample_rate,
            next,
            drop: None,
        }
    }

    /// Adds the bubbles of a tick's drops, which fall in the tick after it: so the audio path can take them one by one.
    pub fn tick(&mut self, settings: &Settings, strikes: &mut Vec<Strike, STRIKES>) {
        let per_tick = f64::from(settings.rate) * TICK as f64 / self.sample_rate;
        while !strikes.is_full() {
            if let Some(drop) = self.drop.take() {
                let strike = drop.strike(settings, &mut self.random, self.sample_rate);
                // There is room: the loop asks.
                let _ = strikes.push(strike);
                self.drop = drop.follow(settings, &mut self.random, self.sample_rate as f32);
            } else if self.next < per_tick {
                let begin = (1.0 + (self.next / per_tick) as f32) * TICK as f32;
                self.drop = Some(Falling::new(begin, settings, &mut self.random));
                let even = 1.0 + 0.03 * self.random.normal();
                let random = self.random.exponential();
                let gap = settings.regularity * even + (1.0 - settings.regularity) * random;
                self.next += f64::from(gap.max(0.01));
            } else {
                break;
            }
        }
        self.next -= per_tick;
        if let Some(drop) = &mut self.drop {
            drop.begin -= TICK as f32;
        }
    }
}

impl Falling {
    fn new(begin: f32, settings: &Settings, random: &mut Random) -> Self {
        let main = settings.radius * libm::expf(settings.spread * random.normal());
        let place = 0.5 + settings.width * (random.uniform() - 0.5);
        let loudness = settings.pressure * (0.4 + 0.6 * random.uniform());
        Self {
            begin,
            main,
            place,
            loudness,
            after: 0.0,
            radius: main,
            pressure: loudness,
        }
    }

    /// Its next bubble.
    fn strike(&self, settings: &Settings, random: &mut Random, sample_rate: f64) -> Strike {
        let rise = settings.rise_factor * 2.0 * random.uniform();
        let radius = self.radius.clamp(RADIUS_MIN as f32, RADIUS_MAX as f32);
        let pitch = Pitch::new(radius, rise, sample_rate);
        let at = f64::from((self.begin + self.after).max(TICK as f32));
        Strike::new(pitch, at, pan(self.pressure, self.place))
    }

    /// The same drop before its bubble after that, where there is one.
    fn follow(
        mut self,
        settings: &Settings,
        random: &mut Random,
        sample_rate: f32,
    ) -> Option<Self> {
        // How many follow: geometric, of the wanted mean.
        if random.uniform() >= (settings.bubbles - 1.0) / settings.bubbles {
            return None;
        }
        self.radius = self.main * (0.25 + 0.6 * random.uniform());
        self.pressure = self.loudness * (0.1 + 0.5 * random.uniform());
        self.after = (FOLLOW * random.exponential()).min(0.3) * sample_rate;
        Some(self)
    }
}

/// The two ears' gains, Q28, of `pressure` Pa at `place` from 0 (left) to 1.
fn pan(pressure: f32, place: f32) -> [i32; 2] {
    const Q28: f32 = (1u32 << 28) as f32;
    let gain = core::f32::consts::SQRT_2 * pressure * Q28;
    [place, 1.0 - place].map(|place| (gain * cosine(0.25 * place)) as i32)
}
