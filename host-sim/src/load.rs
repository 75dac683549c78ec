//! How much of a chip a scene takes: what is counted while it is rendered, times what each thing costs.
//!
//! The costs are instructions of a Cortex-M4, fitted to what the emulated F407 executes block by block:
//! `cargo test --manifest-path emulated-board/Cargo.toml --ignore-rust-version --test load -- --nocapture`.

use freshet::bubble::Bubble;
use freshet::frame::BLOCKS_PER_TICK;
use freshet::observer::{Birth, Crowd, Observer, Path};
use freshet::param;
use freshet::stats::Stats;
use freshet::{BLOCK, Frame};

use crate::board::{Board, Player};

/// What is counted in a block.
pub const COUNTED: [&str; 16] = [
    "block",
    "first block of a tick",
    "block with sound in it",
    "block that the limiter holds down",
    "block with a tone",
    "block with a level",
    "class that rings",
    "class with births",
    "birth",
    "birth that is heard",
    "class with a rising bubble",
    "rising bubble",
    "single event",
    "voice",
    "voice under the soft attack",
    "voice that fades",
];

/// Instructions that each of [`COUNTED`] takes.
pub const COST: [f64; COUNTED.len()] = [0.0; COUNTED.len()];

/// Frames in which a stolen voice fades.
const FADE: u64 = 192;

/// The counts of a block.
pub type Counts = [f64; COUNTED.len()];

/// Counts block by block.
pub struct Meter {
    rate: f64,
    before: Stats,
    blocks: u64,
    /// Classes of this block with births, and with rising ones, as bits.
    with_births: u64,
    with_rising: u64,
    births: u32,
    heard: u32,
    /// When the soft attack of each young voice is over, and each stolen one has faded; frames.
    attacks: Vec<u64>,
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

impl Meter {
    /// Nothing counted yet; `rate` in Hz.
    pub fn new(rate: u32) -> Self {
        Self {
            rate: f64::from(rate),
            before: Stats::default(),
            blocks: 0,
            with_births: 0,
            with_rising: 0,
            births: 0,
            heard: 0,
            attacks: Vec::new(),
            fades: Vec::new(),
            sum: 0.0,
            most: 0.0,
        }
    }

    /// What was counted in the block that `player` has just rendered, which was observed by this.
    pub fn block(&mut self, player: &dyn Player, block: &[Frame]) -> Counts {
        let (stats, before) = (player.stats(), self.before);
        let now = (self.blocks + 1) * BLOCK as u64;
        self.attacks.retain(|end| *end > now);
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
            f64::from(self.heard),
            f64::from(self.with_rising.count_ones()),
            (stats.rising - before.rising) as f64,
            (stats.events - before.events) as f64,
            player.voices() as f64,
            self.attacks.len().min(player.voices()) as f64,
            self.fades.len().min(player.voices()) as f64,
        ];
        let cost: f64 = (counts.iter().zip(COST))
            .map(|(count, cost)| count * cost)
            .sum();
        let cost = cost / BLOCK as f64;
        self.sum += cost;
        self.most = self.most.max(cost);
        self.before = stats;
        self.blocks += 1;
        (self.with_births, self.with_rising) = (0, 0);
        (self.births, self.heard) = (0, 0);
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
            // While the envelope is above 0.85, HF (39).
            let attack = -f64::ln(0.85) / Bubble::new(f64::from(birth.radius)).beta;
            self.attacks.push(birth.frame + (attack * self.rate) as u64);
        } else {
            self.heard += u32::from(birth.gain != [0, 0]);
        }
    }
    fn crowd(&mut self, crowd: &Crowd) {
        // Each sample's impulses are drawn and struck as a birth is.
        self.with_births |= 1 << crowd.class;
        self.births += 1;
        self.heard += 1;
    }
}
