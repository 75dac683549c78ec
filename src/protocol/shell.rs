//! Takes bytes, does what they ask for, and answers.

use core::fmt::Write;

use heapless::{Deque, String, Vec};

use super::frame::{self, FRAME_MAX, FrameError, PAYLOAD_MAX};
use super::message::{
    Boot, Choice, Hello, NAME, Name, PAIRS, Pair, Preset, Refusal, Reply, Request, Row, SLOTS,
    Slot, Status, Tag,
};
use super::outbox::Outbox;
use super::splitter::{Item, Splitter};
use super::text::{self, Line};
use crate::control::{Control, RAMP_MAX};
use crate::frame::TICK;
use crate::param::{self, TABLE};
use crate::scene::Scene;

/// Longest reply, as lines or as a frame, bytes.
const REPLY_MAX: usize = 1024;
/// A list goes on where there is room for any item of it.
const ITEM_MAX: usize = 512;
/// Room below which a reply is not even written.
const SHORTEST: usize = 16;
/// Lists that may be under way at once.
const LISTS: usize = 4;
/// Without a byte for so many ticks (107 ms at 48 kHz) a frame that was begun is given up.
const PATIENCE: u32 = 40;

/// What has to be done outside of the core; it takes its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Job<'a> {
    /// Keeps settings.
    Store(Slot, &'a Preset),
    /// Forgets them.
    Erase(Slot),
    /// Keeps what is played when the power comes on.
    Boot(&'a BootRecord),
    /// Starts again.
    Restart,
}

/// A [`Boot`] that owns its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum BootRecord {
    /// See [`Boot::Default`].
    #[default]
    Default,
    /// See [`Boot::Scene`].
    Scene(Name),
    /// See [`Boot::Preset`].
    Preset(Slot),
}

impl BootRecord {
    /// As it goes over the line and into the flash.
    pub fn boot(&self) -> Boot<'_> {
        match self {
            Self::Default => Boot::Default,
            Self::Scene(name) => Boot::Scene(name),
            Self::Preset(slot) => Boot::Preset(*slot),
        }
    }
}

impl From<Boot<'_>> for BootRecord {
    fn from(boot: Boot<'_>) -> Self {
        match boot {
            Boot::Default => Self::Default,
            Boot::Scene(name) => Name::try_from(name).map_or(Self::Default, Self::Scene),
            Boot::Preset(slot) => Self::Preset(slot),
        }
    }
}

/// What the shell runs on: a board, or its twin on a desk.
pub trait Device {
    /// The parameters.
    fn control(&self) -> &Control;
    /// The same, to turn them.
    fn control_mut(&mut self) -> &mut Control;
    /// The frame from which on what is set now is heard.
    fn date(&self) -> u64;
    /// Who this is; `scene` and `at` are filled in by the shell.
    fn hello(&self) -> Hello<'_>;
    /// How things stand; what the shell counts itself is added by it.
    fn status(&self) -> Status<'_>;
    /// Name and scene of number `number`, from 0 on without a gap.
    fn scene(&self, number: u16) -> Option<(&str, Scene)>;
    /// The number of the scene that plays.
    fn playing(&self) -> u16;
    /// Another scene plays from now on.
    fn set_playing(&mut self, number: u16);
    /// The settings stored last: what is in slot 0.
    fn stored(&self) -> Option<&Preset>;
    /// What is kept in a slot from 1 on.
    fn preset(&self, slot: Slot) -> Option<Preset>;
    /// What is played when the power comes on.
    fn boot(&self) -> BootRecord;
    /// Takes a job. Where it is not done at once, says how long the sound pauses, ms, and calls [`Shell::finished`] of
    /// this shell when it is.
    fn begin(&mut self, job: Job<'_>) -> Result<Option<u32>, Refusal<'static>>;

    /// The number of a scene that was asked for.
    fn number_of(&self, choice: Choice<'_>) -> Option<u16> {
        let mut scenes = (0..=u16::MAX).map_while(|number| Some((number, self.scene(number)?.0)));
        let found = scenes.find(|(number, name)| match choice {
            Choice::Number(wanted) => *number == wanted,
            Choice::Name(wanted) => alike(name, wanted),
        });
        found.map(|(number, _)| number)
    }

    /// What is kept in any slot.
    fn kept(&self, slot: Slot) -> Result<Preset, Refusal<'static>> {
        let preset = match slot {
            0 => self.stored().cloned(),
            1..=SLOTS => self.preset(slot),
            _ => return Err(Refusal::Slot(slot)),
        };
        preset.ok_or(Refusal::Empty(slot))
    }

    /// The scene that a preset means, and the number of the scene that it is over.
    fn recalled(&self, preset: &Preset) -> (Scene, u16) {
        let number = self.number_of(Choice::Name(&preset.scene)).unwrap_or(0);
        let base = self.scene(number).map(|(_, scene)| scene);
        (preset.over(base.unwrap_or_default()), number)
    }
}

/// `Light rain` is `light-rain`.
fn alike(name: &str, wanted: &str) -> bool {
    let plain = |c: char| match c {
        ' ' | '_' => '-',
        c => c.to_ascii_lowercase(),
    };
    name.chars().map(plain).eq(wanted.chars().map(plain))
}

/// How a request came, and so how its replies go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Door {
    Text,
    Frame(Tag),
}

/// Items that are told one by one, as there is room.
#[derive(Clone, Debug)]
enum List {
    Rows {
        prefix: Prefix,
        about: bool,
    },
    Values,
    /// Those of a preset that plays now, from when on, and whether it does from the start.
    Recalled(Slot, u64, bool),
    Scenes,
    Presets,
    Help(Prefix),
}

/// The begin of a path, or a command: longer ones are not known.
type Prefix = String<NAME>;

/// A list under way.
#[derive(Clone, Debug)]
struct Listing {
    door: Door,
    list: List,
    /// Which item comes next.
    next: usize,
}

/// A request whose end is awaited.
#[derive(Clone, Debug)]
enum Awaited {
    Store(Slot, Name),
    Erase(Slot),
    Boot(BootRecord),
    Restart,
}

impl Awaited {
    fn request(&self) -> Request<'_> {
        match self {
            Self::Store(slot, name) => Request::Store { slot: *slot, name },
            Self::Erase(slot) => Request::Erase(*slot),
            Self::Boot(boot) => Request::SetBoot(boot.boot()),
            Self::Restart => Request::Restart,
        }
    }
}

/// The protocol on one line. `OUT` bytes may wait to be sent; at least 1 024.
#[derive(Debug)]
pub struct Shell<const OUT: usize> {
    splitter: Splitter,
    out: Outbox<OUT>,
    lists: Deque<Listing, LISTS>,
    awaited: Option<(Door, Awaited)>,
    /// Ticks between two reports, and until the next one.
    every: u16,
    left: u16,
    tag: Tag,
    /// Ticks without a byte.
    quiet: u32,
    garbage: u32,
}

impl<const OUT: usize> Shell<OUT> {
    /// Nothing said yet.
    pub const fn new() -> Self {
        const { assert!(OUT >= REPLY_MAX) };
        Self {
            splitter: Splitter::new(),
            out: Outbox::new(),
            lists: Deque::new(),
            awaited: None,
            every: 0,
            left: 0,
            tag: 0,
            quiet: 0,
            garbage: 0,
        }
    }

    /// What waits to be sent.
    pub fn out(&mut self) -> &mut Outbox<OUT> {
        &mut self.out
    }

    /// Says who is there, unasked: what a person sees when the power comes on. Where that is a preset, it is told
    /// before.
    pub fn greet(&mut self, device: &impl Device) {
        match device.boot() {
            BootRecord::Preset(slot) if device.kept(slot).is_ok() => {
                let list = List::Recalled(slot, device.date(), true);
                self.begin_list(Door::Text, list, device);
            }
            _ => self.hello(Door::Text, device.playing(), device.date(), device),
        }
    }

    /// Takes bytes as they come.
    pub fn receive(&mut self, bytes: &[u8], device: &mut impl Device) {
        if !bytes.is_empty() {
            self.quiet = 0;
        }
        let mut splitter = core::mem::take(&mut self.splitter);
        for byte in bytes {
            match splitter.push(*byte) {
                None => {}
                Some(Item::Line(line)) => self.line(line, device),
                Some(Item::Frame(frame)) => self.frame(frame, device),
                Some(Item::Garbage) => self.refuse(Door::Text, Refusal::Line),
            }
        }
        self.splitter = splitter;
    }

    /// Once a tick: a list goes on by an item, and a report is sent where one is due.
    pub fn tick(&mut self, device: &impl Device) {
        self.quiet = self.quiet.saturating_add(1);
        if self.quiet == PATIENCE {
            self.splitter.pause();
        }
        self.go_on(device);
        if self.every > 0 {
            self.left = self.left.saturating_sub(1);
            if self.left == 0 {
                self.left = self.every;
                let status = self.status(device);
                self.reply(
                    Door::Frame(self.tag),
                    &Reply::Status(status),
                    &Request::Status,
                );
            }
        }
    }

    /// Whether there is a list that goes on.
    pub fn lists(&self) -> bool {
        !self.lists.is_empty()
    }

    /// The job that this shell began is over, and `device` sounds again.
    pub fn finished(&mut self, result: Result<(), Refusal<'static>>, device: &impl Device) {
        if let Some((door, awaited)) = self.awaited.take() {
            let at = Some(device.date());
            let reply = match result {
                Ok(()) => Reply::Done { at },
                Err(refusal) => Reply::Refused(refusal),
            };
            self.reply(door, &reply, &awaited.request());
        }
    }

    fn line(&mut self, line: &str, device: &mut impl Device) {
        let mut skipped = Vec::<_, PAIRS>::new();
        let request = text::parse(line, &mut |refusal| {
            // As many as there may be pairs, and the rest unsaid.
            let _ = skipped.push(refusal);
        });
        match request {
            Ok(request) => self.execute(Door::Text, request, &skipped, device),
            Err(refusal) => {
                for refusal in &skipped {
                    self.refuse(Door::Text, *refusal);
                }
                // Where each of several was refused, there is nothing to add.
                if skipped.is_empty() || !matches!(refusal, Refusal::Usage(_)) {
                    self.refuse(Door::Text, refusal);
                }
            }
        }
    }

    fn frame(&mut self, frame: &[u8], device: &mut impl Device) {
        let mut payload = [0; PAYLOAD_MAX];
        match frame::decode::<(Tag, Request<'_>)>(frame, &mut payload) {
            Ok((tag, request)) => self.execute(Door::Frame(tag), request, &[], device),
            Err(FrameError::Message) => {
                self.refuse(Door::Frame(payload[2]), Refusal::Message);
            }
            Err(FrameError::Frame | FrameError::Checksum) => {
                self.refuse(Door::Frame(0), Refusal::Frame);
            }
        }
    }

    /// Refuses what could not be read.
    fn refuse(&mut self, door: Door, refusal: Refusal<'_>) {
        if matches!(refusal, Refusal::Line | Refusal::Frame) {
            self.garbage = self.garbage.wrapping_add(1);
        }
        self.reply(door, &Reply::Refused(refusal), &Request::Hello);
    }

    fn execute(
        &mut self,
        door: Door,
        request: Request<'_>,
        skipped: &[Refusal<'_>],
        device: &mut impl Device,
    ) {
        let result = match &request {
            Request::Set { values, ramp } => {
                return self.set(door, values, *ramp, skipped, device);
            }
            Request::Get(ids) if !ids.is_empty() => return self.get(door, ids, skipped, device),
            Request::Get(_) => return self.begin_list(door, List::Values, device),
            Request::Help(command) => return self.begin_named(door, command, List::Help, device),
            Request::List(prefix) => {
                let rows = |prefix| List::Rows {
                    prefix,
                    about: false,
                };
                return self.begin_named(door, prefix, rows, device);
            }
            Request::Describe(prefix) => {
                let rows = |prefix| List::Rows {
                    prefix,
                    about: true,
                };
                return self.begin_named(door, prefix, rows, device);
            }
            Request::Scenes => return self.begin_list(door, List::Scenes, device),
            Request::Presets => return self.begin_list(door, List::Presets, device),
            Request::Recall(slot) => match self.recall(door, *slot, device) {
                Ok(()) => return,
                Err(refusal) => Err(refusal),
            },
            Request::Hello => {
                self.hello(door, device.playing(), device.date(), device);
                Ok(None)
            }
            Request::Status => {
                let status = self.status(device);
                self.reply(door, &Reply::Status(status), &request);
                Ok(None)
            }
            Request::Boot => {
                let boot = device.boot();
                self.reply(door, &Reply::Boot(boot.boot()), &request);
                Ok(None)
            }
            Request::Scene(choice) => scene(*choice, device).map(Some),
            Request::Trigger {
                radius,
                pressure,
                rise_factor,
            } => match trigger([*radius, *pressure, *rise_factor], device) {
                Ok((request, at)) => {
                    return self.reply(door, &Reply::Done { at: Some(at) }, &request);
                }
                Err(refusal) => Err(refusal),
            },
            Request::Mute(on) => {
                device.control_mut().mute(*on);
                Ok(Some(device.date()))
            }
            Request::Subscribe(every) => {
                if let Door::Frame(tag) = door {
                    (self.every, self.left, self.tag) = (*every, *every, tag);
                }
                Ok(None)
            }
            Request::Store { .. } | Request::Erase(_) | Request::SetBoot(_) | Request::Restart => {
                match self.job(door, &request, device) {
                    Ok(true) => Ok(Some(device.date())),
                    Ok(false) => return,
                    Err(refusal) => Err(refusal),
                }
            }
        };
        let reply = match result {
            Ok(at) => Reply::Done { at },
            Err(refusal) => Reply::Refused(refusal),
        };
        self.reply(door, &reply, &request);
    }

    fn hello(&mut self, door: Door, playing: u16, at: u64, device: &impl Device) {
        let scene = device.scene(playing);
        let hello = Hello {
            scene: scene.as_ref().map_or("", |(name, _)| name),
            at,
            ..device.hello()
        };
        self.reply(door, &Reply::Hello(hello), &Request::Hello);
    }

    fn status<'a>(&self, device: &'a impl Device) -> Status<'a> {
        Status {
            garbage: self.garbage,
            dropped: self.out.dropped(),
            ..device.status()
        }
    }

    fn set(
        &mut self,
        door: Door,
        values: &[Pair],
        ramp: Option<f32>,
        skipped: &[Refusal<'_>],
        device: &mut impl Device,
    ) {
        let request = |values| Request::Set { values, ramp };
        // A Vec of as many pairs always holds them.
        let asked = || request(values.iter().copied().collect());
        if let Some(seconds) = ramp.filter(|seconds| !(0.0..=RAMP_MAX).contains(seconds)) {
            let reply = Reply::Refused(Refusal::Ramp(seconds));
            return self.reply(door, &reply, &asked());
        }
        let mut done = Vec::<Pair, PAIRS>::new();
        let mut last = None;
        let refusals = skipped.iter().copied().map(Err);
        let results = values.iter().map(|&(id, value)| {
            let index = param::index_of_id(id).ok_or(Refusal::Id(id))?;
            (device.control_mut().set(index, value, ramp))
                .map_err(|_| Refusal::Value(id, value))?;
            Ok((id, value))
        });
        for result in refusals.chain(results) {
            match result {
                Ok(pair) => {
                    let _ = done.push(pair);
                }
                Err(refusal) => {
                    if let Some(before) = last.replace(refusal) {
                        self.reply(door, &Reply::Skipped(before), &Request::Hello);
                    }
                }
            }
        }
        let at = device.date();
        match last {
            Some(refusal) if done.is_empty() => {
                self.reply(door, &Reply::Refused(refusal), &request(done));
            }
            last => {
                if let Some(refusal) = last {
                    self.reply(door, &Reply::Skipped(refusal), &Request::Hello);
                }
                self.reply(door, &Reply::Done { at: Some(at) }, &request(done));
            }
        }
    }

    fn get(
        &mut self,
        door: Door,
        ids: &Vec<u16, PAIRS>,
        skipped: &[Refusal<'_>],
        device: &mut impl Device,
    ) {
        let request = Request::Get(ids.clone());
        for refusal in skipped {
            self.reply(door, &Reply::Skipped(*refusal), &request);
        }
        for &id in ids {
            let reply = match param::index_of_id(id) {
                Some(index) => Reply::Value((id, device.control().get(index))),
                None => Reply::Skipped(Refusal::Id(id)),
            };
            self.reply(door, &reply, &request);
        }
        self.reply(door, &Reply::Done { at: None }, &request);
    }

    fn recall(
        &mut self,
        door: Door,
        slot: Slot,
        device: &mut impl Device,
    ) -> Result<(), Refusal<'static>> {
        let preset = device.kept(slot)?;
        // It must not change while it is told. The first line has to be said now: what is said before it was done before.
        let changes = self.awaited.as_ref().is_some_and(|(_, job)| match job {
            Awaited::Store(kept, _) | Awaited::Erase(kept) => *kept == slot,
            Awaited::Boot(_) | Awaited::Restart => false,
        });
        if changes || self.recalling() || self.lists.is_full() || self.out.room() < ITEM_MAX {
            return Err(Refusal::Busy);
        }
        let (scene, number) = device.recalled(&preset);
        device.control_mut().load(&scene);
        device.set_playing(number);
        let listing = Listing {
            door,
            list: List::Recalled(slot, device.date(), false),
            next: 0,
        };
        // There is room.
        let _ = self.lists.push_front(listing);
        self.go_on(device);
        Ok(())
    }

    /// Whether a preset is being told.
    fn recalling(&self) -> bool {
        let first = self.lists.front();
        first.is_some_and(|listing| matches!(listing.list, List::Recalled(..)))
    }

    /// Begins a job; true where it is done already, false where the reply comes later.
    fn job<'r>(
        &mut self,
        door: Door,
        request: &Request<'r>,
        device: &mut impl Device,
    ) -> Result<bool, Refusal<'r>> {
        if self.awaited.is_some() || self.recalling() {
            return Err(Refusal::Busy);
        }
        let (preset, boot);
        let (job, awaited) = match request {
            Request::Store { slot, name } => {
                if !text::is_name(name) {
                    return Err(Refusal::Name);
                }
                preset = preset_of(*slot, name, device)?;
                let awaited = Awaited::Store(*slot, preset.name.clone());
                (Job::Store(*slot, &preset), awaited)
            }
            Request::Erase(slot) => {
                device.kept(*slot)?;
                (Job::Erase(*slot), Awaited::Erase(*slot))
            }
            Request::SetBoot(wanted) => {
                boot = boot_record(*wanted, device)?;
                (Job::Boot(&boot), Awaited::Boot(boot.clone()))
            }
            _ => (Job::Restart, Awaited::Restart),
        };
        match device.begin(job)? {
            None => Ok(true),
            Some(ms) => {
                self.awaited = Some((door, awaited));
                let at = device.date();
                self.reply(door, &Reply::Pause { ms, at }, request);
                Ok(false)
            }
        }
    }

    fn begin_named(
        &mut self,
        door: Door,
        name: &str,
        list: impl FnOnce(Prefix) -> List,
        device: &impl Device,
    ) {
        match Prefix::try_from(name) {
            Ok(name) => self.begin_list(door, list(name), device),
            Err(_) => self.reply(door, &Reply::Refused(Refusal::Name), &Request::Hello),
        }
    }

    fn begin_list(&mut self, door: Door, list: List, device: &impl Device) {
        let listing = Listing {
            door,
            list,
            next: 0,
        };
        match self.lists.push_back(listing) {
            Ok(()) => self.go_on(device),
            Err(_) => self.reply(door, &Reply::Refused(Refusal::Busy), &Request::Hello),
        }
    }

    /// The next item of the list under way, if there is room for it.
    fn go_on(&mut self, device: &impl Device) {
        if self.out.room() < ITEM_MAX {
            return;
        }
        let Some(mut listing) = self.lists.pop_front() else {
            return;
        };
        if self.item(&mut listing, device) {
            // Its place has just become free.
            let _ = self.lists.push_front(listing);
        }
    }

    /// Tells the next item; false where that was the end.
    fn item(&mut self, listing: &mut Listing, device: &impl Device) -> bool {
        let Listing { door, list, next } = listing;
        let door = *door;
        let at = *next;
        *next += 1;
        let request = match &*list {
            List::Rows { prefix, about } => {
                let request = if *about {
                    Request::Describe(prefix)
                } else {
                    Request::List(prefix)
                };
                let mut rows = TABLE.iter().enumerate();
                let row = rows.find(|(i, param)| *i >= at && param.path.starts_with(&**prefix));
                if let Some((index, param)) = row {
                    *next = index + 1;
                    let value = device.control().get(index);
                    let stored = device.stored().map(|preset| preset.value(index));
                    self.reply(door, &Reply::Row(Row::new(param, value, stored)), &request);
                    return true;
                }
                request
            }
            List::Values => {
                let request = Request::Get(Vec::new());
                if let Some(param) = TABLE.get(at) {
                    let value = Reply::Value((param.id, device.control().get(at)));
                    self.reply(door, &value, &request);
                    return true;
                }
                request
            }
            List::Recalled(slot, date, starts) => {
                let request = Request::Recall(*slot);
                let number = device.playing();
                match device.scene(number) {
                    _ if at > 0 => {}
                    _ if *starts => {
                        let boot = Reply::Boot(Boot::Preset(*slot));
                        self.reply(door, &boot, &request);
                        return true;
                    }
                    Some((name, _)) => {
                        let plays = true;
                        let scene = Reply::Scene {
                            number,
                            name,
                            plays,
                        };
                        self.reply(door, &scene, &request);
                        return true;
                    }
                    None => {}
                }
                // The first place was that of the scene.
                let place = at.saturating_sub(1);
                let preset = device.kept(*slot).unwrap_or_default();
                if let Some(pair) = preset.values.get(place) {
                    *next = place + 2;
                    self.reply(door, &Reply::Value(*pair), &request);
                    return true;
                }
                if *starts {
                    // Another one may play by now.
                    let (_, number) = device.recalled(&preset);
                    self.hello(door, number, *date, device);
                } else {
                    self.reply(door, &Reply::Done { at: Some(*date) }, &request);
                }
                return false;
            }
            List::Scenes => {
                if let Some((name, _)) = u16::try_from(at).ok().and_then(|at| device.scene(at)) {
                    let number = at as u16;
                    let plays = number == device.playing();
                    let scene = Reply::Scene {
                        number,
                        name,
                        plays,
                    };
                    self.reply(door, &scene, &Request::Scenes);
                    return true;
                }
                Request::Scenes
            }
            List::Presets => {
                let slot = (at..=usize::from(SLOTS))
                    .find_map(|slot| Some((slot, device.preset(slot as Slot)?)));
                if let Some((slot, preset)) = slot {
                    *next = slot + 1;
                    let preset = Reply::Preset {
                        slot: slot as Slot,
                        name: &preset.name,
                        scene: &preset.scene,
                    };
                    self.reply(door, &preset, &Request::Presets);
                    return true;
                }
                Request::Presets
            }
            List::Help(command) => {
                let mut line = String::<256>::new();
                let help = text::help(at, command);
                if help.is_some_and(|help| write!(line, "{help}").is_ok()) {
                    self.reply(door, &Reply::Text(&line), &Request::Help(command));
                    return true;
                }
                if at == 0 {
                    let unknown = Reply::Refused(Refusal::Command(command));
                    self.reply(door, &unknown, &Request::Help(command));
                    return false;
                }
                Request::Help(command)
            }
        };
        self.reply(door, &Reply::Done { at: None }, &request);
        false
    }

    fn reply(&mut self, door: Door, reply: &Reply<'_>, request: &Request<'_>) {
        if self.out.room() < SHORTEST {
            self.out.drop_one();
            return;
        }
        match door {
            Door::Text => {
                let mut line = String::<REPLY_MAX>::new();
                if write!(line, "{}", Line(reply, request)).is_ok() {
                    return self.out.put(line.as_bytes());
                }
            }
            Door::Frame(tag) => {
                let mut bytes = [0; FRAME_MAX + 3];
                if let Ok(length) = frame::encode(&(tag, reply), &mut bytes) {
                    return self.out.put(&bytes[..length]);
                }
            }
        }
        self.out.drop_one();
    }
}

impl<const OUT: usize> Default for Shell<OUT> {
    fn default() -> Self {
        Self::new()
    }
}

fn scene<'a>(choice: Choice<'a>, device: &mut impl Device) -> Result<u64, Refusal<'a>> {
    let number = device.number_of(choice).ok_or(Refusal::Scene(choice))?;
    let (_, scene) = device.scene(number).ok_or(Refusal::Scene(choice))?;
    device.control_mut().load(&scene);
    device.set_playing(number);
    Ok(device.date())
}

/// Sounds a bubble of so many mm, Pa, and ξ; says of which, and when.
fn trigger(
    wanted: [Option<f32>; 3],
    device: &mut impl Device,
) -> Result<(Request<'static>, u64), Refusal<'static>> {
    let usual = [
        param::DROPS_RADIUS,
        param::DROPS_PRESSURE,
        param::DROPS_RISE,
    ];
    let date = device.date();
    let control = device.control_mut();
    let mut bubble = [0.0; 3];
    for ((value, wanted), index) in bubble.iter_mut().zip(wanted).zip(usual) {
        *value = wanted.unwrap_or_else(|| control.get(index));
    }
    let [radius, pressure, rise_factor] = bubble;
    let possible = (0.15..=150.0).contains(&radius)
        && (0.0..=8.0).contains(&pressure)
        && (0.0..=20.0).contains(&rise_factor);
    if !possible {
        return Err(Refusal::Bubble);
    }
    let ticks = control
        .trigger(radius * 1e-3, pressure, rise_factor)
        .ok_or(Refusal::Busy)?;
    let request = Request::Trigger {
        radius: Some(radius),
        pressure: Some(pressure),
        rise_factor: Some(rise_factor),
    };
    Ok((request, date + u64::from(ticks) * TICK as u64))
}

/// The settings as they are now, as `name`; without one as what is in the slot is called.
fn preset_of(slot: Slot, name: &str, device: &impl Device) -> Result<Preset, Refusal<'static>> {
    let name = match (name, device.kept(slot)) {
        (_, Err(refusal @ Refusal::Slot(_))) => return Err(refusal),
        ("", old) => old.map(|old| old.name).unwrap_or_default(),
        (name, _) => Name::try_from(name).map_err(|_| Refusal::Name)?,
    };
    let playing = device.scene(device.playing());
    let scene = playing.and_then(|(scene, _)| Name::try_from(scene).ok());
    Ok(Preset::new(
        name,
        scene.unwrap_or_default(),
        device.control(),
    ))
}

/// A choice that can be kept, for there is what it names.
fn boot_record<'a>(boot: Boot<'a>, device: &impl Device) -> Result<BootRecord, Refusal<'a>> {
    match boot {
        Boot::Default => Ok(BootRecord::Default),
        Boot::Scene(name) => {
            let unknown = Refusal::Scene(Choice::Name(name));
            let number = device.number_of(Choice::Name(name)).ok_or(unknown)?;
            let (name, _) = device.scene(number).ok_or(unknown)?;
            Ok(BootRecord::from(Boot::Scene(name)))
        }
        Boot::Preset(slot) => {
            device.kept(slot)?;
            Ok(BootRecord::Preset(slot))
        }
    }
}
