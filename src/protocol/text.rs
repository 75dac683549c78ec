//! The door for people: requests from lines, and replies as lines.

use core::fmt::{self, Display, Formatter};

use heapless::Vec;

use super::message::{
    Boot, Choice, Hello, NAME, PAIRS, Pair, Refusal, Reply, Request, Row, SLOTS, Slot, Status,
};
use crate::control::RAMP_MAX;
use crate::param::{self, Kind, Param, TABLE};

/// A command for people: how it is used, and what it does.
struct Command {
    name: &'static str,
    usage: &'static str,
    about: &'static str,
}

const COMMANDS: &[Command] = &[
    Command {
        name: "help",
        usage: "help [COMMAND]",
        about: "what can be asked",
    },
    Command {
        name: "list",
        usage: "list [PATH]",
        about: "all parameters, or those whose path begins so: value, default, stored, range",
    },
    Command {
        name: "describe",
        usage: "describe PATH",
        about: "all about a parameter, or about those whose path begins so",
    },
    Command {
        name: "get",
        usage: "get PATH [PATH …]",
        about: "values of some parameters",
    },
    Command {
        name: "set",
        usage: "set PATH VALUE [SECONDS] or set PATH=VALUE [PATH=VALUE …] [ramp=SECONDS]",
        about: "moves parameters; `default` is a value too",
    },
    Command {
        name: "scene",
        usage: "scene [NAME or NUMBER]",
        about: "the scenes, or plays one",
    },
    Command {
        name: "trigger",
        usage: "trigger [RADIUS_MM [PRESSURE_PA [RISE_FACTOR]]]",
        about: "sounds one bubble; as the drops' parameters say where nothing is given",
    },
    Command {
        name: "mute",
        usage: "mute [on or off]",
        about: "silence, and back",
    },
    Command {
        name: "store",
        usage: "store [SLOT [NAME]]",
        about: "keeps the settings as they are now, or as preset 1 to 16; the sound fades out meanwhile",
    },
    Command {
        name: "recall",
        usage: "recall [SLOT]",
        about: "goes back to the settings stored last, or to a preset",
    },
    Command {
        name: "presets",
        usage: "presets",
        about: "the presets there are",
    },
    Command {
        name: "erase",
        usage: "erase SLOT",
        about: "forgets a preset, or in slot 0 the settings stored last",
    },
    Command {
        name: "boot",
        usage: "boot [default, scene NAME, preset SLOT or settings]",
        about: "what is played when the power comes on, or changes that",
    },
    Command {
        name: "status",
        usage: "status",
        about: "load, voices, faults, time since the start",
    },
    Command {
        name: "version",
        usage: "version",
        about: "version, board, sample rate, seed, schema of the parameters, scene, frame",
    },
    Command {
        name: "restart",
        usage: "restart",
        about: "starts the board again",
    },
];

/// The request in a line. Parameters that it cannot set are told to `skip` one by one.
pub fn parse<'a>(
    line: &'a str,
    skip: &mut dyn FnMut(Refusal<'a>),
) -> Result<Request<'a>, Refusal<'a>> {
    let line = line.trim();
    let (command, rest) = match line.split_once(char::is_whitespace) {
        Some((command, rest)) => (command, rest.trim()),
        None => (line, ""),
    };
    let usage = || Refusal::Usage(usage(command));
    let nothing = |request| {
        if rest.is_empty() {
            Ok(request)
        } else {
            Err(usage())
        }
    };
    match command {
        "set" => set(rest, skip),
        "get" => get(rest, skip),
        "help" | "?" => Ok(Request::Help(rest)),
        "hello" | "version" => nothing(Request::Hello),
        "list" => Ok(Request::List(group(rest)?)),
        "describe" if rest.is_empty() => Err(usage()),
        "describe" => Ok(Request::Describe(group(rest)?)),
        "scene" if rest.is_empty() => Ok(Request::Scenes),
        "scenes" => nothing(Request::Scenes),
        "scene" => Ok(Request::Scene(choice(rest))),
        "trigger" => trigger(rest).ok_or_else(usage),
        "mute" => match rest {
            "" | "on" => Ok(Request::Mute(true)),
            "off" => Ok(Request::Mute(false)),
            _ => Err(usage()),
        },
        "unmute" => nothing(Request::Mute(false)),
        "presets" => nothing(Request::Presets),
        "store" => {
            let (slot, name) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            let slot = if slot.is_empty() {
                0
            } else {
                number(slot).ok_or_else(usage)?
            };
            let name = name.trim();
            if is_name(name) {
                Ok(Request::Store { slot, name })
            } else {
                Err(Refusal::Name)
            }
        }
        "recall" if rest.is_empty() => Ok(Request::Recall(0)),
        "recall" => Ok(Request::Recall(number(rest).ok_or_else(usage)?)),
        "erase" => Ok(Request::Erase(number(rest).ok_or_else(usage)?)),
        "boot" if rest.is_empty() => Ok(Request::Boot),
        "boot" => Ok(Request::SetBoot(boot(rest).ok_or_else(usage)?)),
        "status" => nothing(Request::Status),
        "restart" => nothing(Request::Restart),
        _ => Err(Refusal::Command(command)),
    }
}

/// How `command` is used.
fn usage(command: &str) -> &'static str {
    let command = COMMANDS.iter().find(|known| known.name == command);
    command.map_or("", |command| command.usage)
}

/// Whether a person may call something so.
pub(super) fn is_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || " -_.".contains(c);
    name.len() <= NAME && name.chars().all(plain)
}

fn number(text: &str) -> Option<Slot> {
    text.parse().ok()
}

fn choice(text: &str) -> Choice<'_> {
    text.parse().map_or(Choice::Name(text), Choice::Number)
}

fn boot(text: &str) -> Option<Boot<'_>> {
    let (kind, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    match (kind, rest.trim()) {
        ("default", "") => Some(Boot::Default),
        ("settings", "") => Some(Boot::Preset(0)),
        ("scene", name) if !name.is_empty() => Some(Boot::Scene(name)),
        ("preset", slot) => number(slot).map(Boot::Preset),
        _ => None,
    }
}

fn trigger(text: &str) -> Option<Request<'_>> {
    let mut numbers = [None; 3];
    for (i, word) in text.split_ascii_whitespace().enumerate() {
        *numbers.get_mut(i)? = Some(word.parse().ok()?);
    }
    let [radius, pressure, rise_factor] = numbers;
    Some(Request::Trigger {
        radius,
        pressure,
        rise_factor,
    })
}

/// A path, or how some of them begin.
fn group(text: &str) -> Result<&str, Refusal<'_>> {
    if TABLE.iter().any(|param| param.path.starts_with(text)) {
        Ok(text)
    } else {
        Err(unknown(text))
    }
}

fn unknown(path: &str) -> Refusal<'_> {
    Refusal::Path(path, nearest(path))
}

fn get<'a>(text: &'a str, skip: &mut dyn FnMut(Refusal<'a>)) -> Result<Request<'a>, Refusal<'a>> {
    let mut ids = Vec::new();
    for path in text.split_ascii_whitespace() {
        match param::index_of(path) {
            Some(index) => ids.push(TABLE[index].id).map_err(|_| Refusal::TooMany)?,
            None => skip(unknown(path)),
        }
    }
    if ids.is_empty() {
        return Err(Refusal::Usage(usage("get")));
    }
    Ok(Request::Get(ids))
}

fn set<'a>(text: &'a str, skip: &mut dyn FnMut(Refusal<'a>)) -> Result<Request<'a>, Refusal<'a>> {
    let wrong = || Refusal::Usage(usage("set"));
    let mut words = text
        .split(|c: char| c == '=' || c.is_ascii_whitespace())
        .filter(|word| !word.is_empty());
    let mut values = Vec::new();
    let mut ramp = None;
    let mut any = false;
    while let Some(path) = words.next() {
        let seconds = match (path, words.next()) {
            ("ramp" | "in", Some(seconds)) => seconds,
            // `set PATH VALUE SECONDS`.
            (seconds, None) if any => seconds,
            (_, None) => return Err(wrong()),
            (path, Some(value)) => {
                any = true;
                match pair(path, value) {
                    Ok(pair) => values.push(pair).map_err(|_| Refusal::TooMany)?,
                    Err(refusal) => skip(refusal),
                }
                continue;
            }
        };
        ramp = Some(seconds.parse().map_err(|_| wrong())?);
    }
    if !any {
        return Err(wrong());
    }
    Ok(Request::Set { values, ramp })
}

fn pair<'a>(path: &'a str, value: &'a str) -> Result<Pair, Refusal<'a>> {
    let param = &TABLE[param::index_of(path).ok_or_else(|| unknown(path))?];
    let named = match param.kind {
        _ if value == "default" => Some(param.default),
        Kind::Choice(names) => (names.iter().position(|name| *name == value)).map(|i| i as f32),
        Kind::Real | Kind::Whole => None,
    };
    match named.or_else(|| value.parse().ok()) {
        Some(number) => Ok((param.id, number)),
        None => Err(Refusal::Text(param.id, value)),
    }
}

/// The path that `text` was meant to be, if it is not far off.
fn nearest(text: &str) -> Option<&'static str> {
    let named = TABLE[..param::WEIGHT].iter().map(|param| param.path);
    let (distance, path) = named
        .map(|path| (distance(text.as_bytes(), path.as_bytes()), path))
        .min_by_key(|(distance, _)| *distance)?;
    let end = |path: &'static str| path.rsplit_once('.').map(|(_, end)| end) == Some(text);
    match TABLE.iter().find(|param| end(param.path)) {
        // The last part alone.
        Some(param) => Some(param.path),
        None => (distance <= 3).then_some(path),
    }
}

/// Levenshtein's distance, for words of less than 32 bytes.
fn distance(a: &[u8], b: &[u8]) -> usize {
    let mut row: [usize; 32] = core::array::from_fn(|i| i);
    if a.len().max(b.len()) >= row.len() {
        return usize::MAX;
    }
    for (i, x) in a.iter().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = corner + usize::from(x != y);
            corner = row[j + 1];
            row[j + 1] = change.min(corner + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// A value with its name, where it has one.
struct Shown(&'static Param, f32);

impl Display for Shown {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0.kind {
            Kind::Choice(names) => match names.get(self.1 as usize) {
                // Only itself: -6 is not the first one.
                Some(name) if self.1 as usize as f32 == self.1 => f.write_str(name),
                _ => self.1.fmt(f),
            },
            Kind::Real | Kind::Whole => self.1.fmt(f),
        }
    }
}

/// As the command that asks for it.
impl Display for Request<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let with = |f: &mut Formatter<'_>, command: &str, rest: &str| {
            f.write_str(command)?;
            if rest.is_empty() {
                return Ok(());
            }
            write!(f, " {rest}")
        };
        match self {
            Self::Hello => f.write_str("version"),
            Self::Help(command) => with(f, "help", command),
            Self::List(path) => with(f, "list", path),
            Self::Describe(path) => with(f, "describe", path),
            Self::Get(ids) => {
                f.write_str("get")?;
                (ids.iter()).try_for_each(|id| match param::index_of_id(*id) {
                    Some(index) => write!(f, " {}", TABLE[index].path),
                    None => Ok(()),
                })
            }
            Self::Set { values, ramp } => {
                f.write_str("set")?;
                for &(id, value) in values {
                    if let Some(index) = param::index_of_id(id) {
                        let param = &TABLE[index];
                        write!(f, " {}={}", param.path, Shown(param, value))?;
                    }
                }
                ramp.map_or(Ok(()), |ramp| write!(f, " ramp={ramp}"))
            }
            Self::Scenes => f.write_str("scene"),
            Self::Scene(Choice::Number(number)) => write!(f, "scene {number}"),
            Self::Scene(Choice::Name(name)) => write!(f, "scene {name}"),
            Self::Trigger {
                radius,
                pressure,
                rise_factor,
            } => {
                f.write_str("trigger")?;
                // What is left out can only be the last ones.
                [radius, pressure, rise_factor]
                    .iter()
                    .map_while(|number| number.as_ref())
                    .try_for_each(|number| write!(f, " {number}"))
            }
            Self::Mute(true) => f.write_str("mute on"),
            Self::Mute(false) => f.write_str("mute off"),
            Self::Presets => f.write_str("presets"),
            Self::Store { slot: 0, name: "" } => f.write_str("store"),
            Self::Store { slot, name } => {
                write!(f, "store {slot}")?;
                with(f, "", name)
            }
            Self::Recall(slot) => write!(f, "recall {slot}"),
            Self::Erase(slot) => write!(f, "erase {slot}"),
            Self::Boot => f.write_str("boot"),
            Self::SetBoot(boot) => write!(f, "boot {boot}"),
            Self::Status => f.write_str("status"),
            Self::Subscribe(ticks) => write!(f, "subscribe {ticks}"),
            Self::Restart => f.write_str("restart"),
        }
    }
}

impl Display for Boot<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Scene(name) => write!(f, "scene {name}"),
            Self::Preset(0) => f.write_str("settings"),
            Self::Preset(slot) => write!(f, "preset {slot}"),
        }
    }
}

/// A reply as one or more lines, each with its end. The request it belongs to says how much is told, and is repeated
/// where it is done: `ok set mix.level=-6 at 51200`.
pub struct Line<'a>(pub &'a Reply<'a>, pub &'a Request<'a>);

impl Display for Line<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            Reply::Hello(hello) => hello.fmt(f),
            Reply::Text(text) => writeln!(f, "{text}"),
            Reply::Row(row) if matches!(self.1, Request::Describe(_)) => describe(row, f),
            Reply::Row(row) => list(row, f),
            Reply::Value((id, value)) => match param::index_of_id(*id) {
                Some(index) => {
                    let param = &TABLE[index];
                    write!(f, "{} = {}", param.path, Shown(param, *value))?;
                    unit(param.unit, f)?;
                    f.write_str("\n")
                }
                None => Ok(()),
            },
            Reply::Scene {
                number,
                name,
                plays,
            } => {
                let mark = if *plays { " (plays)" } else { "" };
                writeln!(f, "scene {number} = {name}{mark}")
            }
            Reply::Preset { slot: 0, scene, .. } => writeln!(f, "settings = over {scene}"),
            Reply::Preset { slot, name, scene } => {
                let blank = if name.is_empty() { "" } else { " " };
                writeln!(f, "preset {slot} = {name}{blank}(over {scene})")
            }
            Reply::Boot(boot) => writeln!(f, "boot = {boot}"),
            Reply::Status(status) => status.fmt(f),
            Reply::Pause { ms, at } => writeln!(f, "pause of about {ms} ms at {at}"),
            Reply::Skipped(refusal) | Reply::Refused(refusal) => writeln!(f, "error {refusal}"),
            Reply::Done { at: Some(at) } => writeln!(f, "ok {} at {at}", self.1),
            Reply::Done { at: None } => writeln!(f, "ok {}", self.1),
        }
    }
}

fn unit(unit: &str, f: &mut Formatter<'_>) -> fmt::Result {
    if unit.is_empty() {
        return Ok(());
    }
    write!(f, " {unit}")
}

/// The value of a row as a person says it.
struct In<'a>(&'a Row<'a>, f32);

impl Display for In<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0.choices.get(self.1 as usize) {
            Some(name) => f.write_str(name),
            None => self.1.fmt(f),
        }
    }
}

fn range(row: &Row<'_>, f: &mut Formatter<'_>) -> fmt::Result {
    if row.choices.is_empty() {
        return write!(f, "{} to {}", row.range.0, row.range.1);
    }
    for (i, name) in row.choices.iter().enumerate() {
        let or = if i == 0 { "" } else { " | " };
        write!(f, "{or}{name}")?;
    }
    Ok(())
}

fn list(row: &Row<'_>, f: &mut Formatter<'_>) -> fmt::Result {
    write!(f, "{} = {}", row.path, In(row, row.value))?;
    unit(row.unit, f)?;
    write!(f, " (default {}", In(row, row.default))?;
    if let Some(stored) = row.stored {
        write!(f, ", stored {}", In(row, stored))?;
    }
    f.write_str(", ")?;
    range(row, f)?;
    f.write_str(")\n")
}

fn describe(row: &Row<'_>, f: &mut Formatter<'_>) -> fmt::Result {
    list(row, f)?;
    writeln!(f, "  {}", row.about)?;
    write!(f, "  id {}", row.id)?;
    if row.log.is_some() {
        f.write_str(", logarithmic")?;
    }
    if row.whole && row.choices.is_empty() {
        f.write_str(", whole numbers")?;
    }
    if row.ramp > 0.0 {
        write!(f, ", moves in {} s", row.ramp)?;
    }
    f.write_str("\n")
}

impl Display for Hello<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "freshet version={} board={} rate={} seed={} schema={:08x} at={} scene={}",
            self.version, self.board, self.rate, self.seed, self.schema, self.at, self.scene
        )
    }
}

impl Display for Status<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let percent = |part: f32| libm::roundf(part * 1000.0) / 10.0;
        writeln!(f, "load = {} %", percent(self.load))?;
        writeln!(f, "peak = {} %", percent(self.peak))?;
        writeln!(f, "births = {}", self.births)?;
        writeln!(f, "voices = {}", self.voices)?;
        writeln!(f, "stolen = {}", self.stolen)?;
        writeln!(f, "unvoiced = {}", self.unvoiced)?;
        writeln!(f, "limited = {}", self.limited)?;
        writeln!(f, "clipped = {}", self.clipped)?;
        writeln!(f, "underruns = {}", self.underruns)?;
        writeln!(f, "restarts = {}", self.restarts)?;
        writeln!(f, "missed = {}", self.missed)?;
        writeln!(f, "overruns = {}", self.overruns)?;
        writeln!(f, "framing = {}", self.framing)?;
        writeln!(f, "garbage = {}", self.garbage)?;
        writeln!(f, "dropped = {}", self.dropped)?;
        writeln!(f, "uptime = {} s", self.uptime)?;
        writeln!(f, "frame = {}", self.frame)?;
        if let Some(celsius) = self.temperature {
            writeln!(f, "temperature = {} °C", libm::roundf(celsius))?;
        }
        writeln!(f, "trouble = {}", if self.trouble { "yes" } else { "no" })?;
        writeln!(f, "cause = {}", self.cause)?;
        if !self.panic.is_empty() {
            // A crash may have more lines than one.
            f.write_str("panic = ")?;
            let lines = self.panic.split(['\n', '\r']);
            lines.enumerate().try_for_each(|(i, line)| {
                let blank = if i == 0 { "" } else { " " };
                write!(f, "{blank}{line}")
            })?;
            f.write_str("\n")?;
        }
        Ok(())
    }
}

impl Display for Refusal<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(command) => write!(f, "no command `{command}`; `help` lists them"),
            Self::Usage(usage) => write!(f, "expected {usage}"),
            Self::Path(path, Some(near)) => {
                write!(f, "no parameter `{path}`; did you mean `{near}`?")
            }
            Self::Path(path, None) => {
                write!(f, "no parameter `{path}`; `list` shows them")
            }
            Self::Id(id) => write!(f, "no parameter of id {id}"),
            Self::Value(id, value) => refuse(*id, value, f),
            Self::Text(id, text) => refuse(*id, text, f),
            Self::Ramp(seconds) => {
                write!(f, "a ramp of {seconds} s; expected 0 to {RAMP_MAX} s")
            }
            Self::TooMany => write!(f, "more than {PAIRS} parameters at once"),
            Self::Scene(Choice::Number(number)) => {
                write!(f, "no scene {number}; `scene` lists them")
            }
            Self::Scene(Choice::Name(name)) => write!(f, "no scene `{name}`; `scene` lists them"),
            Self::Bubble => f.write_str(
                "expected a radius of 0.15 to 150 mm, a pressure of 0 to 8 Pa, a rise factor of 0 to 20",
            ),
            Self::Slot(slot) => write!(f, "no slot {slot}; expected 1 to {SLOTS}"),
            Self::Empty(0) => f.write_str("no settings were stored yet"),
            Self::Empty(slot) => write!(f, "nothing is stored in slot {slot}"),
            Self::Name => write!(
                f,
                "expected a name of up to {NAME} letters, digits, blanks and -_."
            ),
            Self::Busy => f.write_str("busy; try again"),
            Self::Flash => f.write_str("the flash did not take it; what was there is still there"),
            Self::Full => f.write_str("the flash is full; erase a preset first"),
            Self::Unable => f.write_str("this device cannot do that"),
            Self::Frame => f.write_str("a damaged frame"),
            Self::Message => f.write_str("a frame of another version"),
            Self::Line => f.write_str("a line that is too long or is not text"),
        }
    }
}

fn refuse(id: u16, value: &dyn Display, f: &mut Formatter<'_>) -> fmt::Result {
    let Some(index) = param::index_of_id(id) else {
        return write!(f, "no parameter of id {id}");
    };
    let param = &TABLE[index];
    let row = Row::new(param, 0.0, None);
    write!(f, "{} cannot be {value}; expected ", param.path)?;
    if param.kind == Kind::Whole {
        f.write_str("a whole number from ")?;
    }
    range(&row, f)?;
    unit(param.unit, f)
}

/// The lines of `help`, one for each command; or of one command.
pub(super) fn help(number: usize, command: &str) -> Option<impl Display + use<>> {
    let mut commands =
        (COMMANDS.iter()).filter(|known| command.is_empty() || known.name == command);
    let Command { usage, about, .. } = commands.nth(number)?;
    Some(fmt::from_fn(move |f: &mut Formatter<'_>| {
        write!(f, "{usage}: {about}")
    }))
}
