//! Takes wishes from the queue to the board, and keeps the board at hand.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::log::Log;
use super::osc;
use super::queue::{Moves, Queue, Step};
use super::socket::Socket;
use super::wish::{Command, Origin, SceneChoice};
use crate::client::{Client, Error, Event, Hello};

/// Least time between two values for the same parameter.
pub const PACE: Duration = Duration::from_millis(5);
/// How often a board that is away is looked for.
const RETRY: Duration = Duration::from_secs(1);
/// How often the board is listened to: with a subscriber, and without.
const LISTEN: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(50)];
/// What is answered meanwhile.
const AWAY: &str = "the board is away";

/// Opens the link to the board, as often as need be.
pub type Opener = Box<dyn FnMut() -> Result<Client, Error> + Send>;

/// The one who talks to the board.
pub struct Worker {
    opener: Opener,
    client: Option<Client>,
    /// What was not set while the board was away.
    held: Moves,
    subscriber: Option<(SocketAddr, u16)>,
    socket: Option<Arc<Socket>>,
    queue: Arc<Queue>,
    log: Arc<Log>,
    /// When values are sent again.
    moves_from: Instant,
    /// When the board is looked for again, and what went wrong the last time.
    look_from: Instant,
    trouble: String,
}

impl Worker {
    /// With a board that is there.
    pub fn new(
        client: Client,
        opener: Opener,
        socket: Option<Arc<Socket>>,
        queue: Arc<Queue>,
        log: Arc<Log>,
    ) -> Self {
        Self {
            opener,
            client: Some(client),
            held: Moves::default(),
            subscriber: None,
            socket,
            queue,
            log,
            moves_from: Instant::now(),
            look_from: Instant::now(),
            trouble: String::new(),
        }
    }

    /// Until `stop`, or until the queue has ended.
    ///
    /// # Errors
    /// Where the queue ends and the board is away.
    pub fn run(&mut self, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed) {
            self.look();
            let wait = LISTEN[usize::from(self.subscriber.is_none())];
            match self.queue.next(wait, self.moves_from) {
                Step::Moves(moves) => self.set(moves),
                Step::Command(command, origin) => self.obey(&command, origin),
                Step::Wait => {}
                Step::End if self.held.is_empty() => return Ok(()),
                Step::End => bail!("the last values were not set, for {}", self.trouble),
            }
            self.hear();
        }
        Ok(())
    }

    /// Looks for a board that is away.
    fn look(&mut self) {
        if self.client.is_some() || Instant::now() < self.look_from {
            return;
        }
        match (self.opener)() {
            Ok(mut client) => {
                let plays = client.hello().map(|hello| hello.scene);
                let plays = plays.map_or(String::new(), |scene| format!(", playing {scene}"));
                self.log.say(&format!("{} is back{plays}", client.port()));
                self.trouble.clear();
                self.client = Some(client);
                self.subscribe();
                let held = std::mem::take(&mut self.held);
                self.set(held);
            }
            Err(error) => self.lose(&error),
        }
    }

    /// The board is away.
    fn lose(&mut self, error: &Error) {
        self.client = None;
        self.look_from = Instant::now() + RETRY;
        let text = error.to_string();
        if self.trouble != text {
            self.log
                .say(&format!("{text}; looking for it every {RETRY:?}"));
            self.trouble = text;
        }
    }

    /// What the board says unasked.
    fn hear(&mut self) {
        while let Some(client) = &mut self.client {
            match client.poll(Duration::ZERO) {
                Ok(None) => return,
                Ok(Some(Event::Status(report))) => self.report(&osc::status(&report.status())),
                Ok(Some(Event::Started(hello))) => self.started(&hello),
                Ok(Some(Event::Line(_))) => {}
                Err(error) => return self.lose(&error),
            }
        }
    }

    fn started(&mut self, hello: &Hello) {
        self.log.say(&format!(
            "the board has started anew, playing {}",
            hello.scene
        ));
        self.report(&osc::hello(hello));
        self.subscribe();
    }

    fn report(&self, packet: &[u8]) {
        if let Some((subscriber, _)) = self.subscriber {
            self.answer(Some(subscriber), packet);
        }
    }

    fn answer(&self, origin: Origin, packet: &[u8]) {
        if let (Some(socket), Some(asker)) = (&self.socket, origin) {
            socket.answer(asker, packet);
        }
    }

    fn refuse(&self, origin: Origin, address: &str, text: &str) {
        match (&self.socket, origin) {
            (Some(socket), Some(asker)) => {
                self.log
                    .complain(&format!("OSC from {asker}: {address} {text}"));
                socket.refuse(asker, address, text);
            }
            _ => self.log.complain(&format!("MIDI: {text}")),
        }
    }

    /// Moves parameters, or keeps them until the board is there.
    fn set(&mut self, moves: Moves) {
        self.moves_from = Instant::now() + PACE;
        for batch in moves.batches() {
            let Some(client) = &mut self.client else {
                break;
            };
            let mut result = client.set_ids(&batch.values, batch.ramp);
            // To set it twice does no harm, and a last value must not be lost.
            if matches!(result, Err(Error::Damaged { .. })) {
                result = client.set_ids(&batch.values, batch.ramp);
            }
            match result {
                Ok(_) => {}
                Err(error) if is_away(&error) => {
                    self.lose(&error);
                    break;
                }
                Err(error) => self.refuse(batch.origin, "", &error.to_string()),
            }
        }
        if self.client.is_none() {
            self.held.follow(moves);
        }
    }

    fn subscribe(&mut self) {
        if let (Some((_, ticks)), Some(client)) = (self.subscriber, &mut self.client) {
            match client.subscribe(ticks) {
                Ok(()) => {}
                Err(error) if is_away(&error) => self.lose(&error),
                Err(error) => self.log.complain(&error.to_string()),
            }
        }
    }

    fn obey(&mut self, command: &Command, origin: Origin) {
        if let (Command::Subscribe(ticks), Some(asker)) = (command, origin) {
            self.subscriber = (*ticks > 0).then_some((asker, *ticks));
        }
        let address = address_of(command);
        let Some(client) = &mut self.client else {
            return self.refuse(origin, address, AWAY);
        };
        match obey(client, command) {
            Ok(packets) => {
                for packet in packets {
                    self.answer(origin, &packet);
                }
            }
            Err(error) => {
                let text = error.to_string();
                if is_away(&error) {
                    self.lose(&error);
                }
                self.refuse(origin, address, &text);
            }
        }
    }
}

/// What is done, and answered.
fn obey(client: &mut Client, command: &Command) -> Result<Vec<Vec<u8>>, Error> {
    match command {
        Command::Scene(SceneChoice::Number(number)) => client.scene_number(*number).map(drop)?,
        Command::Scene(SceneChoice::Name(name)) => client.scene(name).map(drop)?,
        Command::Trigger([radius, pressure, rise]) => {
            client.trigger(*radius, *pressure, *rise).map(drop)?;
        }
        Command::Mute(on) => client.mute(*on).map(drop)?,
        Command::Recall(slot) => client.recall(*slot).map(drop)?,
        Command::Subscribe(ticks) => client.subscribe(*ticks)?,
        Command::Get(ids) if ids.is_empty() => return Ok(osc::values(&client.values()?)),
        Command::Get(ids) => {
            let values = client.get_ids(ids)?;
            let pairs: Vec<(u16, f32)> = ids.iter().copied().zip(values).collect();
            return Ok(osc::values(&pairs));
        }
        Command::Hello => return Ok(vec![osc::hello(&client.hello()?)]),
        Command::Scenes => {
            let names = client.scenes()?.into_iter().map(|scene| scene.name);
            return Ok(vec![osc::scenes(names)]);
        }
    }
    Ok(Vec::new())
}

/// Whether the board has to be looked for.
fn is_away(error: &Error) -> bool {
    match error {
        Error::Open { .. } | Error::Gone { .. } | Error::Timeout { .. } | Error::Version { .. } => {
            true
        }
        Error::Damaged { .. } | Error::Refused(_) | Error::Partly { .. } => false,
    }
}

fn address_of(command: &Command) -> &'static str {
    match command {
        Command::Scene(_) => "/freshet/scene",
        Command::Trigger(_) => "/freshet/trigger",
        Command::Mute(_) => "/freshet/mute",
        Command::Recall(_) => "/freshet/recall",
        Command::Get(_) => "/freshet/get",
        Command::Subscribe(_) => "/freshet/subscribe",
        Command::Hello => "/freshet/hello",
        Command::Scenes => "/freshet/scenes",
    }
}
