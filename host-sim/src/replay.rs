//! `freshet replay`: a recorded session on the desk, sample for sample as the board played it.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use freshet::mix::Output;
use freshet::param::SCHEMA;
use freshet::protocol::{
    BootRecord, Device, FRAME_MAX, Job, PAYLOAD_MAX, Reply, Request as Ask, Tag, decode, encode,
};
use freshet::{Frame, TICK};

use crate::board::Board;
use crate::built_in;
use crate::scene_file::cannot_read;
use crate::transcript::{Act, Event, Session, Transcript};
use crate::twin::{Kept, Setup, Twin};
use crate::wav::{self, Format, WavWriter};

/// What is heard after the last command where nothing is said, s.
const TAIL: f64 = 5.0;

/// What `freshet replay` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// A recording (`freshet record`), or the transcript of any terminal program
    pub file: PathBuf,
    /// Where the sound goes; `-` is the standard output [default: the file's name, .wav]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// How long [default: to 5 s after the last command]
    #[arg(long, value_name = "S", alias = "duration", allow_hyphen_values = true)]
    pub seconds: Option<f64>,
    /// Bits of a sample, 16 or 24 [default: 16]
    #[arg(long, value_parser = ["16", "24"])]
    pub bits: Option<String>,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Report {
    /// Where the sound went.
    pub output: PathBuf,
    /// Frames written.
    pub frames: u64,
    /// Sample rate, Hz.
    pub rate: u32,
    /// Commands played.
    pub commands: usize,
    /// Starts of the board.
    pub starts: usize,
    /// Commands before the first start, which cannot be played.
    pub before: usize,
    /// Ended by Ctrl-C.
    pub interrupted: bool,
    /// Time it took.
    pub elapsed: Duration,
}

impl Report {
    /// The summary, for people.
    pub fn summary(&self) -> String {
        let seconds = self.frames as f64 / f64::from(self.rate);
        let output = match self.output.to_string_lossy() {
            name if name == "-" => "standard output".into(),
            name => name,
        };
        let mut text = format!(
            "{output}  {seconds:.3} s at {} Hz, at {:.0} x real time{}\ncommands  {}, {} of the board",
            self.rate,
            seconds / self.elapsed.as_secs_f64().max(1e-9),
            if self.interrupted {
                " (stopped early)"
            } else {
                ""
            },
            self.commands,
            match self.starts {
                1 => "1 start".to_owned(),
                starts => format!("{starts} starts"),
            },
        );
        if self.before > 0 {
            text += &format!(
                "\nnote      {} commands before the first start were left out",
                self.before
            );
        }
        text
    }
}

/// Plays a recording to a WAV. `stop` ends it early with a valid file.
pub fn replay(request: &Request, stop: &AtomicBool) -> Result<Report> {
    let path = &request.file;
    let bytes = std::fs::read(path).map_err(|error| cannot_read(path, &error))?;
    // What a terminal adds in other encodings is in no line that counts.
    let text = String::from_utf8_lossy(&bytes);
    let name = path.display().to_string();
    let (output, format) = match request.bits.as_deref() {
        Some("24") => (Output::Bits24, Format::Int24),
        _ => (Output::Bits16, Format::Int16),
    };
    let replay = Replay::new(&name, &text, output)?;
    let rate = replay.rate;
    let frames = match request.seconds {
        None => replay.frames,
        Some(seconds) => {
            let frames = (seconds * f64::from(rate)).round();
            if !(1.0..=1e15).contains(&frames) {
                bail!("--seconds {seconds:?}: expected a number above 0");
            }
            frames as u64
        }
    };
    let output = match &request.output {
        Some(path) => path.clone(),
        None => Path::new(path.file_stem().unwrap_or_default()).with_extension("wav"),
    };
    if std::fs::canonicalize(&output)
        .is_ok_and(|place| std::fs::canonicalize(path).is_ok_and(|path| path == place))
    {
        bail!("cannot write the sound to {name}: the recording is there (give another name)");
    }
    let mut wav = WavWriter::create(&output, format, rate, frames)?;
    let begun = Instant::now();
    let (commands, starts, before) = (replay.commands(), replay.sessions.len(), replay.before);
    let mut written = 0;
    let mut failed = None;
    replay.play(frames, |frames| {
        for frame in frames {
            if let Err(error) = wav.write_int(frame.left, frame.right) {
                failed = Some(error);
                return false;
            }
            written += 1;
        }
        !stop.load(Ordering::Relaxed)
    })?;
    match failed {
        Some(error) if !wav::is_broken_pipe(&error) => return Err(error),
        _ => wav.finish()?,
    }
    Ok(Report {
        output,
        frames: written,
        rate,
        commands,
        starts,
        before,
        interrupted: stop.load(Ordering::Relaxed),
        elapsed: begun.elapsed(),
    })
}

/// A recording, ready to be played.
pub struct Replay<'a> {
    name: &'a str,
    sessions: Vec<(Session<'a>, Setup)>,
    /// Sample rate, Hz.
    pub rate: u32,
    /// Frames to a while after the last command.
    pub frames: u64,
    /// Commands before the first start, which cannot be played.
    pub before: usize,
}

impl<'a> Replay<'a> {
    /// Of the transcript `text`; `name` is what to call it in messages.
    ///
    /// # Errors
    /// Which line is damaged, what is missing, or what this version cannot play.
    pub fn new(name: &'a str, text: &'a str, output: Output) -> Result<Self> {
        let transcript = Transcript::read(name, text)?;
        let scenes = built_in::named()?;
        let mut sessions = Vec::new();
        let mut frames = 0;
        let mut rate = None;
        for session in transcript.sessions {
            let error = |text: String| anyhow!("{name}:{}: {text}", session.line);
            let setup =
                setup(&session, &scenes, output).map_err(|error_| error(error_.to_string()))?;
            if *rate.get_or_insert(setup.rate) != setup.rate {
                return Err(error("another sample rate than before".to_owned()));
            }
            let last = session.events.last().map_or(0, |event| event.at);
            frames += session
                .end
                .unwrap_or(last.saturating_add((TAIL * f64::from(setup.rate)) as u64));
            sessions.push((session, setup));
        }
        Ok(Self {
            name,
            sessions,
            rate: rate.with_context(|| format!("{name}: no start of a board in it"))?,
            frames,
            before: transcript.before,
        })
    }

    /// How many commands there are.
    pub fn commands(&self) -> usize {
        self.sessions
            .iter()
            .map(|(session, _)| session.events.len())
            .sum()
    }

    /// Plays `frames` frames; `take` has them as they come, and says whether to go on.
    pub fn play(self, frames: u64, mut take: impl FnMut(&[Frame]) -> bool) -> Result<()> {
        let mut left = frames;
        for (session, setup) in self.sessions {
            let mut player = Player {
                twin: Twin::with(setup),
                played: 0,
                left: &mut left,
                take: &mut take,
            };
            for event in &session.events {
                // What acts at a frame is asked for a tick before.
                if !player.until(event.at - TICK as u64) {
                    return Ok(());
                }
                player
                    .act(event)
                    .map_err(|error| anyhow!("{}:{}: {error:#}", self.name, event.line))?;
            }
            if !player.until(session.end.unwrap_or(u64::MAX)) {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// The twin of the board that greets a session, as it was at its start.
fn setup(
    session: &Session<'_>,
    scenes: &[(String, freshet::scene::Scene)],
    output: Output,
) -> Result<Setup> {
    let hello = &session.hello;
    if hello.schema != SCHEMA || hello.version != env!("CARGO_PKG_VERSION") {
        bail!(
            "recorded with freshet {} (schema {:08x}), and this is {} (schema {SCHEMA:08x}): the sound would be another one",
            hello.version,
            hello.schema,
            env!("CARGO_PKG_VERSION")
        );
    }
    let board = Board::from_str(&hello.board, false);
    let board = board.map_err(|_| anyhow!("there is no board `{}` here", hello.board))?;
    if !(8_000.0..=192_000.0).contains(&hello.rate) || hello.rate.fract() != 0.0 {
        bail!(
            "a sample rate of {} Hz; expected a whole number from 8000 to 192000",
            hello.rate
        );
    }
    let first = scenes.iter().position(|(name, _)| *name == hello.scene);
    let first = first.with_context(|| {
        format!(
            "there is no scene `{}` here (`freshet list` shows all)",
            hello.scene
        )
    })?;
    let mut kept = Kept::default();
    if let Some(preset) = &session.preset {
        kept.presets.insert(1, preset.clone());
        kept.boot = BootRecord::Preset(1);
    }
    Ok(Setup {
        board,
        rate: hello.rate as u32,
        seed: hello.seed,
        scenes: scenes.to_vec(),
        first: first as u16,
        kept,
        output,
    })
}

/// A session being played.
struct Player<'a> {
    twin: Twin,
    played: u64,
    left: &'a mut u64,
    take: &'a mut dyn FnMut(&[Frame]) -> bool,
}

impl Player<'_> {
    /// Plays up to a frame; false where nothing more is wanted.
    fn until(&mut self, frame: u64) -> bool {
        let mut tick = [Frame::ZERO; TICK];
        while self.played < frame {
            let count = (*self.left).min(TICK as u64);
            if count == 0 {
                return false;
            }
            self.twin.render(&mut tick);
            self.played += TICK as u64;
            *self.left -= count;
            if !(self.take)(&tick[..count as usize]) {
                return false;
            }
        }
        true
    }

    fn act(&mut self, event: &Event<'_>) -> Result<()> {
        let device = self.twin.device();
        let mut at = device.date();
        match &event.act {
            Act::Ask(request) => at = self.ask(request)?,
            Act::Recall(preset) => {
                let (scene, number) = device.recalled(preset);
                device.control_mut().load(&scene);
                device.set_playing(number);
            }
            Act::Pause(ticks) => {
                // The tick in which it begins counts. Whatever the job was, nothing of it is heard.
                device.set_pause(ticks.saturating_add(1));
                (device.begin(Job::Erase(0))).map_err(|refusal| anyhow!("{refusal}"))?;
            }
        }
        if at != event.at {
            bail!(
                "this acts at frame {at}, and the recording says {}",
                event.at
            );
        }
        Ok(())
    }

    /// Asks the twin for something; returns when it acts.
    fn ask(&mut self, request: &Ask<'_>) -> Result<u64> {
        const TAG: Tag = 1;
        let mut bytes = [0; FRAME_MAX + 3];
        let length = encode(&(TAG, request), &mut bytes)
            .map_err(|_| anyhow!("a command that is too long"))?;
        self.twin.take();
        self.twin.receive(&bytes[..length]);
        let said = self.twin.take();
        for frame in said.split(|byte| *byte == 0) {
            let mut payload = [0; PAYLOAD_MAX];
            match decode::<(Tag, Reply<'_>)>(frame, &mut payload) {
                Ok((TAG, Reply::Done { at: Some(at) })) => return Ok(at),
                Ok((TAG, Reply::Refused(refusal) | Reply::Skipped(refusal))) => {
                    bail!("the twin refuses: {refusal}")
                }
                _ => {}
            }
        }
        bail!("the twin does not do that")
    }
}
