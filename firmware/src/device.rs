//! What the protocol turns and asks: the board.

use core::cell::RefCell;

use embassy_futures::block_on;
use embassy_time::Instant;
use freshet::control::Control;
use freshet::param;
use freshet::profile::Profile;
use freshet::protocol::{BootRecord, Hello, Job, Preset, Refusal, Slot, Status};
use freshet::scene::Scene;
use freshet::storage::{Record, StorageError};
use freshet::{BLOCK, TICK};

use crate::board::{self, Capacity};
use crate::clock::SAMPLE_RATE;
use crate::flash::Scenes;
use crate::storage::{self, Kept};
use crate::{audio, i2s, log, serial, supervisor};

/// Cycles of the core in the time of a block.
const BLOCK_CYCLES: f32 = (board::CORE / SAMPLE_RATE) as f32 * BLOCK as f32;

/// What was before the start.
#[derive(Clone, Copy)]
pub struct Past {
    /// Why the chip started.
    pub cause: &'static str,
    /// What the crash before said.
    pub panic: &'static str,
}

/// What is played first.
pub struct First {
    /// Its scene's number.
    pub number: u16,
    /// How it is at first.
    pub scene: Scene,
    /// What was chosen is not there.
    pub trouble: bool,
}

impl First {
    /// What a person chose to be played when the power comes on; where there is no such thing, what the bank says.
    #[inline(never)]
    pub fn choose(scenes: &Scenes, kept: &mut Kept) -> Self {
        let boot = block_on(kept.boot());
        let preset = match &boot {
            BootRecord::Preset(slot) => block_on(kept.preset(*slot)),
            BootRecord::Default | BootRecord::Scene(_) => None,
        };
        let number = match (&boot, &preset) {
            (BootRecord::Default, _) => Some(scenes.first()),
            (BootRecord::Scene(name), _) => scenes.number_of(name),
            (BootRecord::Preset(_), Some(preset)) => scenes.number_of(&preset.scene),
            (BootRecord::Preset(_), None) => None,
        };
        let trouble = number.is_none();
        if trouble {
            log::error!("what is to be played first is not there");
        }
        let number = number.unwrap_or(scenes.first());
        let (_, scene) = scenes.scene(number);
        Self {
            number,
            scene: match preset {
                Some(preset) => preset.over(scene),
                None => scene,
            },
            trouble,
        }
    }
}

/// What takes its time, and silence.
#[derive(Clone, Copy)]
pub enum Work {
    /// [`Device::keep`].
    Keep,
    /// Another start.
    Restart,
}

/// The board.
pub struct Device {
    control: &'static mut Control,
    scenes: Scenes,
    past: Past,
    playing: u16,
    /// See [`Device::date`](freshet::protocol::Device::date).
    date: u64,
    kept: RefCell<Kept>,
    /// What is in slot 0, and the boot choice.
    stored: Option<Preset>,
    boot: BootRecord,
    /// What is to be done, so many ticks after it has become silent.
    work: Option<Work>,
    wait: u32,
    /// What is to be kept.
    record: Option<Record>,
}

impl Device {
    /// Playing scene `playing`.
    pub fn new(
        control: &'static mut Control,
        scenes: Scenes,
        playing: u16,
        mut kept: Kept,
        past: Past,
    ) -> Self {
        Self {
            control,
            playing,
            scenes,
            past,
            date: TICK as u64,
            stored: block_on(kept.preset(0)),
            boot: block_on(kept.boot()),
            kept: RefCell::new(kept),
            work: None,
            wait: 0,
            record: None,
        }
    }

    /// Once a tick: work whose time has come.
    pub fn due(&mut self) -> Option<Work> {
        if self.work.is_none() || !self.control.is_muted() {
            return None;
        }
        self.wait = self.wait.saturating_sub(1);
        if self.wait > 0 {
            return None;
        }
        self.work.take()
    }

    /// Keeps what waits for it; the sound comes back then.
    pub async fn keep(&mut self) -> Result<(), Refusal<'static>> {
        let Some(record) = &self.record else {
            return Ok(());
        };
        let kept = self.kept.get_mut();
        i2s::hold();
        let result = kept.keep(record).await;
        i2s::release();
        self.control.pause(false);
        match record.slot() {
            Some(0) => self.stored = kept.preset(0).await,
            Some(_) => {}
            None => self.boot = kept.boot().await,
        }
        result.map_err(|error| match error {
            StorageError::Flash => Refusal::Flash,
            StorageError::Full => Refusal::Full,
        })
    }

    /// A tick has begun to play: what is set from now on is heard when it ends.
    pub fn begin_tick(&mut self) {
        if let Some(moment) = audio::moment() {
            self.date = moment.frame + TICK as u64;
        }
    }

    /// Goes on to the next scene.
    pub fn next_scene(&mut self) {
        self.playing = (self.playing + 1) % self.scenes.count();
        let (name, scene) = self.scenes.scene(self.playing);
        self.control.load(&scene);
        log::info!("scene {}", name);
    }
}

impl freshet::protocol::Device for Device {
    fn control(&self) -> &Control {
        self.control
    }
    fn control_mut(&mut self) -> &mut Control {
        self.control
    }
    fn date(&self) -> u64 {
        self.date
    }
    fn hello(&self) -> Hello<'_> {
        Hello {
            version: env!("CARGO_PKG_VERSION"),
            board: Capacity::NAME,
            rate: board::CLOCK.rate() as f32,
            seed: self.scenes.seed(),
            schema: param::SCHEMA,
            scene: "",
            at: 0,
        }
    }
    fn status(&self) -> Status<'_> {
        let (last, peak) = audio::METER.read();
        let faults = i2s::faults();
        let (overruns, framing) = serial::faults();
        let status = Status {
            uptime: Instant::now().as_secs() as u32,
            load: last as f32 / BLOCK_CYCLES,
            peak: peak as f32 / BLOCK_CYCLES,
            underruns: faults.late,
            restarts: faults.errors,
            missed: audio::missed(),
            trouble: supervisor::is_trouble(),
            cause: self.past.cause,
            panic: self.past.panic,
            overruns,
            framing,
            ..Status::default()
        };
        let Some(moment) = audio::moment() else {
            return status;
        };
        let stats = moment.stats;
        Status {
            frame: moment.frame,
            births: stats.births,
            voices: moment.voices,
            stolen: stats.stolen as u32,
            unvoiced: (stats.unvoiced + stats.dropped) as u32,
            limited: stats.limited as u32,
            clipped: stats.clipped as u32,
            ..status
        }
    }
    fn scene(&self, number: u16) -> Option<(&str, Scene)> {
        (number < self.scenes.count()).then(|| self.scenes.scene(number))
    }
    fn playing(&self) -> u16 {
        self.playing
    }
    fn set_playing(&mut self, number: u16) {
        self.playing = number;
    }
    fn stored(&self) -> Option<&Preset> {
        self.stored.as_ref()
    }
    fn preset(&self, slot: Slot) -> Option<Preset> {
        block_on(self.kept.try_borrow_mut().ok()?.preset(slot))
    }
    fn boot(&self) -> BootRecord {
        self.boot.clone()
    }
    fn begin(&mut self, job: Job<'_>) -> Result<Option<u32>, Refusal<'static>> {
        if self.work.is_some() {
            return Err(Refusal::Busy);
        }
        let record = match job {
            Job::Store(slot, preset) => Record::preset(slot, preset),
            Job::Erase(slot) => Record::empty(slot),
            Job::Boot(boot) => Record::boot(boot),
            Job::Restart => {
                self.wait = storage::SETTLE_TICKS;
                self.work = Some(Work::Restart);
                self.control.pause(true);
                return Ok(Some(storage::restart_pause()));
            }
        };
        let record = record.ok_or(Refusal::Full)?;
        let kept = self.kept.get_mut();
        if block_on(kept.has(&record)) {
            return Ok(None);
        }
        let pause = block_on(storage::pause(kept, &record));
        self.wait = storage::SETTLE_TICKS;
        self.record = Some(record);
        self.work = Some(Work::Keep);
        self.control.pause(true);
        Ok(Some(pause))
    }
}
