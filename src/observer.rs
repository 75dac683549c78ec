//! Watching births, for event logs and reference renderings. The unit type watches nothing and costs nothing.

use crate::resonator::StrikeWords;

/// What became of a bubble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// An impulse into its class's resonator; `gain` is Q27 of a pascal, reckoned at `frame`.
    Class,
    /// A voice; `gain` is Q28 of a pascal, reckoned at the birth.
    Voice,
    /// Not sounded: a single event that found no voice, or more pressure at once than the class takes.
    Dropped,
    /// Above the pitch limit: not sounded.
    TooHigh,
}

/// One bubble.
#[derive(Clone, Copy, Debug)]
pub struct Birth {
    /// The last frame before the birth.
    pub frame: u64,
    /// The time from that frame to the birth, in samples, Q27.
    pub fraction: u32,
    /// Radius, m.
    pub radius: f32,
    /// Rise factor ξ; 0 where the pitch stays.
    pub rise_factor: f32,
    /// Pressure in the two ears; the unit is `path`'s.
    pub gain: [i32; 2],
    /// Radius class, from 0; 255 for a single event.
    pub class: u8,
    /// What became of it.
    pub path: Path,
}

/// One sample of a class with more than one birth a sample: the impulses' sum, drawn by its moments.
#[derive(Clone, Copy, Debug)]
pub struct Crowd {
    /// The frame at which the words are added; they sound from the next one on.
    pub frame: u64,
    /// Radius, m.
    pub radius: f32,
    /// Radius class, from 0.
    pub class: u8,
    /// What is added to the resonators' words.
    pub words: StrikeWords,
    /// How many births that stands for.
    pub births: u64,
    /// [`Path::Class`]; or a whole block that was not sounded, and why.
    pub path: Path,
}

/// Someone who wants to know.
pub trait Observer {
    /// Whether anyone looks at every birth, those too soft to hear among them.
    #[inline(always)]
    fn watches_births(&self) -> bool {
        true
    }
    /// A bubble is born.
    #[inline(always)]
    fn birth(&mut self, _birth: &Birth) {}
    /// A crowd's sample.
    #[inline(always)]
    fn crowd(&mut self, _crowd: &Crowd) {}
}

impl Observer for () {
    #[inline(always)]
    fn watches_births(&self) -> bool {
        false
    }
}

impl<O: Observer + ?Sized> Observer for &mut O {
    #[inline(always)]
    fn watches_births(&self) -> bool {
        (**self).watches_births()
    }
    #[inline(always)]
    fn birth(&mut self, birth: &Birth) {
        (**self).birth(birth);
    }
    #[inline(always)]
    fn crowd(&mut self, crowd: &Crowd) {
        (**self).crowd(crowd);
    }
}
