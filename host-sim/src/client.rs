//! A client of the serial protocol: what a program needs to play a board, or its twin.
//!
//! Requests go in frames (see [`freshet::protocol`]) and each call waits for its answer; what the board says unasked is
//! kept for [`Client::poll`]. No call waits for ever, and none panics, whatever comes in.
//!
//! ```
//! # use freshet_host::client::{Client, Error};
//! # use freshet_host::twin::Twin;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // With a board: Client::open("/dev/ttyACM0", BAUD)?
//! let mut board = Client::over(Twin::example()?)?;
//! println!("{} plays {}", board.hello()?.board, board.hello()?.scene);
//!
//! board.scene("surf")?;
//! // Two parameters at once, in half a second; heard from frame `at` on.
//! let at = board.set(&[("water.rate", 2000.0), ("mix.level", -6.0)], Some(0.5))?;
//! assert!(at > 0);
//!
//! match board.set(&[("mix.level", 99.0)], None) {
//!     Err(Error::Refused(why)) => assert_eq!(why, "mix.level cannot be 99; expected -80 to 24 dB"),
//!     other => panic!("{other:?}"),
//! }
//! # Ok(())
//! # }
//! ```

mod error;
mod lines;
mod link;
mod reply;

pub use error::Error;
pub use lines::Lines;
pub use link::{Link, Serial};
pub use reply::{Event, Hello, PresetInfo, Report, Row, SceneInfo};

use std::collections::VecDeque;
use std::io;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use freshet::param;
use freshet::protocol::{
    BootRecord, Choice, FRAME_MAX, FrameError, Item, PAIRS, PAYLOAD_MAX, Pair, Refusal, Reply,
    Request, Slot, Splitter, Tag, decode, encode, parse,
};

/// Bits a second where nothing else is said.
pub const BAUD: u32 = 115_200;

/// Time an answer may take.
const TIMEOUT: Duration = Duration::from_secs(1);
/// The same, when a request was damaged on its way to the board.
const RETRY: Duration = Duration::from_millis(200);
/// How often a request is sent where that is harmless.
const TRIES: u32 = 3;
/// Time a board may take to start.
const START: Duration = Duration::from_secs(5);
/// Events that wait for [`Client::poll`]; older ones are let go.
const EVENTS: usize = 256;

/// A client on a link to a board. Dropped, it ends its subscription.
pub struct Client {
    link: Box<dyn Link>,
    /// Bytes that were read and not yet looked at.
    inbox: VecDeque<u8>,
    splitter: Splitter,
    events: VecDeque<Event>,
    tag: Tag,
    /// The tag of the reports that were asked for.
    subscription: Option<Tag>,
    timeout: Duration,
    /// Bytes that came since the last request, and were no answer to it.
    heard: usize,
}

/// What came.
enum Incoming {
    Frame(Vec<u8>),
    Line(String),
    Damaged,
}

/// What became of a request that was sent once.
enum Outcome {
    Done(Option<u64>),
    /// Not done, and not begun either: it never got there.
    Lost,
    /// Something of the answer is missing.
    Torn,
    Failed(Error),
}

impl Client {
    /// Opens a serial port (a path, on Windows a name such as `COM3`) for this program alone, and says hello.
    ///
    /// # Errors
    /// [`Error::Open`], [`Error::Timeout`] where nobody answers, [`Error::Version`] where somebody else does.
    pub fn open(port: &str, baud: u32) -> Result<Self, Error> {
        Self::over(Serial::open(port, baud)?)
    }

    /// Talks over any link, and says hello.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn over(link: impl Link + 'static) -> Result<Self, Error> {
        // Answers to another program that went away may still be on their way: any first tag but always the same.
        let clock = SystemTime::now().duration_since(UNIX_EPOCH);
        let mut client = Self {
            link: Box::new(link),
            inbox: VecDeque::new(),
            splitter: Splitter::new(),
            events: VecDeque::new(),
            tag: clock.map_or(0, |time| (time.as_micros() >> 4) as Tag),
            subscription: None,
            timeout: TIMEOUT,
            heard: 0,
        };
        client.greet()?;
        // What was said before is not news.
        client.events.clear();
        Ok(client)
    }

    /// Changes how long an answer may take, at first 1 s. What takes its time on a board (`store`) may still take it.
    pub fn set_timeout(&mut self, timeout: Duration) {
        self.timeout = timeout;
    }

    /// What the port is called.
    pub fn port(&self) -> &str {
        self.link.name()
    }

    /// Who is there, and which scene plays.
    pub fn hello(&mut self) -> Result<Hello, Error> {
        let (hello, _) = self.ask(&Request::Hello, |hello: &mut Option<Hello>, reply| {
            if let Reply::Hello(told) = reply {
                *hello = Some(told.into());
            }
        })?;
        hello.ok_or_else(|| self.damaged())
    }

    /// All parameters whose path begins with `prefix`, in the table's order; `""`: all there are. At 115 200 bits a
    /// second the whole table takes 1.2 s.
    pub fn table(&mut self, prefix: &str) -> Result<Vec<Row>, Error> {
        let (rows, _) = self.ask(&Request::List(prefix), |rows: &mut Vec<Row>, reply| {
            if let Reply::Row(row) = reply {
                rows.push(row.into());
            }
        })?;
        Ok(rows)
    }

    /// All parameters' values, by their ids: quicker than [`table`](Self::table).
    pub fn values(&mut self) -> Result<Vec<Pair>, Error> {
        self.pairs(&[])
    }

    /// The values of parameters, in the order asked for.
    pub fn get(&mut self, paths: &[&str]) -> Result<Vec<f32>, Error> {
        let ids = paths.iter().map(|path| id(path));
        let ids = ids.collect::<Result<Vec<u16>, _>>()?;
        self.get_ids(&ids)
    }

    /// The same, by their ids.
    pub fn get_ids(&mut self, ids: &[u16]) -> Result<Vec<f32>, Error> {
        let mut values = Vec::new();
        for ids in ids.chunks(PAIRS) {
            let pairs = self.pairs(ids)?;
            if pairs.len() != ids.len() {
                return Err(self.damaged());
            }
            values.extend(pairs.iter().map(|(_, value)| *value));
        }
        Ok(values)
    }

    fn pairs(&mut self, ids: &[u16]) -> Result<Vec<Pair>, Error> {
        let request = Request::Get(ids.iter().copied().collect());
        let (pairs, _) = self.ask(&request, |pairs: &mut Vec<Pair>, reply| {
            if let Reply::Value(pair) = reply {
                pairs.push(*pair);
            }
        })?;
        Ok(pairs)
    }

    /// Moves up to [`PAIRS`] parameters, in `ramp` seconds or in the time each has in the table. Returns the frame from
    /// which on it is heard.
    ///
    /// # Errors
    /// [`Error::Refused`] where none was set, [`Error::Partly`] where some were.
    pub fn set(&mut self, values: &[(&str, f32)], ramp: Option<f32>) -> Result<u64, Error> {
        let pairs = values.iter().map(|(path, value)| Ok((id(path)?, *value)));
        let pairs = pairs.collect::<Result<Vec<Pair>, Error>>()?;
        self.set_ids(&pairs, ramp)
    }

    /// The same, by their ids.
    pub fn set_ids(&mut self, values: &[Pair], ramp: Option<f32>) -> Result<u64, Error> {
        if values.len() > PAIRS {
            return Err(Error::Refused(Refusal::TooMany.to_string()));
        }
        let values = values.iter().copied().collect();
        self.dated(&Request::Set { values, ramp })
    }

    /// The scenes there are.
    pub fn scenes(&mut self) -> Result<Vec<SceneInfo>, Error> {
        let (scenes, _) = self.ask(&Request::Scenes, |scenes: &mut Vec<SceneInfo>, reply| {
            scenes.extend(SceneInfo::new(reply));
        })?;
        Ok(scenes)
    }

    /// Plays a scene by its name. Returns the frame from which on it is heard.
    pub fn scene(&mut self, name: &str) -> Result<u64, Error> {
        self.dated(&Request::Scene(Choice::Name(name)))
    }

    /// The same by its number, from 0.
    pub fn scene_number(&mut self, number: u16) -> Result<u64, Error> {
        self.dated(&Request::Scene(Choice::Number(number)))
    }

    /// Sounds one bubble of a radius in mm, a pressure at 1 m in Pa and a rise factor ξ; what is not given is as the
    /// parameters `drops.…` say. Returns the frame at which it is heard.
    pub fn trigger(
        &mut self,
        radius: Option<f32>,
        pressure: Option<f32>,
        rise_factor: Option<f32>,
    ) -> Result<u64, Error> {
        self.dated(&Request::Trigger {
            radius,
            pressure,
            rise_factor,
        })
    }

    /// Fades everything out, or in again. Returns the frame from which on it is heard.
    pub fn mute(&mut self, on: bool) -> Result<u64, Error> {
        self.dated(&Request::Mute(on))
    }

    /// The presets there are.
    pub fn presets(&mut self) -> Result<Vec<PresetInfo>, Error> {
        let (presets, _) =
            self.ask(&Request::Presets, |presets: &mut Vec<PresetInfo>, reply| {
                presets.extend(PresetInfo::new(reply));
            })?;
        Ok(presets)
    }

    /// Keeps the settings as they are now, in slot 0 or as a preset from 1 on; with an empty name it is called as before.
    /// The sound pauses meanwhile, and the call takes as long.
    pub fn store(&mut self, slot: Slot, name: &str) -> Result<(), Error> {
        self.act(&Request::Store { slot, name }).map(|_| ())
    }

    /// Goes back to settings that were kept. Returns the frame from which on it is heard.
    pub fn recall(&mut self, slot: Slot) -> Result<u64, Error> {
        self.dated(&Request::Recall(slot))
    }

    /// Forgets a preset, or in slot 0 the settings stored last.
    pub fn erase(&mut self, slot: Slot) -> Result<(), Error> {
        self.act(&Request::Erase(slot)).map(|_| ())
    }

    /// What is played when the power comes on.
    pub fn boot(&mut self) -> Result<BootRecord, Error> {
        let (boot, _) = self.ask(&Request::Boot, |boot: &mut Option<BootRecord>, reply| {
            if let Reply::Boot(told) = reply {
                *boot = Some((*told).into());
            }
        })?;
        boot.ok_or_else(|| self.damaged())
    }

    /// Changes that.
    pub fn set_boot(&mut self, boot: &BootRecord) -> Result<(), Error> {
        self.act(&Request::SetBoot(boot.boot())).map(|_| ())
    }

    /// How things stand.
    pub fn status(&mut self) -> Result<Report, Error> {
        let (report, _) = self.ask(&Request::Status, |report: &mut Option<Report>, reply| {
            if let Reply::Status(status) = reply {
                *report = Some(status.into());
            }
        })?;
        report.ok_or_else(|| self.damaged())
    }

    /// From now on a report comes every so many ticks (of 128 frames: 2.7 ms at 48 kHz) as an [`Event::Status`];
    /// 0: no more.
    pub fn subscribe(&mut self, ticks: u16) -> Result<(), Error> {
        self.act(&Request::Subscribe(ticks))?;
        self.subscription = (ticks > 0).then_some(self.tag);
        Ok(())
    }

    /// Starts the board again, waits until it is there, and returns its greeting. The subscription is over.
    pub fn restart(&mut self) -> Result<Hello, Error> {
        self.events.clear();
        self.subscription = None;
        // A board may be too quick to say that it will.
        match self.act(&Request::Restart) {
            Ok(_) | Err(Error::Timeout { .. } | Error::Damaged { .. }) => {}
            Err(error) => return Err(error),
        }
        let until = Instant::now() + START;
        while Instant::now() < until {
            let left = until.saturating_duration_since(Instant::now());
            match self.poll(left.min(self.timeout))? {
                Some(Event::Started(hello)) => return Ok(hello),
                Some(_) => {}
                // The greeting may have been torn.
                None => return self.greet(),
            }
        }
        self.greet()
    }

    /// The next thing that the board says unasked; none where it says nothing for `timeout`, which may be zero.
    ///
    /// # Errors
    /// [`Error::Gone`].
    pub fn poll(&mut self, timeout: Duration) -> Result<Option<Event>, Error> {
        let until = Instant::now() + timeout;
        self.read(Duration::ZERO)?;
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            match self.next(until)? {
                None => return Ok(None),
                Some(Incoming::Damaged) => {}
                Some(Incoming::Line(line)) => self.line(line),
                Some(Incoming::Frame(frame)) => {
                    let mut payload = [0; PAYLOAD_MAX];
                    if let Ok((tag, reply)) = decode::<(Tag, Reply<'_>)>(&frame, &mut payload) {
                        self.unasked(tag, &reply);
                    }
                }
            }
        }
    }

    /// Says hello until somebody answers that can be talked to.
    fn greet(&mut self) -> Result<Hello, Error> {
        let hello = self.hello()?;
        let (version, schema) = (env!("CARGO_PKG_VERSION"), param::SCHEMA);
        if hello.schema != schema || hello.version != version {
            return Err(self.other(&format!(
                "version {}, schema {:08x}",
                hello.version, hello.schema
            )));
        }
        Ok(hello)
    }

    /// Does what is not undone by doing it twice only once.
    fn act(&mut self, request: &Request<'_>) -> Result<Option<u64>, Error> {
        Ok(self.ask(request, |(), _| {})?.1)
    }

    fn dated(&mut self, request: &Request<'_>) -> Result<u64, Error> {
        let at = self.act(request)?;
        at.ok_or_else(|| self.damaged())
    }

    /// Sends any request, and gathers the replies to it with `each`, from the beginning where it has to be sent again.
    /// Returns what was gathered, and the frame from which on it is heard, if it can be heard.
    ///
    /// # Errors
    /// All but [`Error::Open`].
    pub fn ask<T: Default>(
        &mut self,
        request: &Request<'_>,
        mut each: impl FnMut(&mut T, &Reply<'_>),
    ) -> Result<(T, Option<u64>), Error> {
        for _ in 0..TRIES {
            let mut gathered = T::default();
            match self.once(request, &mut |reply| each(&mut gathered, reply))? {
                Outcome::Done(at) => return Ok((gathered, at)),
                Outcome::Failed(error) => return Err(error),
                Outcome::Lost => {}
                Outcome::Torn if is_question(request) => {}
                Outcome::Torn => break,
            }
        }
        Err(self.damaged())
    }

    fn once(
        &mut self,
        request: &Request<'_>,
        each: &mut dyn FnMut(&Reply<'_>),
    ) -> Result<Outcome, Error> {
        let tag = self.send(request)?;
        let (mut within, mut refused) = (self.timeout, Vec::new());
        let mut until = Instant::now() + within;
        // Something was damaged: of the answer, or of the request.
        let (mut torn, mut lost) = (false, false);
        loop {
            let frame = match self.next(until)? {
                Some(Incoming::Frame(frame)) => frame,
                Some(Incoming::Line(line)) => {
                    self.line(line);
                    continue;
                }
                Some(Incoming::Damaged) => {
                    torn = true;
                    continue;
                }
                None if lost => return Ok(Outcome::Lost),
                None if torn && self.heard > 0 => return Ok(Outcome::Torn),
                None => {
                    return Ok(Outcome::Failed(Error::Timeout {
                        port: self.port().to_owned(),
                        within,
                        heard: self.heard,
                    }));
                }
            };
            let mut payload = [0; PAYLOAD_MAX];
            let (told, reply) = match decode::<(Tag, Reply<'_>)>(&frame, &mut payload) {
                Ok(message) => message,
                // Whole, and yet unknown.
                Err(FrameError::Message) => {
                    let error = self.other("with other messages");
                    return Ok(Outcome::Failed(error));
                }
                Err(_) => {
                    torn = true;
                    continue;
                }
            };
            self.heard = self.heard.saturating_sub(frame.len());
            match reply {
                // It may be about what a program before left there half said; if nothing follows, it was about this.
                Reply::Refused(Refusal::Frame) if told == 0 => {
                    lost = true;
                    until = until.min(Instant::now() + RETRY);
                }
                reply if told != tag => self.unasked(told, &reply),
                Reply::Refused(Refusal::Message) => {
                    let error = self.other("with other messages");
                    return Ok(Outcome::Failed(error));
                }
                Reply::Refused(refusal) => {
                    return Ok(Outcome::Failed(Error::Refused(refusal.to_string())));
                }
                Reply::Skipped(refusal) => refused.push(refusal.to_string()),
                Reply::Pause { ms, .. } => {
                    within = 4 * Duration::from_millis(ms.into()) + self.timeout;
                    until = Instant::now() + within;
                }
                Reply::Done { .. } if torn && is_question(request) => return Ok(Outcome::Torn),
                Reply::Done { at: Some(at) } if !refused.is_empty() => {
                    return Ok(Outcome::Failed(Error::Partly { refused, at }));
                }
                Reply::Done { at: None } if !refused.is_empty() => {
                    return Ok(Outcome::Failed(Error::Refused(refused.join("; "))));
                }
                Reply::Done { at } => return Ok(Outcome::Done(at)),
                reply => {
                    each(&reply);
                    until = Instant::now() + within;
                }
            }
        }
    }

    /// Sends a request under a tag of its own.
    fn send(&mut self, request: &Request<'_>) -> Result<Tag, Error> {
        loop {
            self.tag = self.tag.wrapping_add(1);
            // 0 is a board's for what it cannot read.
            if self.tag != 0 && Some(self.tag) != self.subscription {
                break;
            }
        }
        let mut bytes = [0; FRAME_MAX + 3];
        let length = encode(&(self.tag, request), &mut bytes)
            .map_err(|_| Error::Refused(Refusal::Line.to_string()))?;
        self.heard = 0;
        match self.link.write(&bytes[..length]) {
            Ok(()) => Ok(self.tag),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Err(Error::Timeout {
                port: self.port().to_owned(),
                within: self.timeout,
                heard: 0,
            }),
            Err(error) => Err(self.gone(&error)),
        }
    }

    /// What comes next, until then.
    fn next(&mut self, until: Instant) -> Result<Option<Incoming>, Error> {
        loop {
            while let Some(byte) = self.inbox.pop_front() {
                match self.splitter.push(byte) {
                    None => {}
                    Some(Item::Frame(frame)) => return Ok(Some(Incoming::Frame(frame.to_vec()))),
                    Some(Item::Line(line)) => return Ok(Some(Incoming::Line(line.to_owned()))),
                    Some(Item::Garbage) => return Ok(Some(Incoming::Damaged)),
                }
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.read(left)?;
        }
    }

    /// Takes what there is, or what comes within `timeout`.
    fn read(&mut self, timeout: Duration) -> Result<(), Error> {
        let mut buffer = [0; 1024];
        let count = (self.link.read(&mut buffer, timeout)).map_err(|error| self.gone(&error))?;
        self.heard += count;
        self.inbox.extend(&buffer[..count]);
        Ok(())
    }

    /// Keeps what nobody has asked for; answers that come too late are let go.
    fn unasked(&mut self, tag: Tag, reply: &Reply<'_>) {
        if let (true, Reply::Status(status)) = (self.subscription == Some(tag), reply) {
            self.event(Event::Status(status.into()));
        }
    }

    fn line(&mut self, line: String) {
        self.event(match Hello::parse(&line) {
            Some(hello) => Event::Started(hello),
            None => Event::Line(line),
        });
    }

    fn event(&mut self, event: Event) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }

    fn gone(&self, error: &io::Error) -> Error {
        Error::Gone {
            port: self.port().to_owned(),
            reason: error.to_string(),
        }
    }

    fn damaged(&self) -> Error {
        Error::Damaged {
            port: self.port().to_owned(),
        }
    }

    fn other(&self, theirs: &str) -> Error {
        Error::Version {
            port: self.port().to_owned(),
            theirs: theirs.to_owned(),
            ours: format!(
                "version {}, schema {:08x}",
                env!("CARGO_PKG_VERSION"),
                param::SCHEMA
            ),
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.subscription.is_some() {
            // Nobody is left to hear whether it was.
            let _ = self.send(&Request::Subscribe(0));
        }
    }
}

/// Whether it changes nothing, so that it may be sent again.
fn is_question(request: &Request<'_>) -> bool {
    match request {
        Request::Hello
        | Request::Help(_)
        | Request::List(_)
        | Request::Describe(_)
        | Request::Get(_)
        | Request::Scenes
        | Request::Presets
        | Request::Boot
        | Request::Status => true,
        Request::Set { .. }
        | Request::Scene(_)
        | Request::Trigger { .. }
        | Request::Mute(_)
        | Request::Store { .. }
        | Request::Recall(_)
        | Request::Erase(_)
        | Request::SetBoot(_)
        | Request::Subscribe(_)
        | Request::Restart => false,
    }
}

/// The id of the parameter at `path`; the board has the same table.
fn id(path: &str) -> Result<u16, Error> {
    match param::index_of(path) {
        Some(index) => Ok(param::TABLE[index].id),
        None => {
            // In the board's own words.
            let mut why = Refusal::Path(path, None).to_string();
            let _ = parse(&format!("get {path}"), &mut |refusal| {
                why = refusal.to_string();
            });
            Err(Error::Refused(why))
        }
    }
}
