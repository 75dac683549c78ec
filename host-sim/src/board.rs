//! The instrument in the capacities of a board or of the desk.

use clap::ValueEnum;
use freshet::cloud::Work;
use freshet::control::Control;
use freshet::mix::Output;
use freshet::observer::Observer;
use freshet::population::{CLASSES, Crowd};
use freshet::profile::{F407, F411, H743, Limits, Profile, limits};
use freshet::scene::Scene;
use freshet::stats::Stats;
use freshet::voices::{Strike, Voice};
use freshet::{Frame, Instrument, Update};

/// The desk's capacities: 12 288 voices sounding, a million births a second.
#[derive(Clone, Copy, Debug)]
pub struct Desk;

impl Profile for Desk {
    const NAME: &'static str = "desk";
    const VOICES: usize = 16_384;
    const LIMITS: Limits = limits([1e6; 2], [CLASSES; 2], H743::LIMITS.bubbles);
    const BIRTHS_PER_BLOCK: u32 = 8_192;
    type Voices = Vec<Voice>;
    const IDLE: Self::Voices = Vec::new();
    fn make_room(voices: &mut Self::Voices) {
        voices.resize(Self::VOICES, Voice::IDLE);
    }
    /// Any class may be a crowd: sample rates go down to 8 kHz.
    type Update = Update<[Crowd; CLASSES]>;
    fn update() -> Self::Update {
        Update::new()
    }
    type Cloud = <H743 as Profile>::Cloud;
    const CLOUD: Self::Cloud = H743::CLOUD;
    type Keeper = <H743 as Profile>::Keeper;
    const KEEPER: Self::Keeper = H743::KEEPER;
}

/// Whose capacities to play with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Board {
    /// No board: the desk's own capacities.
    Desk,
    /// STM32F407, 168 MHz.
    F407,
    /// STM32F411, 100 MHz.
    F411,
    /// STM32H743, 480 MHz.
    H743,
}

/// An instrument of any profile.
pub trait Player: Send {
    /// Fills `out`.
    fn render(&mut self, out: &mut [Frame]);
    /// Fills `out` and tells `observer` of every birth.
    fn render_observed(&mut self, out: &mut [Frame], observer: &mut dyn Observer);
    /// Sounds a single bubble, counted from the next block's first frame.
    fn strike(&mut self, strike: &Strike, observer: &mut dyn Observer);
    /// The control path.
    fn control(&mut self) -> &mut Control;
    /// The same, to look at.
    fn parameters(&self) -> &Control;
    /// The frame from which on what is set now is heard.
    fn date(&self) -> u64;
    /// Frames rendered by the audio path.
    fn frame(&self) -> u64;
    /// Counters since the start.
    fn stats(&self) -> Stats;
    /// Voices sounding now.
    fn voices(&self) -> usize;
    /// Classes that ring now.
    fn ringing(&self) -> usize;
    /// What the cloud has done.
    fn cloud(&self) -> Work;
    /// Whether no bubble rings.
    fn is_silent(&self) -> bool;
    /// Continues counting from elsewhere.
    fn preset_counters(&mut self, frame: u64, stats: Stats);
}

impl<P: Profile> Player for Instrument<P> {
    fn render(&mut self, out: &mut [Frame]) {
        self.render(out, &mut ());
    }
    fn render_observed(&mut self, out: &mut [Frame], mut observer: &mut dyn Observer) {
        self.render(out, &mut observer);
    }
    fn strike(&mut self, strike: &Strike, mut observer: &mut dyn Observer) {
        self.strike(strike, &mut observer);
    }
    fn control(&mut self) -> &mut Control {
        &mut self.control
    }
    fn parameters(&self) -> &Control {
        &self.control
    }
    fn date(&self) -> u64 {
        self.date()
    }
    fn frame(&self) -> u64 {
        self.synth().frame()
    }
    fn stats(&self) -> Stats {
        *self.synth().stats()
    }
    fn voices(&self) -> usize {
        self.synth().voices()
    }
    fn ringing(&self) -> usize {
        self.synth().ringing()
    }
    fn cloud(&self) -> Work {
        self.synth().cloud()
    }
    fn is_silent(&self) -> bool {
        self.synth().is_silent()
    }
    fn preset_counters(&mut self, frame: u64, stats: Stats) {
        self.synth_mut().preset_counters(frame, stats);
    }
}

impl Board {
    /// The instrument, playing `scene` at `rate` Hz.
    pub fn player(self, scene: &Scene, rate: u32, seed: u64, output: Output) -> Box<dyn Player> {
        match self {
            Self::Desk => Box::new(Instrument::<Desk>::new(scene, rate, seed, output)),
            Self::F407 => Box::new(Instrument::<F407>::new(scene, rate, seed, output)),
            Self::F411 => Box::new(Instrument::<F411>::new(scene, rate, seed, output)),
            Self::H743 => Box::new(Instrument::<H743>::new(scene, rate, seed, output)),
        }
    }

    /// What it takes of the parameters.
    pub fn limits(self) -> Limits {
        match self {
            Self::Desk => Desk::LIMITS,
            Self::F407 => F407::LIMITS,
            Self::F411 => F411::LIMITS,
            Self::H743 => H743::LIMITS,
        }
    }

    /// Cycles of the core in a second, and how many of them an instruction of ours takes: a model, for no emulator counts
    /// cycles. None for the desk.
    pub fn core(self) -> Option<(f64, f64)> {
        match self {
            Self::Desk => None,
            Self::F407 => Some((168e6, 2.0)),
            Self::F411 => Some((96e6, 2.0)),
            Self::H743 => Some((480e6, 2.0)),
        }
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Desk => Desk::NAME,
            Self::F407 => F407::NAME,
            Self::F411 => F411::NAME,
            Self::H743 => H743::NAME,
        }
    }
}
