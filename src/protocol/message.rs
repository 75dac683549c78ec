//! What is asked and what is answered, the same through both doors.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::control::Control;
use crate::param::{self, COUNT, Curve, Kind, Param, TABLE};
use crate::scene::Scene;

/// Ties the replies in frames to the request in a frame.
pub type Tag = u8;
/// Longest name of a scene or preset, bytes.
pub const NAME: usize = 32;
/// A name.
pub type Name = String<NAME>;
/// Most parameters in one request.
pub const PAIRS: usize = 24;
/// A parameter's stable id and a value.
pub type Pair = (u16, f32);
/// Presets a person can keep, in slots 1 to this.
pub const SLOTS: Slot = 16;
/// Where settings are kept: 0 for the current ones, 1 to [`SLOTS`] for presets.
pub type Slot = u8;

/// A scene by its place or its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Choice<'a> {
    /// From 0.
    Number(u16),
    /// As it is called in the bank.
    #[serde(borrow)]
    Name(&'a str),
}

/// What is played when the power comes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Boot<'a> {
    /// The bank's own choice.
    #[default]
    Default,
    /// A scene of the bank.
    #[serde(borrow)]
    Scene(&'a str),
    /// A preset, or in slot 0 the settings stored last.
    Preset(Slot),
}

/// Settings that are kept: a scene and what is turned otherwise than it says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Preset {
    /// What the person calls it; may be empty.
    pub name: Name,
    /// The scene whose intensity it has.
    pub scene: Name,
    /// `(id, value)` of all parameters that are not at their default, or that the intensity moves.
    pub values: Vec<Pair, COUNT>,
}

impl Preset {
    /// What `control` is heading for.
    pub fn new(name: Name, scene: Name, control: &Control) -> Self {
        let values = TABLE.iter().enumerate().filter_map(|(i, param)| {
            let value = control.target(i);
            let told = value != param.default || control.follows_intensity(i);
            told.then_some((param.id, value))
        });
        Self {
            name,
            scene,
            values: values.collect(),
        }
    }

    /// Where it has the parameter at `index` of the table.
    pub fn value(&self, index: usize) -> f32 {
        let param = &TABLE[index];
        let own = self.values.iter().find(|(id, _)| *id == param.id);
        own.map_or(param.default, |(_, value)| *value)
    }

    /// As a scene with the curves of `base`. What this version does not know is left out.
    pub fn over(&self, base: Scene) -> Scene {
        let mut scene = Scene {
            curves: base.curves,
            ..Scene::default()
        };
        for &(id, value) in &self.values {
            let known = param::index_of_id(id).filter(|i| TABLE[*i].accepts(value));
            if let Some(index) = known {
                // There is a place for each parameter, and a file that names one twice only loses the last.
                let _ = scene.values.push((index, value));
            }
        }
        scene
    }
}

/// What may be asked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Who is there.
    Hello,
    /// What can be asked, or all about one command.
    Help(&'a str),
    /// Every parameter whose path begins so: one [`Reply::Row`] each.
    List(&'a str),
    /// The same, told at length.
    Describe(&'a str),
    /// Some parameters' values: one [`Reply::Value`] each; none named: all of them.
    Get(Vec<u16, PAIRS>),
    /// Moves parameters, in the time each has in the table or in `ramp` seconds.
    Set {
        /// What to move where to.
        values: Vec<Pair, PAIRS>,
        /// s, see [`RAMP_MAX`](crate::control::RAMP_MAX).
        ramp: Option<f32>,
    },
    /// The scenes there are.
    Scenes,
    /// Plays a scene.
    Scene(#[serde(borrow)] Choice<'a>),
    /// Sounds one bubble; what is not given is as the drops' parameters say.
    Trigger {
        /// mm.
        radius: Option<f32>,
        /// At 1 m, Pa.
        pressure: Option<f32>,
        /// ξ.
        rise_factor: Option<f32>,
    },
    /// Silence, and back.
    Mute(bool),
    /// The presets there are.
    Presets,
    /// Keeps the settings as they are now.
    Store {
        /// Where.
        slot: Slot,
        /// What to call it; empty: as it was called before.
        name: &'a str,
    },
    /// Goes back to settings that were kept.
    Recall(Slot),
    /// Forgets a preset.
    Erase(Slot),
    /// What is played when the power comes on.
    Boot,
    /// Changes that.
    SetBoot(Boot<'a>),
    /// How things stand.
    Status,
    /// Sends [`Reply::Status`] every so many ticks from now on; 0: no more. In frames only.
    Subscribe(u16),
    /// Starts the board again.
    Restart,
}

/// Who is there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello<'a> {
    /// Version of freshet.
    pub version: &'a str,
    /// The board, as `render --board` calls it.
    pub board: &'a str,
    /// True sample rate, Hz.
    pub rate: f32,
    /// Seed of the sound.
    pub seed: u64,
    /// Changes with the parameter table, see [`param::SCHEMA`].
    pub schema: u32,
    /// The scene that plays.
    pub scene: &'a str,
    /// The frame from which on what is set now is heard.
    pub at: u64,
}

/// A parameter, and where it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row<'a> {
    /// See [`Param::id`].
    pub id: u16,
    /// See [`Param::path`].
    pub path: &'a str,
    /// See [`Param::unit`].
    pub unit: &'a str,
    /// Lowest and highest value.
    pub range: (f32, f32),
    /// See [`Param::default`].
    pub default: f32,
    /// The lowest value above 0 of a logarithmic curve; none: linear.
    pub log: Option<f32>,
    /// Time a change takes, s.
    pub ramp: f32,
    /// Whether it takes whole numbers only.
    pub whole: bool,
    /// The names of its values, where they have names.
    pub choices: Vec<&'a str, 8>,
    /// What it does.
    pub about: &'a str,
    /// Where it is now.
    pub value: f32,
    /// Where it is in the settings stored last.
    pub stored: Option<f32>,
}

impl Row<'static> {
    /// The row of a parameter that is at `value`.
    pub fn new(param: &'static Param, value: f32, stored: Option<f32>) -> Self {
        Self {
            id: param.id,
            path: param.path,
            unit: param.unit,
            range: (param.min, param.max),
            default: param.default,
            log: match param.curve {
                Curve::Linear => None,
                Curve::Log(least) => Some(least),
            },
            ramp: param.ramp,
            whole: param.kind != Kind::Real,
            choices: match param.kind {
                Kind::Choice(names) => names.iter().copied().collect(),
                Kind::Real | Kind::Whole => Vec::new(),
            },
            about: param.about,
            value,
            stored,
        }
    }
}

/// How things stand. Counters are since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status<'a> {
    /// Frames played.
    pub frame: u64,
    /// Time since the start, s.
    pub uptime: u32,
    /// Part of a block's time that the last one took.
    pub load: f32,
    /// The most that any block took.
    pub peak: f32,
    /// Bubbles born.
    pub births: u64,
    /// Voices sounding now.
    pub voices: u16,
    /// Voices that faded early for louder ones.
    pub stolen: u32,
    /// Rising bubbles that found no voice, and single ones.
    pub unvoiced: u32,
    /// Frames that the limiter held down.
    pub limited: u32,
    /// Frames that were clipped.
    pub clipped: u32,
    /// Blocks that came too late.
    pub underruns: u32,
    /// Times that the converter's line was built anew.
    pub restarts: u32,
    /// Ticks for which no settings were ready.
    pub missed: u32,
    /// Of the chip, °C.
    pub temperature: Option<f32>,
    /// Something is not as it should be.
    pub trouble: bool,
    /// Why the board started.
    pub cause: &'a str,
    /// What was said in the crash before the start; empty: there was none.
    pub panic: &'a str,
    /// Bytes of input lost, and bytes damaged on the line.
    pub overruns: u32,
    /// See `overruns`.
    pub framing: u32,
    /// Lines and frames that could not be read.
    pub garbage: u32,
    /// Replies that found no room.
    pub dropped: u32,
}

/// What is answered: any number of others, then a [`Reply::Done`] or a [`Reply::Refused`] for the whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply<'a> {
    /// Who is there.
    Hello(#[serde(borrow)] Hello<'a>),
    /// A line for people.
    Text(&'a str),
    /// A parameter.
    Row(Row<'a>),
    /// A parameter's value.
    Value(Pair),
    /// A scene.
    Scene {
        /// From 0.
        number: u16,
        /// Its name.
        name: &'a str,
        /// Whether it plays.
        plays: bool,
    },
    /// A preset.
    Preset {
        /// Where it is kept.
        slot: Slot,
        /// Its name.
        name: &'a str,
        /// Its scene.
        scene: &'a str,
    },
    /// What is played when the power comes on.
    Boot(Boot<'a>),
    /// How things stand.
    Status(Status<'a>),
    /// The sound fades out; it comes back when it is done.
    Pause {
        /// In about so many milliseconds.
        ms: u32,
        /// The frame from which on it fades.
        at: u64,
    },
    /// A parameter of a request was refused; the others are not touched by that.
    Skipped(Refusal<'a>),
    /// It is done.
    Done {
        /// The frame from which on it is heard, where it can be heard.
        at: Option<u64>,
    },
    /// It is not done.
    Refused(Refusal<'a>),
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal<'a> {
    /// There is no such command.
    Command(&'a str),
    /// The command wants something else; how it is used.
    Usage(&'a str),
    /// There is no parameter of that path, but perhaps one like this.
    Path(&'a str, Option<&'a str>),
    /// There is no parameter of that id.
    Id(u16),
    /// That is no value for the parameter: it takes others, see its row.
    Value(u16, f32),
    /// That text is no value for the parameter.
    Text(u16, &'a str),
    /// That is no time for a ramp, s.
    Ramp(f32),
    /// More than [`PAIRS`] parameters at once.
    TooMany,
    /// There is no such scene.
    Scene(#[serde(borrow)] Choice<'a>),
    /// No bubble can be like that.
    Bubble,
    /// There is no such slot.
    Slot(Slot),
    /// Nothing is kept in that slot.
    Empty(Slot),
    /// A name that is too long, or has other characters than letters, digits, blanks and `-_.`.
    Name,
    /// Something else is being kept, or too many bubbles wait.
    Busy,
    /// The flash did not take it; what was there before is still there.
    Flash,
    /// The flash is full.
    Full,
    /// This device cannot do that.
    Unable,
    /// Not a frame, or one damaged on the way.
    Frame,
    /// A frame whose message this version does not know.
    Message,
    /// A line that is too long or has something else in it than text.
    Line,
}
