//! The thread that talks to the instrument, so that the screen never waits for it.

use std::fs::File;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::Result;
use freshet::param::{INTENSITY, TABLE};
use freshet::protocol::{Line, Pair, Reply, Request};

use super::engine::Mirror;
use super::model::Standing;
use super::outbox::Order;
use crate::client::{Client, Error, Event, Hello, PresetInfo, Report};

/// Ticks between two reports: 0.2 s.
const REPORTS: u16 = 75;
/// How long the instrument is listened to before orders are looked at again.
const LISTEN: Duration = Duration::from_millis(10);
/// How often a lost board is looked for.
const AGAIN: Duration = Duration::from_millis(700);
/// How often the scene is asked for: the board has a button.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// How long after an order that moves more than it names all values are asked for, and again until they stay.
const SETTLED: Duration = Duration::from_millis(800);

/// What there is to know of the instrument.
#[derive(Clone, Debug)]
pub enum News {
    /// It is there again, or has started anew.
    Connected(Standing),
    /// How it stands after so many orders.
    Standing(u64, Hello, Vec<Pair>),
    /// What it keeps.
    Presets(Vec<PresetInfo>),
    /// How it is.
    Report(Report),
    /// It is not there any more.
    Lost(String),
    /// It did not do what it was asked for.
    Refused(String),
    /// It did something that takes its time.
    Done(String),
}

/// Opens the instrument, time and again.
pub type Opener = Box<dyn FnMut() -> Result<Client, Error> + Send>;

/// The thread's other end.
pub struct DeviceLink {
    orders: Option<Sender<Order>>,
    news: Receiver<News>,
    waiting: Arc<AtomicUsize>,
    thread: Option<JoinHandle<()>>,
}

impl DeviceLink {
    /// Goes on with `client`; what it was asked for goes to `mirror` and `log` too.
    pub fn start(
        client: Client,
        open: Opener,
        mirror: Option<Mirror>,
        log: Option<File>,
    ) -> Result<Self> {
        let ((orders, inbox), (outbox, news)) = (channel(), channel());
        let waiting = Arc::new(AtomicUsize::new(0));
        let talk = Talk {
            orders: inbox,
            news: outbox,
            waiting: Arc::clone(&waiting),
            mirror,
            log,
            done: 0,
        };
        let run = move || talk.run(client, open);
        let thread = thread::Builder::new().name("link".to_owned()).spawn(run)?;
        Ok(Self {
            orders: Some(orders),
            news,
            waiting,
            thread: Some(thread),
        })
    }

    /// Whether all orders are done.
    pub fn is_idle(&self) -> bool {
        self.waiting.load(Ordering::Acquire) == 0
    }

    /// Gives an order.
    pub fn give(&self, order: Order) {
        if let Some(orders) = &self.orders {
            self.waiting.fetch_add(1, Ordering::AcqRel);
            // The thread ends only after this.
            let _ = orders.send(order);
        }
    }

    /// The next news.
    pub fn news(&self) -> Option<News> {
        self.news.try_recv().ok()
    }

    /// Whether the thread is still there.
    pub fn is_alive(&self) -> bool {
        (self.thread.as_ref()).is_some_and(|thread| !thread.is_finished())
    }
}

impl Drop for DeviceLink {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            // It has nothing left to say.
            let _ = thread.join();
        }
    }
}

/// The whole state of an instrument.
pub fn standing(client: &mut Client) -> Result<Standing, Error> {
    let scenes = client.scenes()?;
    Ok(Standing {
        hello: client.hello()?,
        values: client.values()?,
        scenes: scenes.into_iter().map(|scene| scene.name).collect(),
        presets: client.presets()?,
    })
}

/// Nobody wants to know any more.
struct Over;

struct Talk {
    orders: Receiver<Order>,
    news: Sender<News>,
    waiting: Arc<AtomicUsize>,
    mirror: Option<Mirror>,
    log: Option<File>,
    done: u64,
}

impl Talk {
    fn run(mut self, client: Client, mut open: Opener) {
        let mut client = Some(client);
        loop {
            if let Some(mut there) = client.take() {
                match self.serve(&mut there) {
                    Ok(Over) => return,
                    Err(error) => self.tell(News::Lost(error.to_string())),
                }
            }
            // Nobody does what is ordered meanwhile.
            let until = Instant::now() + AGAIN;
            while Instant::now() < until {
                match self.orders.try_recv() {
                    Ok(_) => self.finish(),
                    Err(TryRecvError::Disconnected) => return,
                    Err(TryRecvError::Empty) => thread::sleep(LISTEN),
                }
            }
            client = match open().and_then(|mut client| {
                let standing = standing(&mut client)?;
                Ok((client, standing))
            }) {
                Ok((client, standing)) => {
                    self.connected(standing);
                    Some(client)
                }
                Err(error) => {
                    self.tell(News::Lost(error.to_string()));
                    None
                }
            };
        }
    }

    fn tell(&self, news: News) {
        // Whoever does not listen any more will soon end this.
        let _ = self.news.send(news);
    }

    fn connected(&self, standing: Standing) {
        if let Some(mirror) = &self.mirror {
            mirror.stand(&standing.hello, &standing.values, true);
        }
        self.tell(News::Connected(standing));
    }

    /// One order less.
    fn finish(&mut self) {
        self.done += 1;
        self.waiting.fetch_sub(1, Ordering::AcqRel);
    }

    /// Until it is over, or the instrument is lost.
    fn serve(&mut self, client: &mut Client) -> Result<Over, Error> {
        client.subscribe(REPORTS)?;
        let mut scene = client.hello()?.scene;
        let mut beat = Instant::now() + HEARTBEAT;
        // When to ask for all values, and what they were the last time.
        let mut look: Option<Instant> = None;
        let mut seen: Option<Vec<Pair>> = None;
        loop {
            loop {
                let order = match self.orders.try_recv() {
                    Ok(order) => order,
                    Err(TryRecvError::Disconnected) => return Ok(Over),
                    Err(TryRecvError::Empty) => break,
                };
                if moves_more(&order) {
                    (look, seen) = (Some(Instant::now() + SETTLED), None);
                }
                let result = self.execute(client, &order);
                self.finish();
                match result {
                    Ok(()) => {}
                    Err(Error::Refused(why)) => {
                        self.tell(News::Refused(why));
                        (look, seen) = (Some(Instant::now()), None);
                    }
                    Err(error @ Error::Partly { .. }) => {
                        self.tell(News::Refused(error.to_string()));
                        (look, seen) = (Some(Instant::now()), None);
                    }
                    Err(error) => return Err(error),
                }
                if let Order::Scene(name) = order {
                    scene = name;
                }
            }
            match client.poll(LISTEN)? {
                Some(Event::Status(report)) => self.tell(News::Report(report)),
                Some(Event::Started(_)) => {
                    let standing = standing(client)?;
                    scene.clone_from(&standing.hello.scene);
                    client.subscribe(REPORTS)?;
                    self.connected(standing);
                    look = None;
                }
                Some(Event::Line(_)) | None => {}
            }
            let now = Instant::now();
            if beat <= now {
                beat = now + HEARTBEAT;
                let plays = client.hello()?.scene;
                if plays != scene {
                    scene = plays;
                    (look, seen) = (Some(now + SETTLED), None);
                }
            }
            if look.is_some_and(|look| look <= now) {
                let (hello, values) = (client.hello()?, client.values()?);
                scene.clone_from(&hello.scene);
                look = (seen.as_ref() != Some(&values)).then(|| now + SETTLED / 2);
                // What the board was led to otherwise than by orders the mirror learns from the values.
                if let Some(mirror) = &self.mirror
                    && look.is_none()
                {
                    mirror.stand(&hello, &values, false);
                }
                seen = Some(values.clone());
                self.tell(News::Standing(self.done, hello, values));
            }
        }
    }

    fn execute(&mut self, client: &mut Client, order: &Order) -> Result<(), Error> {
        let (request, at) = match order {
            Order::Set(pairs, ramp) => {
                let values = pairs.iter().copied().collect();
                let request = Request::Set {
                    values,
                    ramp: *ramp,
                };
                (request, client.set_ids(pairs, *ramp)?)
            }
            Order::Scene(name) => {
                let request = Request::Scene(freshet::protocol::Choice::Name(name));
                (request, client.scene(name)?)
            }
            Order::Trigger => {
                let request = Request::Trigger {
                    radius: None,
                    pressure: None,
                    rise_factor: None,
                };
                (request, client.trigger(None, None, None)?)
            }
            Order::Mute(on) => (Request::Mute(*on), client.mute(*on)?),
            Order::Recall(slot) => (Request::Recall(*slot), client.recall(*slot)?),
            Order::Store(slot, name) => {
                client.store(*slot, name)?;
                self.tell(News::Presets(client.presets()?));
                self.tell(News::Done(format!("kept in slot {slot}")));
                return Ok(());
            }
            Order::Erase(slot) => {
                client.erase(*slot)?;
                self.tell(News::Presets(client.presets()?));
                self.tell(News::Done(format!("slot {slot} is free")));
                return Ok(());
            }
        };
        if let Some(log) = &mut self.log {
            let line = Line(&Reply::Done { at: Some(at) }, &request).to_string();
            if let Err(error) = log.write_all(line.as_bytes()) {
                self.log = None;
                self.tell(News::Refused(format!("the log cannot be written: {error}")));
            }
        }
        if let Some(mirror) = &self.mirror {
            mirror.follow(order);
        }
        Ok(())
    }
}

/// Whether an order moves other parameters than it names.
fn moves_more(order: &Order) -> bool {
    match order {
        Order::Set(pairs, _) => pairs.iter().any(|pair| pair.0 == TABLE[INTENSITY].id),
        Order::Scene(_) | Order::Recall(_) => true,
        Order::Trigger | Order::Mute(_) | Order::Store(..) | Order::Erase(_) => false,
    }
}
