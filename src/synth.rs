//! The instrument: [`Synth`] is the audio path, [`Instrument`] is the audio path with its control path.

use crate::cloud::{Cloud, Keep, Work};
use crate::control::Control;
use crate::frame::{BLOCK, BLOCKS_PER_TICK, Block, Frame, TICK};
use crate::kernel::voice::Ears;
use crate::mix::{Mix, Output};
use crate::observer::{Birth, Observer, Path};
use crate::population::Population;
use crate::profile::Profile;
use crate::scene::Scene;
use crate::stats::Stats;
use crate::update::Update;
use crate::voices::{Start, Strike, Voices};

/// The audio path: every source, then the mix. Integer arithmetic only.
#[derive(Clone, Debug)]
pub struct Synth<P: Profile> {
    population: Population,
    voices: Voices<P::Voices>,
    cloud: Cloud<P::Cloud>,
    mix: Mix,
    stats: Stats,
    frame: u64,
    /// Which of the update's strikes is next.
    next_strike: usize,
    /// The version of the population's settings in force, see [`Update`].
    water: u32,
}

impl<P: Profile> Synth<P> {
    /// As it is before it starts. All of it is zero, so that a board need not keep it in flash.
    pub const OFF: Self = Self {
        population: Population::SILENT,
        voices: Voices::new(P::IDLE),
        cloud: Cloud::new(P::CLOUD),
        mix: Mix::OFF,
        stats: Stats::NONE,
        frame: 0,
        next_strike: 0,
        water: 0,
    };

    /// A silent instrument that starts with the settings of `control`.
    pub fn new(seed: u64, output: Output, control: &Control, sample_rate: u32) -> Self {
        let mut synth = Self::OFF;
        synth.start(seed, output, control, sample_rate);
        synth
    }

    /// The same in place: on a board no stack would hold it on the way.
    pub fn start(&mut self, seed: u64, output: Output, control: &Control, sample_rate: u32) {
        let sample_rate = f64::from(sample_rate);
        (self.population).start(seed, P::BIRTHS_PER_BLOCK, sample_rate);
        for slice in control.slices() {
            self.population.tune(&slice);
        }
        self.cloud.start(sample_rate);
        self.voices.restart(P::make_room);
        self.mix = Mix::new(output, seed, &control.mix(), sample_rate);
    }

    /// Takes what a tick of the control path changed, before the tick's first block. From here on the update is in
    /// force, until the next one is applied; where that is late, it just stays so.
    pub fn apply(&mut self, update: &Update) {
        if let Some(slice) = &update.slice {
            self.population.tune(slice);
        }
        if update.version != self.water {
            self.water = update.version;
            self.population.apply(&update.water);
        }
        self.cloud.apply(&update.cloud);
        if let Some(mix) = &update.mix {
            self.mix.apply(mix);
        }
        self.next_strike = 0;
    }

    /// Sounds a single bubble, counted from the next block's first frame.
    pub fn strike<O: Observer>(&mut self, strike: &Strike, observer: &mut O) {
        let Self { voices, stats, .. } = self;
        stats.births = stats.births.wrapping_add(1);
        stats.events = stats.events.wrapping_add(1);
        let path = if !strike.pitch.sounds() {
            stats.too_high = stats.too_high.wrapping_add(1);
            Path::TooHigh
        } else {
            let Strike {
                pitch,
                delay,
                age,
                gain,
            } = strike;
            match voices.start(pitch, *delay, *age, *gain) {
                Start::Sounds => Path::Voice,
                Start::Stole => {
                    stats.stolen = stats.stolen.wrapping_add(1);
                    Path::Voice
                }
                Start::Refused => {
                    stats.dropped = stats.dropped.wrapping_add(1);
                    Path::Dropped
                }
            }
        };
        observer.birth(&Birth {
            frame: self
                .frame
                .wrapping_add(u64::from(strike.delay))
                .wrapping_sub(1),
            fraction: (1 << 27) - strike.age,
            radius: strike.pitch.radius,
            rise_factor: strike.pitch.rise_factor,
            gain: strike.gain,
            class: u8::MAX,
            path,
        });
    }

    /// Renders one block under the `update` that is in force.
    pub fn render<O: Observer>(&mut self, update: &Update, block: &mut Block, observer: &mut O) {
        *block = [Frame::ZERO; BLOCK];
        // One in a block: there are fewer than blocks, and none is due before the tick is over.
        if let Some(strike) = update.strikes.get(self.next_strike) {
            let delay = strike.delay - (self.next_strike * BLOCK) as u32;
            self.next_strike += 1;
            self.strike(&Strike { delay, ..*strike }, observer);
        }
        let Self {
            population,
            voices,
            stats,
            ..
        } = self;
        population.render(&update.water, self.frame, voices, stats, observer, block);
        if voices.sounding() > 0 {
            // Each source keeps itself within the bus; together they might pass it.
            let mut ears = Ears::new();
            voices.render(&mut ears);
            ears.add_to(block);
        }
        self.cloud.render(block);
        self.mix.render(block, &mut self.stats);
        self.frame = self.frame.wrapping_add(BLOCK as u64);
    }

    /// Counters since the start.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Voices sounding now.
    pub fn voices(&self) -> usize {
        self.voices.sounding()
    }

    /// Classes that ring now.
    pub fn ringing(&self) -> usize {
        self.population.ringing()
    }

    /// What the cloud has done.
    pub fn cloud(&self) -> Work {
        self.cloud.work()
    }

    /// Whether no bubble rings.
    pub fn is_silent(&self) -> bool {
        self.voices() == 0 && self.population.is_silent() && self.cloud.is_silent()
    }

    /// Frames rendered.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Continues counting frames and events from elsewhere; the sound does not depend on either.
    pub fn preset_counters(&mut self, frame: u64, stats: Stats) {
        self.frame = frame;
        self.stats = stats;
    }
}

/// The audio path and its control path in step: what a tick computes takes effect one tick later, at a fixed frame.
#[derive(Clone, Debug)]
pub struct Instrument<P: Profile> {
    /// Parameters.
    pub control: Control,
    synth: Synth<P>,
    keeper: P::Keeper,
    /// One of them is in force, the other is what comes next.
    updates: [P::Update; 2],
    live: usize,
    /// Blocks rendered of this tick.
    blocks: usize,
    block: Block,
    /// Frames of `block` already given out.
    given: usize,
}

impl<P: Profile> Instrument<P> {
    /// Playing `scene` from its first frame.
    pub fn new(scene: &Scene, sample_rate: u32, seed: u64, output: Output) -> Self {
        let mut control = Control::new(scene, sample_rate, P::LIMITS, seed);
        let mut updates = [P::update(), P::update()];
        let mut keeper = P::KEEPER;
        keeper.start(seed, sample_rate);
        control.tick(updates[1].as_mut());
        control.tick_cloud(&mut keeper, updates[1].as_mut());
        Self {
            synth: Synth::new(seed, output, &control, sample_rate),
            control,
            keeper,
            updates,
            live: 0,
            blocks: 0,
            block: [Frame::ZERO; BLOCK],
            given: BLOCK,
        }
    }

    /// Fills `out`, whatever its length: the samples do not depend on how they are asked for.
    pub fn render<O: Observer>(&mut self, mut out: &mut [Frame], observer: &mut O) {
        while !out.is_empty() {
            if self.given == BLOCK {
                self.next_block(observer);
            }
            let n = out.len().min(BLOCK - self.given);
            let (now, later) = out.split_at_mut(n);
            now.copy_from_slice(&self.block[self.given..self.given + n]);
            self.given += n;
            out = later;
        }
    }

    /// Sounds a single bubble, counted from the next block's first frame.
    pub fn strike<O: Observer>(&mut self, strike: &Strike, observer: &mut O) {
        self.synth.strike(strike, observer);
    }

    fn next_block<O: Observer>(&mut self, observer: &mut O) {
        if self.blocks == 0 {
            self.live ^= 1;
            self.synth.apply(self.updates[self.live].as_ref());
            // A board computes this while the tick sounds; here it is there at once, and waits.
            let next = self.updates[self.live ^ 1].as_mut();
            self.control.tick(next);
            self.control.tick_cloud(&mut self.keeper, next);
        }
        self.blocks = (self.blocks + 1) % BLOCKS_PER_TICK;
        let update = self.updates[self.live].as_ref();
        self.synth.render(update, &mut self.block, observer);
        self.given = 0;
    }

    /// The frame from which on what is set now is heard.
    pub fn date(&self) -> u64 {
        let blocks = (BLOCKS_PER_TICK - self.blocks) % BLOCKS_PER_TICK;
        let next_tick = self.synth.frame() + (blocks * BLOCK) as u64;
        next_tick + TICK as u64
    }

    /// The audio path.
    pub fn synth(&self) -> &Synth<P> {
        &self.synth
    }

    /// The audio path, to preset it.
    pub fn synth_mut(&mut self) -> &mut Synth<P> {
        &mut self.synth
    }
}
