//! How much of a chip a scene takes: what is counted while it is rendered, times what each thing costs.
//!
//! The costs are instructions of a Cortex-M4, fitted to what the emulated F407 executes block by block:
//! `cargo test --manifest-path emulated-board/Cargo.toml --ignore-rust-version --test load -- --nocapture`.

use freshet::cloud::Work;
use freshet::frame::BLOCKS_PER_TICK;
use freshet::observer::{Birth, Crowd, Observer, Path};
use freshet::param;
use freshet::stats::Stats;
use freshet::{BLOCK, Frame};

use crate::board::{Board, Player};

/// What is counted in a block.
pub const COUNTED: [&str; 20] = [
    "block",
    "first block of a tick",
    "block with sound in it",
    "block that the limiter holds down",
    "block with a tone",
    "block with a level",
    "class that rings",
    "class with births",
    "birth",
    "class with a rising bubble",
    "rising bubble",
    "voice",
    "voice that fades",
    "group of a cloud's clusters",
    "the same, squared",
    "commit of a cloud",
    "cluster that it changes",
    "group of clusters in a tick with forces",
    "force on a cloud",
    "step of a force on a cloud",
];

/// Instructions that each of [`COUNTED`] takes.
pub const COST: [f64; COUNTED.len()] = [
    2014.0, 401.0, 1853.0, 2814.0, 1224.0, 1597.0, 421.0, 76.0, 91.0, 153.0, 568.0, 411.0, 3084.0,
    15392.0, 145.0, 1869.0, 2724.0, 1408.0, 138.0, 188.0,
];

/// Frames in which a stolen voice fades.
const FADE: u64 = 192;

/// The counts of a block.
pub type Counts = [f64; COUNTED.len()];

/// Counts block by block.
pub struct Meter {
    before: Stats,
    cloud: Work,
    blocks: u64,
    /// Classes of this block with births, and with rising ones, as bits.
    with_births: u64,
    with_rising: u64,
    births: u32,
    /// When each stolen voice has faded, frames.
    fades: Vec<u64>,
    sum: f64,
    most: f64,
}

/// Instructions a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// On average.
    pub mean: f64,
    /// In the block that took most.
    pub busiest: f64,
}

impl Load {
    /// Parts of `board`'s time at `rate` Hz: on average, and in the busiest block. None for the desk.
    pub fn share(&self, board: Board, rate: u32) -> Option<[f64; 2]> {
        let (clock, cycles) = board.core()?;
        let part = |instructions: f64| instructions * cycles * f64::from(rate) / clock;
        Some([part(self.mean), part(self.busiest)])
    }
}

impl Default for Meter {
    fn default() -> Self {
        Self::new()
    }
}

impl Meter {
    /// Nothing counted yet.
    pub fn new() -> Self {
        Self {
            before: Stats::default(),
            cloud: Work::default(),
            blocks: 0,
            with_births: 0,
            with_rising: 0,
            births: 0,
            fades: Vec::new(),
            sum: 0.0,
            most: 0.0,
        }
    }

    /// What was counted in the block that `player` has just rendered, which was observed by this.
    pub fn block(&mut self, player: &dyn Player, block: &[Frame]) -> Counts {
        let (stats, before) = (player.stats(), self.before);
        let cloud = player.cloud();
        let forces = cloud.forces - self.cloud.forces;
        let now = (self.blocks + 1) * BLOCK as u64;
        self.fades.retain(|end| *end > now);
        let stolen = (stats.stolen - before.stolen) as usize;
        self.fades.resize(self.fades.len() + stolen, now + FADE);
        let sounds = !player.is_silent() || block.iter().any(|frame| *frame != Frame::ZERO);
        let is = |yes: bool| f64::from(u8::from(yes));
        let set = |index: usize| is(player.parameters().get(index) != 0.0);
        let counts = [
            1.0,
            is(self.blocks.is_multiple_of(BLOCKS_PER_TICK as u64)),
            is(sounds),
            is(stats.limited != before.limited),
            set(param::TONE) * is(sounds),
            set(param::LEVEL) * is(sounds),
            player.ringing() as f64,
            f64::from(self.with_births.count_ones()),
            f64::from(self.births),
            f64::from(self.with_rising.count_ones()),
            (stats.rising - before.rising) as f64,
            player.voices() as f64,
            self.fades.len().min(player.voices()) as f64,
            cloud.groups as f64,
            (cloud.groups * cloud.groups) as f64,
            f64::from(cloud.commits - self.cloud.commits),
            f64::from(cloud.changed - self.cloud.changed),
            is(forces > 0) * cloud.groups as f64,
            f64::from(forces),
            f64::from(cloud.pushes - self.cloud.pushes),
        ];
        let cost: f64 = (counts.iter().zip(COST))
            .map(|(count, cost)| count * cost)
            .sum();
        let cost = cost / BLOCK as f64;
        self.sum += cost;
        self.most = self.most.max(cost);
        self.before = stats;
        self.cloud = cloud;
        self.blocks += 1;
        (self.with_births, self.with_rising) = (0, 0);
        self.births = 0;
        counts
    }

    /// What all blocks came to.
    pub fn load(&self) -> Load {
        Load {
            mean: self.sum / self.blocks.max(1) as f64,
            busiest: self.most,
        }
    }
}

impl Observer for Meter {
    fn birth(&mut self, birth: &Birth) {
        let class = 1u64.checked_shl(u32::from(birth.class)).unwrap_or(0);
        self.with_births |= class;
        self.births += u32::from(class != 0);
        if birth.path == Path::Voice {
            self.with_rising |= class;
        }
    }
    fn crowd(&mut self, crowd: &Crowd) {
        // Each sample's impulses are drawn and struck as a birth is.
        self.with_births |= 1 << crowd.class;
        self.births += 1;
    }
}

/// Two who want to know.
pub struct Both<'a, A, B>(pub &'a mut A, pub &'a mut B);

impl<A: Observer, B: Observer> Observer for Both<'_, A, B> {
    fn birth(&mut self, birth: &Birth) {
        self.0.birth(birth);
        self.1.birth(birth);
    }
    fn crowd(&mut self, crowd: &Crowd) {
        self.0.crowd(crowd);
        self.1.crowd(crowd);
    }
}
