//! The audio task: above everything but the DMA's interrupt, it turns what control left into blocks.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use critical_section::Mutex;
use embassy_executor::InterruptExecutor;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use freshet::frame::BLOCKS_PER_TICK;
use freshet::profile::Profile;
use freshet::stats::Stats;
use freshet::{BLOCK, Block, Frame, Synth};

use crate::board::Capacity;
use crate::i2s::{self, Wanted};
use crate::meter::Meter;
use crate::supervisor::{self, Client};

/// Runs the audio task; a spare interrupt of the board stands for it.
pub static EXECUTOR: InterruptExecutor = InterruptExecutor::new();
/// Cycles of a block.
pub static METER: Meter = Meter::new();
/// Ticks for which control had nothing ready.
static MISSED: AtomicU32 = AtomicU32::new(0);

/// Frames of the fade after a fault (5 ms): a power of two.
const FADE: u32 = 256;

/// What a board's control path fills in for a tick.
pub type Update = <Capacity as Profile>::Update;

/// The update of the next tick, and the one that is no longer in force: they change places.
static READY: Mutex<RefCell<Option<&'static mut Update>>> = Mutex::new(RefCell::new(None));
static DONE: Signal<CriticalSectionRawMutex, &'static mut Update> = Signal::new();

/// How the audio path stood when this tick began.
#[derive(Clone, Copy)]
pub struct Moment {
    /// The tick's first frame.
    pub frame: u64,
    /// What was counted.
    pub stats: Stats,
    /// Voices sounding.
    pub voices: u16,
}

static MOMENT: Mutex<Cell<Option<Moment>>> = Mutex::new(Cell::new(None));

/// How the audio path stood when this tick began; none before the first.
pub fn moment() -> Option<Moment> {
    critical_section::with(|cs| MOMENT.borrow(cs).get())
}

/// Hands over the update of the next tick, and waits until it is in force; returns the one that was before.
pub async fn exchange(update: &'static mut Update) -> &'static mut Update {
    critical_section::with(|cs| READY.borrow_ref_mut(cs).replace(update));
    DONE.wait().await
}

/// Ticks for which control had nothing ready.
pub fn missed() -> u32 {
    MISSED.load(Relaxed)
}

/// Plays for ever; `update` is in force at first.
#[embassy_executor::task]
pub async fn run(synth: &'static mut Synth<Capacity>, update: &'static mut Update) {
    let mut player = Player {
        synth,
        update: Some(update),
        blocks: 0,
        fade: 0,
        late: 0,
    };
    i2s::restart();
    loop {
        match i2s::wanted().await {
            Wanted::Block => METER.measure(|| player.play()),
            Wanted::Restart => {
                i2s::restart();
                player.fade = FADE;
            }
        }
        supervisor::check_in(Client::Audio);
    }
}

/// What the audio task keeps from block to block.
struct Player {
    synth: &'static mut Synth<Capacity>,
    /// What is in force; none only while two change places.
    update: Option<&'static mut Update>,
    /// Blocks of this tick.
    blocks: usize,
    /// Frames left of the fade after a fault.
    fade: u32,
    /// Late blocks seen so far.
    late: u32,
}

impl Player {
    /// One block. A function of its own, so that it can be found and measured.
    #[inline(never)]
    fn play(&mut self) {
        if self.blocks == 0 {
            self.take_tick();
        }
        self.blocks = (self.blocks + 1) % BLOCKS_PER_TICK;
        let mut block: Block = [Frame::ZERO; BLOCK];
        if let Some(update) = &self.update {
            self.synth.render(&**update, &mut block, &mut ());
        }
        let late = i2s::faults().late;
        if late != self.late {
            self.late = late;
            self.fade = FADE;
        }
        if self.fade > 0 {
            self.fade = fade_in(&mut block, self.fade);
        }
        i2s::hand_in(&block);
    }

    /// Takes what control computed for this tick.
    fn take_tick(&mut self) {
        let moment = Moment {
            frame: self.synth.frame(),
            stats: *self.synth.stats(),
            voices: self.synth.voices() as u16,
        };
        let next = critical_section::with(|cs| {
            MOMENT.borrow(cs).set(Some(moment));
            READY.borrow_ref_mut(cs).take()
        });
        let Some(next) = next else {
            MISSED.fetch_add(1, Relaxed);
            return;
        };
        self.synth.apply(next);
        if let Some(last) = self.update.replace(next) {
            DONE.signal(last);
        }
    }
}

/// Fades in with `left` frames of the fade to go; returns how many are left then.
fn fade_in(block: &mut Block, mut left: u32) -> u32 {
    for frame in block {
        let gain = (FADE - left) as i32;
        for sample in [&mut frame.left, &mut frame.right] {
            // 24 bits and 9 would not fit.
            *sample = (i64::from(*sample) * i64::from(gain) / i64::from(FADE)) as i32;
        }
        left = left.saturating_sub(1);
    }
    left
}
