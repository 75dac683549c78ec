//! What a board said, read as a list of what was done to it and when.
//!
//! Every line that ends a command, `ok set mix.level=-6 at 51200`, repeats the command and names the frame at which it
//! acted; the greeting names the start; a preset's scene and values come before `ok recall` or the greeting. So the
//! transcript of any terminal is a recording, as long as it begins with the board's start.

use anyhow::{Result, anyhow, bail};
use freshet::TICK;
use freshet::param;
use freshet::protocol::{Boot, Name, Pair, Preset, Request, Slot, parse};

use crate::client::Hello;

/// The frame from which on what is asked for before the first one is heard.
const START: u64 = TICK as u64;

/// From a start of the board to the next one.
#[derive(Clone, Debug, PartialEq)]
pub struct Session<'a> {
    /// Which line greets.
    pub line: usize,
    /// Who was there, and what played.
    pub hello: Hello,
    /// What played at the start, where it was a preset.
    pub preset: Option<Preset>,
    /// In the order in which they act.
    pub events: Vec<Event<'a>>,
    /// The frame at which the board was started again.
    pub end: Option<u64>,
}

/// Something that was done.
#[derive(Clone, Debug, PartialEq)]
pub struct Event<'a> {
    /// Which line says so.
    pub line: usize,
    /// The frame at which it acts.
    pub at: u64,
    /// What it was.
    pub act: Act<'a>,
}

/// What was done.
#[derive(Clone, Debug, PartialEq)]
pub enum Act<'a> {
    /// A command that can be given again.
    Ask(Request<'a>),
    /// A preset was recalled.
    Recall(Box<Preset>),
    /// The sound faded out, and so many ticks later in again.
    Pause(u32),
}

/// All sessions of a transcript, and how many lines with commands before the first one cannot be played.
#[derive(Clone, Debug, PartialEq)]
pub struct Transcript<'a> {
    /// One for each start.
    pub sessions: Vec<Session<'a>>,
    /// Commands before the first start.
    pub before: usize,
}

impl<'a> Transcript<'a> {
    /// Reads `text`; `name` is what to call it in messages.
    ///
    /// # Errors
    /// Which line is damaged, or what is missing.
    pub fn read(name: &str, text: &'a str) -> Result<Self> {
        let mut reader = Reader {
            name,
            line: 0,
            sessions: Vec::new(),
            before: 0,
            events: Vec::new(),
            values: Vec::new(),
            preset: None,
            pause: None,
            started: true,
        };
        let mut lines = text.lines().map(str::trim_end).peekable();
        while let Some(line) = lines.next() {
            reader.line += 1;
            let last = lines.peek().is_none();
            if last && !text.ends_with('\n') && line.starts_with("ok") {
                return Err(reader.error(
                    "the last line has no end, so it may be cut off (give it one if it is whole)",
                ));
            }
            // These are answered by the same words that a start begins with.
            let asked = matches!(lines.peek(), Some(&"ok version" | &"ok boot"));
            reader.read(line, asked)?;
        }
        reader.end()
    }
}

/// A preset being told.
struct Telling<'a> {
    /// The line at which it began to act.
    line: usize,
    /// Its scene; for the one of the start the greeting says it.
    scene: &'a str,
    /// The slot it starts from.
    slot: Option<Slot>,
    /// How many values were there before.
    values: usize,
}

struct Reader<'a, 'n> {
    name: &'n str,
    line: usize,
    sessions: Vec<Session<'a>>,
    before: usize,
    events: Vec<Event<'a>>,
    /// Lines `path = value` that no end of a command has claimed yet.
    values: Vec<Pair>,
    preset: Option<Telling<'a>>,
    /// A pause that has begun: which line says so, and when.
    pause: Option<(usize, u64)>,
    /// The next greeting is expected: nothing was greeted yet, or the board was started again.
    started: bool,
}

impl<'a> Reader<'a, '_> {
    fn error(&self, message: impl std::fmt::Display) -> anyhow::Error {
        anyhow!("{}:{}: {message}", self.name, self.line)
    }

    fn read(&mut self, line: &'a str, asked: bool) -> Result<()> {
        if let Some(rest) = line.strip_prefix("ok ") {
            return self.done(rest);
        }
        if asked {
            return Ok(());
        }
        if line.starts_with("freshet ") {
            return match Hello::parse(line) {
                Some(hello) => self.greeted(hello),
                None => Err(self.error(format!("cannot read the greeting `{line}`"))),
            };
        }
        if let Some(rest) = line.strip_prefix("pause of about ") {
            let at = rest.split_once(" ms at ").map(|(_, at)| at);
            let at = at.ok_or_else(|| self.error("cannot read when the pause begins"))?;
            if let Some((begun, _)) = self.pause {
                return Err(self.error(format!("the pause of line {begun} has no end before this")));
            }
            self.pause = Some((self.line, self.date(at)?));
            return Ok(());
        }
        let Some((left, right)) = line.split_once(" = ") else {
            return Ok(());
        };
        if let Some(scene) = right.strip_suffix(" (plays)")
            && left.starts_with("scene ")
        {
            self.begin(scene, None)?;
        } else if left == "boot" {
            let line = line.replacen(" =", "", 1);
            if let Ok(Request::SetBoot(Boot::Preset(slot))) = parse(&line, &mut |_| {}) {
                self.begin("", Some(slot))?;
            }
        } else if param::index_of(left).is_some() && !right.contains(" (default ") {
            let value = right.split(' ').next().unwrap_or_default();
            let line = format!("set {left}={value}");
            match parse(&line, &mut |_| {}) {
                Ok(Request::Set { values, .. }) if values.len() == 1 => {
                    self.values.push(values[0]);
                }
                _ => return Err(self.error(format!("cannot read the value `{value}`"))),
            }
        }
        Ok(())
    }

    /// A preset may begin to be told here.
    fn begin(&mut self, scene: &'a str, slot: Option<Slot>) -> Result<()> {
        if self
            .preset
            .as_ref()
            .is_some_and(|told| told.values < self.values.len())
        {
            return Err(self.error("a preset begins before the one before it has ended"));
        }
        self.preset = Some(Telling {
            line: self.line,
            scene,
            slot,
            values: self.values.len(),
        });
        Ok(())
    }

    /// The preset that was told up to here.
    fn told(&mut self, told: &Telling<'_>, scene: &str) -> Result<Preset> {
        let name = Name::try_from(scene);
        let values = self.values.split_off(told.values.min(self.values.len()));
        if values.len() > param::COUNT {
            return Err(self.error("more values than there are parameters"));
        }
        Ok(Preset {
            name: Name::new(),
            scene: name.map_err(|_| self.error(format!("cannot read the scene `{scene}`")))?,
            values: values.into_iter().collect(),
        })
    }

    fn greeted(&mut self, hello: Hello) -> Result<()> {
        if hello.at != START {
            return Err(self.error(format!(
                "this greeting comes {} frames after the start: what was before is not known (begin the recording with `restart`, as `freshet record` does)",
                hello.at - hello.at.min(START)
            )));
        }
        if !self.started {
            return Err(self.error(
                "the board has started again here, and nothing says when it stopped (cut the file here, and play both parts)",
            ));
        }
        if let Some((line, _)) = self.pause.take() {
            return Err(self.error(format!("the pause of line {line} has no end before this")));
        }
        let preset = match self.preset.take() {
            Some(told) if told.slot.is_some() => {
                // What was done while it was told belongs to it, and nothing before.
                self.before += self
                    .events
                    .iter()
                    .filter(|event| event.line < told.line)
                    .count();
                self.events.retain(|event| event.line > told.line);
                Some(self.told(&told, &hello.scene)?)
            }
            _ => {
                self.before += self.events.len();
                self.events.clear();
                None
            }
        };
        self.values.clear();
        self.started = false;
        self.sessions.push(Session {
            line: self.line,
            hello,
            preset,
            events: std::mem::take(&mut self.events),
            end: None,
        });
        Ok(())
    }

    fn date(&self, text: &str) -> Result<u64> {
        match text.parse::<u64>() {
            Ok(at) if at >= START && at.is_multiple_of(TICK as u64) => Ok(at),
            _ => Err(self.error(format!(
                "cannot read the frame `{text}`: expected a multiple of {TICK}"
            ))),
        }
    }

    /// The end of a command.
    fn done(&mut self, rest: &'a str) -> Result<()> {
        let (command, at) = match rest.rsplit_once(" at ") {
            Some((command, at)) => (command, Some(self.date(at)?)),
            None => (rest, None),
        };
        let mut whole = true;
        let request = parse(command, &mut |_| whole = false);
        let request = match request {
            Ok(request) if whole => request,
            Err(refusal) => {
                return Err(self.error(format!("cannot read `ok {rest}`: {refusal}")));
            }
            Ok(_) => return Err(self.error(format!("cannot read `ok {rest}`"))),
        };
        let slot = self.preset.as_ref().map(|told| told.values);
        match (&request, at) {
            (Request::Get(ids), _) => {
                let left = self.values.len().checked_sub(ids.len());
                let left = left.filter(|left| {
                    let told = self.values[*left..].iter().map(|(id, _)| id);
                    told.eq(ids) && slot.is_none_or(|begun| begun <= *left)
                });
                let left = left.ok_or_else(|| {
                    self.error(format!("the values of `{command}` are not before it"))
                })?;
                self.values.truncate(left);
            }
            (Request::Scenes, _) => {
                // That was it, and no preset: one that is recalled meanwhile is told to its end.
                self.preset = self.preset.take().filter(|told| told.slot.is_some());
            }
            (Request::Recall(_), Some(at)) => {
                let told = self.preset.take().filter(|told| told.slot.is_none());
                let told = told.ok_or_else(|| {
                    self.error(format!(
                        "the scene and the values of `{command}` are not before it"
                    ))
                })?;
                let preset = self.told(&told, told.scene)?;
                self.event(told.line, at, Act::Recall(Box::new(preset)));
            }
            (Request::Store { .. } | Request::Erase(_) | Request::SetBoot(_), Some(at)) => {
                // Without a pause it is not heard.
                if let Some((line, begun)) = self.pause.take() {
                    let ticks = at.checked_sub(begun).map(|frames| frames / TICK as u64);
                    let ticks = ticks.and_then(|ticks| u32::try_from(ticks).ok());
                    let ticks = ticks.ok_or_else(|| {
                        self.error(format!("the pause of line {line} begins at {begun}"))
                    })?;
                    self.event(line, begun, Act::Pause(ticks));
                }
            }
            (Request::Restart, Some(at)) => {
                let end = at - START;
                match self.sessions.last_mut() {
                    Some(session) if !self.started => {
                        let mut events = std::mem::take(&mut self.events);
                        session.events.append(&mut events);
                        // What was asked for too late was never heard.
                        session.events.retain(|event| event.at < end);
                        session.end = Some(end);
                    }
                    _ => {
                        self.before += self.events.len();
                        self.events.clear();
                    }
                }
                (self.preset, self.started) = (None, true);
                self.values.clear();
            }
            (
                Request::Set { .. }
                | Request::Scene(_)
                | Request::Trigger { .. }
                | Request::Mute(_),
                Some(at),
            ) => self.event(self.line, at, Act::Ask(request)),
            (
                Request::Set { .. }
                | Request::Scene(_)
                | Request::Trigger { .. }
                | Request::Mute(_)
                | Request::Recall(_)
                | Request::Store { .. }
                | Request::Erase(_)
                | Request::SetBoot(_)
                | Request::Restart,
                None,
            ) => return Err(self.error(format!("`ok {rest}` does not say at which frame"))),
            _ => {}
        }
        Ok(())
    }

    fn event(&mut self, line: usize, at: u64, act: Act<'a>) {
        self.events.push(Event { line, at, act });
    }

    fn end(mut self) -> Result<Transcript<'a>> {
        if let Some((line, _)) = self.pause {
            self.line = line;
            return Err(self.error("the pause that begins here has no end: the file is cut off, or the board could not keep what it should"));
        }
        let Some(session) = self.sessions.last_mut() else {
            bail!(
                "{}: no start of a board in it, only {} commands; a recording begins with the line `freshet version=…` that a board says at its start (say `restart` first, as `freshet record` does)",
                self.name,
                self.events.len()
            );
        };
        if session.end.is_none() {
            session.events.append(&mut self.events);
        }
        for session in &mut self.sessions {
            // A bubble may have waited, and a preset is told at length: what acts first is not always said first.
            session.events.sort_by_key(|event| (event.at, event.line));
        }
        Ok(Transcript {
            sessions: self.sessions,
            before: self.before,
        })
    }
}
