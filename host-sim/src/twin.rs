//! A board's twin on the desk: the same instrument behind the same protocol.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::Result;
use freshet::control::Control;
use freshet::mix::Output;
use freshet::param;
use freshet::protocol::{
    Boot, BootRecord, Choice, Device, Hello, Job, Preset, Refusal, Shell, Slot, Status,
};
use freshet::scene::Scene;
use freshet::{Frame, TICK};

use crate::board::{Board, Player};
use crate::built_in;

/// Bytes of answers that may wait.
const OUT: usize = 1 << 16;

/// How long the sound pauses while settings are kept, s.
const PAUSE: f64 = 0.5;

/// What survives a restart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kept {
    /// Settings by their slots; 0 are those stored last.
    pub presets: BTreeMap<Slot, Preset>,
    /// What is played at the start.
    pub boot: BootRecord,
}

/// What a twin is made from.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Whose twin.
    pub board: Board,
    /// Sample rate, Hz.
    pub rate: u32,
    /// Seed of the sound.
    pub seed: u64,
    /// What a board has in its bank.
    pub scenes: Vec<(String, Scene)>,
    /// The number of the scene that is played at the start, where nothing else is kept.
    pub first: u16,
    /// What was kept.
    pub kept: Kept,
    /// What comes out; of a board [`Output::Bits24`].
    pub output: Output,
}

/// The instrument and all that belongs to it.
pub struct TwinDevice {
    board: Board,
    rate: u32,
    seed: u64,
    scenes: Vec<(String, Scene)>,
    first: u16,
    kept: Kept,
    player: Box<dyn Player>,
    playing: u16,
    restarting: bool,
    output: Output,
    /// How long the sound pauses for a job, ticks.
    pause: u32,
    awaited: Option<Awaited>,
}

/// A job under way.
struct Awaited {
    job: Change,
    /// Ticks until it is done.
    left: u32,
}

/// What a job changes.
enum Change {
    Store(Slot, Box<Preset>),
    Erase(Slot),
    Boot(BootRecord),
}

/// A board's twin: bytes go in and out as on its serial line, and sound comes out.
pub struct Twin {
    device: TwinDevice,
    shell: Shell<OUT>,
    /// Frames of this tick that were given out.
    given: usize,
    rendered: [Frame; TICK],
}

impl Twin {
    /// The twin of `board`, as it is when the power comes on.
    pub fn new(
        board: Board,
        rate: u32,
        seed: u64,
        scenes: Vec<(String, Scene)>,
        kept: Kept,
    ) -> Self {
        Self::with(Setup {
            board,
            rate,
            seed,
            scenes,
            first: 0,
            kept,
            output: Output::Bits24,
        })
    }

    /// The same, with all that can be chosen.
    pub fn with(setup: Setup) -> Self {
        let Setup {
            board,
            rate,
            seed,
            scenes,
            first,
            kept,
            output,
        } = setup;
        let mut device = TwinDevice {
            board,
            rate,
            seed,
            player: board.player(&Scene::default(), rate, seed, output),
            scenes,
            first,
            kept,
            playing: first,
            restarting: false,
            output,
            pause: (PAUSE * f64::from(rate) / TICK as f64).ceil() as u32,
            awaited: None,
        };
        device.start();
        let mut shell = Shell::new();
        shell.greet(&device);
        Self {
            device,
            shell,
            given: TICK,
            rendered: [Frame::ZERO; TICK],
        }
    }

    /// A twin of the F407 with the scenes that travel with the command, at 48 kHz.
    pub fn example() -> Result<Self> {
        let scenes = built_in::named()?;
        Ok(Self::new(Board::F407, 48_000, 7, scenes, Kept::default()))
    }

    /// Takes bytes as from the line.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.shell.receive(bytes, &mut self.device);
    }

    /// All bytes that the twin has to say.
    pub fn take(&mut self) -> Vec<u8> {
        let mut out = vec![0; OUT];
        let count = self.take_into(&mut out);
        out.truncate(count);
        out
    }

    /// The same, as far as they fit; returns how many.
    pub fn take_into(&mut self, out: &mut [u8]) -> usize {
        self.shell.out().take(out)
    }

    /// Time between two ticks.
    pub fn tick_time(&self) -> Duration {
        Duration::from_secs_f64(TICK as f64 / f64::from(self.device.rate))
    }

    /// Fills `out` with what is heard next.
    pub fn render(&mut self, out: &mut [Frame]) {
        for frame in out {
            if self.given == TICK {
                self.tick();
            }
            *frame = self.rendered[self.given];
            self.given += 1;
        }
    }

    /// Goes on by a tick.
    fn tick(&mut self) {
        if std::mem::take(&mut self.device.restarting) {
            self.device.start();
            // What was said before is still on its way.
            let said = self.take();
            self.shell = Shell::new();
            self.shell.out().put(&said);
            self.shell.greet(&self.device);
        }
        if self.device.job_ends() {
            self.shell.finished(Ok(()), &self.device);
        }
        self.shell.tick(&self.device);
        self.device.player.render(&mut self.rendered);
        self.given = 0;
    }

    /// What the twin is made of.
    pub fn device(&mut self) -> &mut TwinDevice {
        &mut self.device
    }

    /// What it would keep over a restart.
    pub fn kept(&self) -> &Kept {
        &self.device.kept
    }
}

impl TwinDevice {
    /// Begins to play what it is to play when the power comes on.
    fn start(&mut self) {
        let usual = (None, self.first);
        let (scene, number) = match self.kept.boot.boot() {
            Boot::Default => usual,
            Boot::Scene(name) => (
                None,
                self.number_of(Choice::Name(name)).unwrap_or(self.first),
            ),
            Boot::Preset(slot) => match self.kept(slot) {
                Ok(preset) => {
                    let (scene, number) = self.recalled(&preset);
                    (Some(scene), number)
                }
                Err(_) => usual,
            },
        };
        self.playing = number;
        let scene = scene
            .or_else(|| Some(self.scene(number)?.1))
            .unwrap_or_default();
        self.player = (self.board).player(&scene, self.rate, self.seed, self.output);
    }

    /// Comes a tick nearer to the end of a job; true where it is done now.
    fn job_ends(&mut self) -> bool {
        let Some(mut awaited) = self.awaited.take() else {
            return false;
        };
        awaited.left = awaited.left.saturating_sub(1);
        if awaited.left > 0 {
            self.awaited = Some(awaited);
            return false;
        }
        match awaited.job {
            Change::Store(slot, preset) => {
                self.kept.presets.insert(slot, *preset);
            }
            Change::Erase(slot) => {
                self.kept.presets.remove(&slot);
            }
            Change::Boot(boot) => self.kept.boot = boot,
        }
        self.player.control().pause(false);
        true
    }

    /// Changes how many ticks the sound pauses for a job, at least 1.
    pub fn set_pause(&mut self, ticks: u32) {
        self.pause = ticks.max(1);
    }

    /// What is kept, to change it from outside.
    pub fn kept_mut(&mut self) -> &mut Kept {
        &mut self.kept
    }

    /// The sound's source.
    pub fn player(&mut self) -> &mut dyn Player {
        &mut *self.player
    }
}

impl Device for TwinDevice {
    fn control(&self) -> &Control {
        self.player.parameters()
    }
    fn control_mut(&mut self) -> &mut Control {
        self.player.control()
    }
    fn date(&self) -> u64 {
        self.player.date()
    }
    fn hello(&self) -> Hello<'_> {
        Hello {
            version: env!("CARGO_PKG_VERSION"),
            board: self.board.name(),
            rate: self.rate as f32,
            seed: self.seed,
            schema: param::SCHEMA,
            scene: "",
            at: 0,
        }
    }
    fn status(&self) -> Status<'_> {
        let stats = self.player.stats();
        let frame = self.player.frame();
        Status {
            frame,
            uptime: (frame / u64::from(self.rate)) as u32,
            births: stats.births,
            voices: self.player.voices() as u16,
            stolen: stats.stolen as u32,
            unvoiced: (stats.unvoiced + stats.dropped) as u32,
            limited: stats.limited as u32,
            clipped: stats.clipped as u32,
            cause: "power-on",
            ..Status::default()
        }
    }
    fn scene(&self, number: u16) -> Option<(&str, Scene)> {
        let (name, scene) = self.scenes.get(usize::from(number))?;
        Some((name, scene.clone()))
    }
    fn playing(&self) -> u16 {
        self.playing
    }
    fn set_playing(&mut self, number: u16) {
        self.playing = number;
    }
    fn stored(&self) -> Option<&Preset> {
        self.kept.presets.get(&0)
    }
    fn preset(&self, slot: Slot) -> Option<Preset> {
        self.kept.presets.get(&slot).cloned()
    }
    fn boot(&self) -> BootRecord {
        self.kept.boot.clone()
    }
    fn begin(&mut self, job: Job<'_>) -> Result<Option<u32>, Refusal<'static>> {
        if self.restarting {
            return Err(Refusal::Busy);
        }
        let job = match job {
            Job::Store(slot, preset) => Change::Store(slot, Box::new(preset.clone())),
            Job::Erase(slot) => Change::Erase(slot),
            Job::Boot(boot) => Change::Boot(boot.clone()),
            Job::Restart => {
                self.restarting = true;
                return Ok(None);
            }
        };
        self.player.control().pause(true);
        let left = self.pause;
        self.awaited = Some(Awaited { job, left });
        let ms = f64::from(left) * TICK as f64 * 1000.0 / f64::from(self.rate);
        Ok(Some(ms.round() as u32))
    }
}
