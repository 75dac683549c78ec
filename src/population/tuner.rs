//! Other radii: pitch and decay want f64, so they are reckoned a few classes a tick, and have a date.

use heapless::Vec;

use super::CLASSES;
use crate::bubble::Ringing;
use crate::fixed::{exp2_neg, high, sine_cosine};
use crate::frame::TICK;
use crate::resonator::{Form, Tuning};
use crate::voices::Pitch;

/// Classes tuned in a tick.
pub const SLICE: usize = 1;
/// Time from one change of radii to the work on the next, s: what an old bank has to ring out.
const RING_OUT: f64 = 0.213;

/// Radii of all classes, evenly spaced by ratio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radii {
    /// The smallest, mm.
    pub min: f32,
    /// The largest, mm.
    pub max: f32,
    /// How many, from 1 to [`CLASSES`].
    pub classes: usize,
}

impl Radii {
    /// Intervals between classes.
    fn intervals(&self) -> usize {
        self.classes.saturating_sub(1).max(1)
    }

    /// From each radius to the next one.
    pub(super) fn ratio(&self) -> f64 {
        let [min, max] = [self.min, self.max].map(f64::from);
        libm::exp(libm::log(max / min) / self.intervals() as f64)
    }

    /// The smallest radius in millimetres to the power of `exponent`, and the ratio to the next one.
    pub(super) fn power(&self, exponent: f32) -> (f32, f32) {
        let step = libm::logf(self.max / self.min) / self.intervals() as f32;
        let first = libm::logf(self.min);
        (libm::expf(exponent * first), libm::expf(exponent * step))
    }
}

/// What one bubble of 1 Pa is to the resonator of its class.
#[derive(Clone, Copy, Debug)]
pub struct UnitImpulse {
    /// Decay in powers of two a sample, Q31.
    pub(super) decay: u32,
    /// Turns a sample, Q32.
    pub(super) step: u32,
    /// The second state word of a bubble of phase φ is `second[0]·sin φ + second[1]·cos φ`, Q30.
    pub(super) second: [i32; 2],
    /// How much louder it would have been one sample before it is born.
    pub(super) growth: f32,
    /// Mean of both words it strikes with, over a birth at any time in the sample.
    pub(super) mean: [f32; 2],
    /// Cholesky factor of their second moments.
    pub(super) spread: [f32; 3],
}

/// Abscissae and weights of Gauss and Legendre for 6 points, over (0, 1): half of them, the rest by symmetry. The words
/// turn by less than half a turn in a sample, which leaves an error of 4e-7.
const POINTS: [[f32; 2]; 3] = [
    [0.033_765_24, 0.085_662_246],
    [0.169_395_31, 0.180_380_79],
    [0.380_690_4, 0.233_956_97],
];

impl UnitImpulse {
    /// No bubble.
    pub const NONE: Self = Self {
        decay: 0,
        step: 0,
        second: [0; 2],
        growth: 0.0,
        mean: [0.0; 2],
        spread: [0.0; 3],
    };

    /// The bubbles of a class.
    pub fn new(tuning: &Tuning) -> Self {
        if tuning.form == Form::Silent {
            return Self::NONE;
        }
        let (decay, step) = tuning.pace();
        let growth = Q31 / exp2_neg(tuning.decay_over(u32::MAX)) as f32;
        let (mut mean, mut square) = ([0.0; 2], [0.0; 3]);
        for [place, weight] in POINTS {
            for place in [place, 1.0 - place] {
                // As a birth strikes: the decay from the sample before, and the phase back to it.
                let rest = ((1.0 - place) * Q32) as u32;
                let level = exp2_neg(tuning.decay_over(rest)) as f32 / Q31 * growth;
                let phase = high(step, rest).wrapping_sub(step);
                let (first, second) = tuning.words(sine_cosine(phase));
                let [a, b] = [first, second].map(|word| word as f32 / Q30 * level);
                mean[0] += weight * a;
                mean[1] += weight * b;
                square[0] += weight * a * a;
                square[1] += weight * a * b;
                square[2] += weight * b * b;
            }
        }
        let [aa, ab, bb] = square;
        let a = libm::sqrtf(aa);
        let b = ab / a;
        Self {
            decay,
            step,
            second: tuning.second(),
            growth,
            mean,
            spread: [a, b, libm::sqrtf((bb - b * b).max(0.0))],
        }
    }
}

const Q30: f32 = (1u64 << 30) as f32;
const Q31: f32 = (1u64 << 31) as f32;
const Q32: f32 = (1u64 << 32) as f32;

/// A radius class: its resonator, and the pitch of its rising bubbles.
#[derive(Clone, Copy, Debug)]
pub struct Class {
    pub(super) tuning: Tuning,
    pub(super) pitch: Pitch,
}

impl Class {
    fn new(radius: f64, rise_factor: f32, sample_rate: f64) -> Self {
        let ringing = Ringing::new(radius as f32, sample_rate);
        Self {
            tuning: Tuning::of(&ringing),
            pitch: Pitch::of(&ringing, rise_factor),
        }
    }
}

/// Which of the two banks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The one that is struck now. Not 0: so a [`Tuner`] that is off is zero all over.
    Live = 1,
    /// The other one, which has rung out.
    Next,
}

/// Some classes for the audio path's banks.
#[derive(Clone, Debug)]
pub struct Slice {
    pub(super) place: Place,
    /// Which class comes first.
    pub(super) first: usize,
    pub(super) classes: Vec<Class, SLICE>,
    /// From here on births go to the next bank.
    pub(super) switch: bool,
}

impl Slice {
    /// Whether other radii sound from here on.
    pub fn switches(&self) -> bool {
        self.switch
    }
}

/// Classes on their way, one slice a tick.
#[derive(Clone, Debug)]
struct Walk {
    place: Place,
    radii: Radii,
    rise_factor: f32,
    /// Which class is next, and its radius, m.
    next: usize,
    radius: f64,
    ratio: f64,
}

impl Walk {
    fn new(place: Place, radii: Radii, rise_factor: f32) -> Self {
        Self {
            place,
            radii,
            rise_factor,
            next: 0,
            radius: f64::from(radii.min) * 1e-3,
            ratio: radii.ratio(),
        }
    }

    fn is_done(&self) -> bool {
        self.next == self.radii.classes
    }

    /// Slices to come.
    fn left(&self) -> u32 {
        (self.radii.classes - self.next).div_ceil(SLICE) as u32
    }

    fn slice(&mut self, sample_rate: f64) -> Slice {
        let first = self.next;
        let mut classes = Vec::new();
        while !self.is_done() && !classes.is_full() {
            let class = Class::new(self.radius, self.rise_factor, sample_rate);
            // There is room: the loop asks.
            let _ = classes.push(class);
            self.radius *= self.ratio;
            self.next += 1;
        }
        Slice {
            place: self.place,
            first,
            classes,
            switch: self.place == Place::Next && self.is_done(),
        }
    }
}

/// Keeps the banks of the audio path tuned to what the parameters ask for.
///
/// Other radii are worked out from the tick that asks for them on, [`SLICE`] classes a tick, and sound from the last of
/// these on; another rise factor reaches each class with its slice. What is asked for meanwhile waits; other radii
/// also wait until the bank before the last has rung out, 0.213 s after the last change.
#[derive(Clone, Debug)]
pub struct Tuner {
    sample_rate: f64,
    /// Ticks in [`RING_OUT`].
    ring_out: u32,
    /// Ticks since the last change of radii.
    since: u32,
    radii: Radii,
    rise_factor: f32,
    /// For the live bank and the next one.
    impulses: [[UnitImpulse; CLASSES]; 2],
    live: usize,
    walk: Option<Walk>,
}

impl Tuner {
    /// Tuned to nothing.
    pub const OFF: Self = Self {
        sample_rate: 0.0,
        ring_out: 0,
        since: 0,
        radii: Radii {
            min: 0.0,
            max: 0.0,
            classes: 0,
        },
        rise_factor: 0.0,
        impulses: [[UnitImpulse::NONE; CLASSES]; 2],
        live: 0,
        walk: None,
    };

    /// Tunes all at once, at the start.
    pub fn start(&mut self, radii: Radii, rise_factor: f32, sample_rate: f64) {
        self.sample_rate = sample_rate;
        self.ring_out = libm::ceil(RING_OUT * sample_rate / TICK as f64) as u32;
        self.since = u32::MAX;
        (self.radii, self.rise_factor) = (radii, rise_factor);
        for slice in self.slices() {
            self.keep(&slice);
        }
    }

    /// The live bank, for an audio path that begins now.
    pub fn slices(&self) -> impl Iterator<Item = Slice> + use<> {
        let sample_rate = self.sample_rate;
        let mut walk = Walk::new(Place::Live, self.radii, self.rise_factor);
        core::iter::from_fn(move || (!walk.is_done()).then(|| walk.slice(sample_rate)))
    }

    /// One tick on: what the audio path's banks should take.
    pub fn tick(&mut self, radii: Radii, rise_factor: f32) -> Option<Slice> {
        self.since = self.since.saturating_add(1);
        let retuning = (self.walk.as_ref()).is_some_and(|walk| walk.place == Place::Next);
        if !retuning {
            if radii != self.radii && self.since >= self.ring_out {
                self.walk = Some(Walk::new(Place::Next, radii, rise_factor));
            } else if self.walk.is_none() && rise_factor != self.rise_factor {
                self.walk = Some(Walk::new(Place::Live, self.radii, rise_factor));
            }
        }
        let walk = self.walk.as_mut()?;
        let slice = walk.slice(self.sample_rate);
        if walk.is_done() {
            (self.radii, self.rise_factor) = (walk.radii, walk.rise_factor);
            self.walk = None;
        }
        self.keep(&slice);
        if slice.switch {
            self.live ^= 1;
            self.since = 0;
        }
        Some(slice)
    }

    /// In how many ticks `radii` sound, if they are asked for from the next tick on; 0: they do so now.
    pub fn due(&self, radii: &Radii) -> u32 {
        let slices = radii.classes.div_ceil(SLICE) as u32;
        match &self.walk {
            Some(walk) if walk.place == Place::Next && walk.radii == *radii => walk.left(),
            Some(walk) if walk.place == Place::Next => walk.left() + self.ring_out + slices - 1,
            _ if self.radii == *radii => 0,
            _ => self.ring_out.saturating_sub(self.since).max(1) + slices - 1,
        }
    }

    fn keep(&mut self, slice: &Slice) {
        let bank = match slice.place {
            // Only its pitches are other ones, except at the start.
            Place::Live => self.live,
            Place::Next => self.live ^ 1,
        };
        for (impulse, class) in self.impulses[bank][slice.first..]
            .iter_mut()
            .zip(&slice.classes)
        {
            *impulse = UnitImpulse::new(&class.tuning);
        }
    }

    /// What sounds now.
    pub fn live(&self) -> (&Radii, &[UnitImpulse; CLASSES]) {
        (&self.radii, &self.impulses[self.live])
    }
}
