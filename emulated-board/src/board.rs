//! The board: a firmware running, what is done to it, and what comes of it.
//!
//! The emulated core runs on a thread of its own and stands still between calls. Whoever holds the
//! [`Board`] has it run a while, looks, and does something to it.

use std::collections::BTreeSet;
use std::fmt;
use std::num::NonZeroU64;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use rigless::device::ResetCause;
use rigless::emulator::{self, AccessKind, Driver, Hit, Host, Settled, Start, Stop, Watch};
use rigless::image::Image;
use rigless::mcu::Operate;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use crate::codec::Codec;
use crate::counter::{Counter, Counts, InterruptCounts, Look, Tracer};
use crate::elf::{Elf, ElfError};
use crate::flash;
use crate::i2s::AudioFormat;
use crate::part::{Chip, Fittings, Machine};
use crate::record::{LedChange, Shared, Stream};
use crate::registers::Registers;
use crate::rtt;

/// What may differ from one board to the next.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Whether the crystal starts; where it does not, `HSERDY` never comes.
    pub crystal: bool,
    /// Whether a codec is on the I2C bus.
    pub codec: bool,
    /// The chip's unique identity.
    pub unique_id: [u8; 12],
    /// The flash array as another board left it, in place of the firmware's own.
    pub flash: Option<Vec<u8>>,
    /// The option bytes as another board left them, in place of the factory's.
    pub option_bytes: Option<u32>,
    /// Core cycles an instruction takes on average: the emulator counts instructions, and this is
    /// what turns them into time.
    pub cycles_per_instruction: f64,
    /// What RAM holds at power-on is drawn from this, as it is random on the chip.
    pub seed: u64,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            crystal: true,
            codec: true,
            unique_id: *b"\x1b\x00\x2c\x00\x0afreshet",
            flash: None,
            option_bytes: None,
            cycles_per_instruction: 2.0,
            seed: 1,
        }
    }
}

/// Why the chip started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The supply came on.
    PowerOn,
    /// The firmware asked for it.
    Software,
    /// The reset pin was pulled.
    Pin,
    /// The independent watchdog ran out.
    Watchdog,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PowerOn => "power-on",
            Self::Software => "software",
            Self::Pin => "reset pin",
            Self::Watchdog => "watchdog",
        })
    }
}

/// A start of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reset {
    /// When, since power-on.
    pub at: Duration,
    /// Why.
    pub cause: Cause,
}

/// What can go wrong on a board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The firmware does not hold what was asked of it.
    #[error(transparent)]
    Elf(#[from] ElfError),
    /// The emulator could not start or go on.
    #[error("the emulator stopped: {0}")]
    Emulator(String),
    /// The core locked up and nothing restarted it.
    #[error("the core locked up at {} ({})\n{registers}", at.as_secs_f64(), place.as_deref().unwrap_or("no known function"))]
    LockedUp {
        /// When it was noticed, since power-on.
        at: Duration,
        /// The function it stands in.
        place: Option<String>,
        /// Its registers.
        registers: Box<Registers>,
    },
    /// What was waited for did not happen in time.
    #[error("it did not happen within {} s", limit.as_secs_f64())]
    Limit {
        /// The time it was given.
        limit: Duration,
    },
    /// An address is no memory, or not memory of the kind asked for.
    #[error("there is no such memory at {address:#010x}")]
    NoMemory {
        /// The address.
        address: u32,
    },
    /// A setting makes no sense.
    #[error("{0}")]
    Setting(&'static str),
}

/// What the emulator's thread is asked.
enum Command {
    /// Run until an instant.
    Reach(VirtualNanos),
    /// Do something while the core stands still.
    Do(Box<dyn FnOnce(&mut Core<'_>) + Send>),
}

/// The emulation as it stands between two instructions.
struct Core<'a> {
    session: &'a mut Session<Machine>,
    host: &'a mut dyn Host,
    stop: Stop,
    tracer: &'a mut Tracer,
}

impl Core<'_> {
    fn part(&mut self) -> &mut dyn crate::part::Part {
        self.session.board_mut().part.as_mut()
    }

    fn registers(&mut self) -> Option<Registers> {
        Registers::from_state(&self.host.save_state().ok()?)
    }

    /// The tracer, and the rest of the core for it to look with.
    fn tracer(&mut self) -> (&mut Tracer, Looker<'_>) {
        let looker = Looker {
            session: self.session,
            host: self.host,
        };
        (self.tracer, looker)
    }
}

/// What the tracer looks with.
struct Looker<'a> {
    session: &'a mut Session<Machine>,
    host: &'a mut dyn Host,
}

impl Look for Looker<'_> {
    fn word(&mut self, address: u32) -> Option<u32> {
        let word = self.host.read(u64::from(address), Width::W32).ok()?;
        u32::try_from(word).ok()
    }

    fn watch(&mut self, address: u32, on: bool) {
        let watch = Watch::Instruction(u64::from(address));
        if on {
            self.session.watch(watch);
        } else {
            self.session.unwatch(watch);
        }
    }
}

/// Drives a run from the thread of the core: stops where it is told, and does what it is told there.
struct Conductor {
    commands: Receiver<Command>,
    stopped: Sender<Stop>,
    tracer: Tracer,
    resets: usize,
    held: bool,
}

impl Conductor {
    /// Holds the core while the flash is busy.
    fn follow_flash(&mut self, session: &Session<Machine>, host: &mut dyn Host) {
        let busy = session.board().part.flash_operation().is_some();
        if busy != self.held {
            self.held = busy;
            host.hold(busy);
        }
    }

    fn hit(&mut self, session: &mut Session<Machine>, host: &mut dyn Host, hit: Hit) {
        let state = host.save_state();
        if let Some(registers) = state.ok().and_then(|state| Registers::from_state(&state)) {
            let mut looker = Looker { session, host };
            self.tracer
                .hit(hit.instruction_count, &registers, &mut looker);
        }
    }
}

impl Driver<Machine> for Conductor {
    fn on_settled(
        &mut self,
        session: &mut Session<Machine>,
        host: &mut dyn Host,
        settled: Settled,
    ) {
        match settled {
            Settled::Access { access, .. } if access.kind == AccessKind::Write => {
                self.follow_flash(session, host);
            }
            Settled::Hit(hit) => self.hit(session, host, hit),
            Settled::Stop(stop) => {
                self.follow_flash(session, host);
                let resets = session.resets().len();
                if resets != self.resets {
                    self.resets = resets;
                    let mut looker = Looker { session, host };
                    self.tracer.restart(stop.instruction_count, &mut looker);
                }
            }
            _ => {}
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Machine>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        self.stopped.send(stop).ok()?;
        loop {
            match self.commands.recv().ok()? {
                Command::Reach(until) => return Some(until),
                Command::Do(action) => action(&mut Core {
                    session,
                    host,
                    stop,
                    tracer: &mut self.tracer,
                }),
            }
        }
    }
}

/// A board with its firmware, from power-on.
#[derive(Debug)]
pub struct Board {
    chip: Chip,
    elf: Elf,
    setup: Setup,
    record: Shared,
    codec: Codec,
    commands: Option<Sender<Command>>,
    stopped: Receiver<Stop>,
    thread: Option<JoinHandle<Result<(), String>>>,
    now: Duration,
    instructions: u64,
    power_ons: Vec<Duration>,
}

impl Board {
    /// A board of `chip` with `elf` in its flash, its supply just switched on.
    ///
    /// # Errors
    ///
    /// A firmware that does not fit the chip's memory, or a setting that makes no sense.
    pub fn new(chip: Chip, elf: &Elf, setup: Setup) -> Result<Self, Error> {
        let facts = chip.facts();
        let rate = facts.core_hz as f64 / setup.cycles_per_instruction;
        let rate = NonZeroU64::new(rate as u64)
            .filter(|rate| setup.cycles_per_instruction > 0.0 && rate.get() <= 4 * facts.core_hz)
            .ok_or(Error::Setting("cycles an instruction must be above 0.25"))?;
        let record = Shared::default();
        let codec = Codec::new(setup.codec);
        let fittings = Fittings {
            record: record.clone(),
            codec: codec.clone(),
            crystal_hz: if setup.crystal { facts.crystal_hz } else { 0 },
            options: setup.option_bytes,
        };
        let machine = Machine::new(chip, fittings, rate).map_err(broken)?;
        let raw = |name: &str, bytes: Vec<u8>, at: u32| {
            Image::new(Path::new(name), bytes, Some(u64::from(at))).map_err(broken)
        };
        let (flash_base, flash_bytes) = facts.flash;
        let program = match &setup.flash {
            Some(array) if array.len() != flash_bytes as usize => {
                return Err(Error::Setting(
                    "the flash image is not the size of the array",
                ));
            }
            Some(array) => raw("flash", array.clone(), flash_base)?,
            None => Image::new(elf.path(), elf.bytes().to_vec(), None).map_err(broken)?,
        };
        let kilobytes = (flash_bytes >> 10) as u16;
        let images = vec![
            program,
            raw("identity", setup.unique_id.to_vec(), facts.identity)?,
            raw(
                "flash size",
                kilobytes.to_le_bytes().to_vec(),
                facts.flash_size,
            )?,
        ];
        let session = Session::new(Box::new(machine), 0, VirtualNanos(0)).map_err(broken)?;
        let (commands, orders) = channel();
        let (reports, stopped) = channel();
        let conductor = Conductor {
            commands: orders,
            stopped: reports,
            tracer: Tracer::default(),
            resets: 0,
            held: false,
        };
        let thread = std::thread::Builder::new()
            .name("board".into())
            .spawn(move || {
                emulator::run(session, &Start::new(&images), conductor)
                    .map(drop)
                    .map_err(|error| error.to_string())
            })
            .map_err(|error| Error::Emulator(error.to_string()))?;
        let mut board = Self {
            chip,
            elf: elf.clone(),
            setup,
            record,
            codec,
            commands: Some(commands),
            stopped,
            thread: Some(thread),
            now: Duration::ZERO,
            instructions: 0,
            power_ons: vec![Duration::ZERO],
        };
        board.wait()?;
        board.fill_ram()?;
        Ok(board)
    }

    /// Switches the supply off and on again: RAM and the backup domain are lost, the flash and the
    /// option bytes stay, as a cut at this instant leaves them. Time goes on, and so does what the
    /// emulator has translated: much faster than a new board.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn power_cycle(&mut self) -> Result<(), Error> {
        if self.with(|core| core.part().flash_operation())?.is_some() {
            let array = self.flash()?;
            let (base, _) = self.chip.facts().flash;
            self.write(base, &array)?;
        }
        self.setup.seed = self.setup.seed.wrapping_add(1);
        self.power_ons.push(self.now);
        self.codec.power_on(self.now);
        self.with(|core| {
            let Stop {
                at,
                instruction_count,
                ..
            } = core.stop;
            core.session.reset_by_pin(at, instruction_count, core.host);
            core.part().power_on();
        })?;
        self.fill_ram()
    }

    /// The firmware.
    pub fn elf(&self) -> &Elf {
        &self.elf
    }

    /// The time since power-on.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Instructions executed since power-on, interrupts included; sleep executes none.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Instructions the core executes in a second without sleep.
    pub fn instructions_per_second(&self) -> f64 {
        self.chip.facts().core_hz as f64 / self.setup.cycles_per_instruction
    }

    /// Runs for `time`.
    ///
    /// # Errors
    ///
    /// [`Error::LockedUp`] where the core stands locked up at the end, and an emulator that stopped.
    pub fn run(&mut self, time: Duration) -> Result<(), Error> {
        let until = VirtualNanos((self.now + time).as_nanos() as u64);
        self.command(Command::Reach(until))?;
        self.wait()?;
        let registers = self.registers()?;
        if registers.locked_up {
            return Err(Error::LockedUp {
                at: self.now,
                place: self.elf.name_of(registers.pc()),
                registers: Box::new(registers),
            });
        }
        Ok(())
    }

    /// Runs until `done` says so, which it is asked each millisecond, and answers how long that took.
    ///
    /// # Errors
    ///
    /// [`Error::Limit`] when it is not done within `limit`, and as for [`Board::run`].
    pub fn run_until(
        &mut self,
        limit: Duration,
        mut done: impl FnMut(&mut Self) -> bool,
    ) -> Result<Duration, Error> {
        let begun = self.now;
        while !done(self) {
            if self.now - begun >= limit {
                return Err(Error::Limit { limit });
            }
            self.run(Duration::from_millis(1))?;
        }
        Ok(self.now - begun)
    }

    /// The frames sent since the last call, left and right, each in the units of its own width.
    pub fn take_audio(&mut self) -> Vec<[i32; 2]> {
        std::mem::take(&mut self.record.lock().audio)
    }

    /// Frames sent since power-on.
    pub fn frames(&self) -> u64 {
        self.record.lock().frames
    }

    /// Every stretch of audio without a gap, in order.
    pub fn streams(&self) -> Vec<Stream> {
        self.record.lock().streams.clone()
    }

    /// How the last stretch was sent, or `None` before the first.
    pub fn audio_format(&self) -> Option<AudioFormat> {
        self.record
            .lock()
            .streams
            .last()
            .map(|stream| stream.format)
    }

    /// Frames a second as the clock and I2S registers stand, or 0 while the I2S has no clock.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn sample_rate(&mut self) -> Result<f64, Error> {
        self.with(|core| core.part().sample_rate())
    }

    /// When the first frame other than silence ended.
    pub fn first_sound(&self) -> Option<Duration> {
        self.record.lock().first_sound
    }

    /// Half-words the I2S had to send and did not have, since power-on.
    pub fn i2s_underruns(&self) -> u64 {
        self.record.lock().underruns
    }

    /// Which lights are on, in the board's order.
    pub fn leds(&self) -> Vec<bool> {
        self.record.lock().leds.clone()
    }

    /// Every change of a light since power-on.
    pub fn led_changes(&self) -> Vec<LedChange> {
        self.record.lock().led_changes.clone()
    }

    /// Presses the user button, or lets it go.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn button(&mut self, pressed: bool) -> Result<(), Error> {
        self.with(move |core| {
            let at = core.stop.at;
            core.part().button(at, pressed);
        })
    }

    /// Types `bytes` on the serial line, one after the other at the rate the firmware receives.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn serial_send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let bytes = bytes.to_vec();
        self.with(move |core| core.part().type_serial(&bytes))
    }

    /// What the firmware sent on the serial line since the last call.
    pub fn serial_take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.record.lock().sent)
    }

    /// Has the firmware's serial port run at another rate than it chose: a bit takes `clocks` of the port's clock, until
    /// the firmware sets it again.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn serial_divider(&mut self, clocks: u32) -> Result<(), Error> {
        self.with(move |core| core.part().serial_divider(clocks))
    }

    /// Garbles this many of a million bytes the firmware receives, each with a framing error.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn garble_serial(&mut self, per_million: u32) -> Result<(), Error> {
        self.with(move |core| core.part().garble_serial(per_million))
    }

    /// The codec.
    pub fn codec(&self) -> &Codec {
        &self.codec
    }

    /// Every start of the chip, the power-on first.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn resets(&mut self) -> Result<Vec<Reset>, Error> {
        let resets = self.with(|core| core.session.resets().to_vec())?;
        let power_ons = self.power_ons.clone();
        let others = resets.into_iter().map(|reset| Reset {
            at: Duration::from_nanos(reset.at.0),
            cause: match reset.cause {
                ResetCause::Core => Cause::Software,
                ResetCause::Model(_) => Cause::Watchdog,
                _ => Cause::Pin,
            },
        });
        // A power cycle is a reset by the pin to rigless, at the same instant.
        let mut all: Vec<Reset> = others
            .filter(|reset| !self.power_ons.contains(&reset.at))
            .chain(power_ons.into_iter().map(|at| Reset {
                at,
                cause: Cause::PowerOn,
            }))
            .collect();
        all.sort_by_key(|reset| reset.at);
        Ok(all)
    }

    /// Pulls the reset pin: RAM keeps what it holds.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn reset(&mut self) -> Result<(), Error> {
        self.with(|core| {
            let Core {
                session,
                host,
                stop,
                ..
            } = core;
            session.reset_by_pin(stop.at, stop.instruction_count, *host);
        })
    }

    /// Keeps interrupt `line` from the core for `time`, while its peripheral and DMA go on.
    ///
    /// # Errors
    ///
    /// A chip whose interrupts cannot be masked, the H743, and an emulator that has stopped.
    pub fn mask_interrupt(&mut self, line: u16, time: Duration) -> Result<(), Error> {
        self.with(move |core| {
            let at = core.stop.at;
            let until = VirtualNanos(at.0 + time.as_nanos() as u64);
            core.part().cut_interrupt(at, line, until)
        })?
        .then_some(())
        .ok_or(Error::Setting("interrupts cannot be masked on this chip"))
    }

    /// The `length` bytes of memory at `address`.
    ///
    /// # Errors
    ///
    /// Nothing there is memory.
    pub fn read(&mut self, address: u32, length: usize) -> Result<Vec<u8>, Error> {
        self.with(move |core| read(core.host, address, length))?
    }

    /// The word at `address`, in memory or of a peripheral, read as a debugger does: nothing changes.
    ///
    /// # Errors
    ///
    /// Nothing answers there.
    pub fn read_u32(&mut self, address: u32) -> Result<u32, Error> {
        self.with(move |core| {
            let at = u64::from(address);
            let memory = core.host.read(at, Width::W32).ok();
            let now = core.stop.at;
            memory
                .or_else(|| core.part().peek(now, at, Width::W32).ok())
                .and_then(|word| u32::try_from(word).ok())
                .ok_or(Error::NoMemory { address })
        })?
    }

    /// The bytes of the variable `name` means, [`Elf::symbol`].
    ///
    /// # Errors
    ///
    /// No such variable, or no memory there.
    pub fn read_symbol(&mut self, name: &str) -> Result<Vec<u8>, Error> {
        let symbol = self.elf.symbol(name)?;
        let (address, size) = (symbol.address, symbol.size as usize);
        self.read(address, size)
    }

    /// Writes `bytes` at `address`: into RAM as the firmware would, into flash whatever the flash
    /// interface says. The core forgets what it had translated from there.
    ///
    /// # Errors
    ///
    /// Nothing there is RAM or flash.
    pub fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), Error> {
        let bytes = bytes.to_vec();
        self.with(move |core| {
            for (at, byte) in (u64::from(address)..).zip(bytes) {
                let byte = u64::from(byte);
                if core.host.read(at, Width::W8).ok() == Some(byte) {
                    continue;
                }
                core.host
                    .write(at, Width::W8, byte)
                    .or_else(|_| core.host.program(at, Width::W8, byte))
                    .map_err(|_| Error::NoMemory { address })?;
            }
            Ok(())
        })?
    }

    /// Hangs the function `name` means: its first instruction becomes a jump to itself. Answers the
    /// two bytes that were there, to be put back with [`Board::write`].
    ///
    /// # Errors
    ///
    /// No such function, or it is not in flash or RAM.
    pub fn hang(&mut self, name: &str) -> Result<(u32, Vec<u8>), Error> {
        self.overwrite(name, BRANCH_TO_SELF)
    }

    /// Makes the function `name` means fault when it is entered, as an undefined instruction does.
    /// Answers as [`Board::hang`].
    ///
    /// # Errors
    ///
    /// No such function, or it is not in flash or RAM.
    pub fn crash(&mut self, name: &str) -> Result<(u32, Vec<u8>), Error> {
        self.overwrite(name, UNDEFINED)
    }

    fn overwrite(&mut self, name: &str, code: [u8; 2]) -> Result<(u32, Vec<u8>), Error> {
        let address = self.elf.function(name)?.address;
        let was = self.read(address, code.len())?;
        self.write(address, &code)?;
        Ok((address, was))
    }

    /// The flash array as a cut of the supply at this instant leaves it: an erase or a word under way
    /// is half done.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn flash(&mut self) -> Result<Vec<u8>, Error> {
        let (base, bytes) = self.chip.facts().flash;
        let mut array = self.read(base, bytes as usize)?;
        let operation = self.with(|core| core.part().flash_operation())?;
        flash::cut(&mut array, operation, self.setup.seed ^ self.instructions);
        Ok(array)
    }

    /// The option bytes as last programmed, as `OPTCR` shows them.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn option_bytes(&mut self) -> Result<u32, Error> {
        self.with(|core| core.part().options())
    }

    /// The core's registers.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn registers(&mut self) -> Result<Registers, Error> {
        self.with(|core| core.registers())?
            .ok_or_else(|| Error::Emulator("the registers do not read back".into()))
    }

    /// Counts the instructions of each call of the function `name` means, interrupts excluded, from
    /// now on.
    ///
    /// # Errors
    ///
    /// No or several functions match; one that was inlined everywhere is none.
    pub fn count(&mut self, name: &str) -> Result<Counter, Error> {
        let entry = self.elf.function(name)?.address;
        self.count_interrupts()?;
        self.with(move |core| {
            let (tracer, mut looker) = core.tracer();
            tracer.count(entry, &mut looker)
        })
    }

    /// The calls `counter` counted since the last time it was asked.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn counts(&mut self, counter: Counter) -> Result<Counts, Error> {
        self.with(move |core| core.tracer.take(counter))
    }

    /// Counts the instructions each exception's handler executes, from now on.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn count_interrupts(&mut self) -> Result<(), Error> {
        let (table, _) = self.chip.facts().flash;
        let elf_table = self
            .elf
            .section(".vector_table")
            .map(|section| section.size);
        let entries = elf_table.map_or(16, |size| size / 4);
        self.with(move |core| {
            let retired = core.stop.instruction_count;
            let (tracer, mut looker) = core.tracer();
            // The first two entries are the stack and the reset.
            let handlers: BTreeSet<u32> = (2..entries)
                .filter_map(|entry| looker.word(table + 4 * entry))
                .filter(|handler| *handler != 0)
                .map(|handler| handler & !1)
                .collect();
            tracer.follow(handlers.into_iter().collect(), retired, &mut looker);
        })
    }

    /// Instructions by exception since the last time this was asked.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn interrupt_counts(&mut self) -> Result<InterruptCounts, Error> {
        self.with(|core| core.tracer.take_interrupts(core.stop.instruction_count))
    }

    /// The bytes the firmware logged over RTT since the last call, raw; empty where it has no RTT.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped, or a control block that makes no sense.
    pub fn rtt_take(&mut self) -> Result<Vec<u8>, Error> {
        let Ok(block) = self.elf.symbol("_SEGGER_RTT") else {
            return Ok(Vec::new());
        };
        let block = block.address;
        self.with(move |core| rtt::drain(core.host, block))?
    }

    /// What the firmware reached that nothing here answers for, and whether it wrote there: where an
    /// emulated firmware may part ways with a real one. The first [`MOST_GAPS`] of each kind.
    ///
    /// # Errors
    ///
    /// An emulator that has stopped.
    pub fn unmodelled(&mut self) -> Result<Vec<(String, bool)>, Error> {
        self.with(|core| {
            let session = &core.session;
            let files = session.unimplemented().values().map(|gap| {
                let register = format!("{} {}", gap.instance, gap.register);
                (register, gap.writes > 0)
            });
            let unmapped = session.unmapped();
            let unmapped = unmapped.iter().map(|gap| (gap.to_string(), false));
            let refused = session.refused().values();
            let refused = refused.map(|fault| (fault.to_string(), false));
            files
                .take(MOST_GAPS)
                .chain(unmapped.take(MOST_GAPS))
                .chain(refused.take(MOST_GAPS))
                .collect()
        })
    }

    /// RAM as it wakes up: any bytes, but the same ones every time.
    fn fill_ram(&mut self) -> Result<(), Error> {
        let ram = self.chip.facts().ram;
        let mut noise = self.setup.seed | 1;
        self.with(move |core| {
            for (base, bytes) in ram {
                for address in (*base..base + bytes).step_by(8) {
                    noise ^= noise << 13;
                    noise ^= noise >> 7;
                    noise ^= noise << 17;
                    core.host
                        .write(u64::from(address), Width::W64, noise)
                        .map_err(|_| Error::NoMemory { address })?;
                }
            }
            Ok(())
        })?
    }

    /// Has the core's thread do `action` while it stands still.
    fn with<T: Send + 'static>(
        &mut self,
        action: impl FnOnce(&mut Core<'_>) -> T + Send + 'static,
    ) -> Result<T, Error> {
        let (answer, answered) = channel();
        self.command(Command::Do(Box::new(move |core| {
            // Nobody waits for the answer once the board is dropped.
            answer.send(action(core)).ok();
        })))?;
        answered.recv().map_err(|_| self.ended())
    }

    fn command(&mut self, command: Command) -> Result<(), Error> {
        let sent = self.commands.as_ref().map(|to| to.send(command).is_ok());
        if sent == Some(true) {
            Ok(())
        } else {
            Err(self.ended())
        }
    }

    fn wait(&mut self) -> Result<(), Error> {
        let stop = self.stopped.recv().map_err(|_| self.ended())?;
        self.now = Duration::from_nanos(stop.at.0);
        self.instructions = stop.instruction_count;
        Ok(())
    }

    /// Why the thread has ended.
    fn ended(&mut self) -> Error {
        let why = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Ok(()))) => "the run is over".to_owned(),
            Some(Ok(Err(why))) => why,
            Some(Err(panic)) => panic
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| panic.downcast_ref::<&str>().map(|&why| why.to_owned()))
                .unwrap_or_else(|| "it panicked".to_owned()),
            None => "it had stopped before".to_owned(),
        };
        Error::Emulator(why)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // An error was reported by whichever call met it.
            thread.join().ok();
        }
    }
}

/// Gaps of each kind that [`Board::unmodelled`] names.
pub const MOST_GAPS: usize = 32;

/// `b .`
const BRANCH_TO_SELF: [u8; 2] = 0xE7FEu16.to_le_bytes();
/// `udf #0`
const UNDEFINED: [u8; 2] = 0xDE00u16.to_le_bytes();

fn broken(error: impl fmt::Display) -> Error {
    Error::Emulator(error.to_string())
}

fn read(host: &mut dyn Host, address: u32, length: usize) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::with_capacity(length);
    let mut at = u64::from(address);
    while bytes.len() < length {
        let left = length - bytes.len();
        let (width, step) = match left {
            8.. if at.is_multiple_of(8) => (Width::W64, 8),
            _ => (Width::W8, 1),
        };
        let word = host.read(at, width);
        let word = word.map_err(|_| Error::NoMemory { address })?;
        bytes.extend_from_slice(&word.to_le_bytes()[..step]);
        at += step as u64;
    }
    Ok(bytes)
}
