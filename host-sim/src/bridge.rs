//! `freshet bridge`: OSC over UDP and MIDI to a board.
//!
//! ```text
//! UDP ──► socket ──► osc ────────┐
//!                                ├► wishes ──► queue ──► worker ──► client ──► board
//! MIDI ─► ports ──► midi ──► mapping ┘                      └──► answers, reports ──► socket
//! ```
//!
//! However fast values come, the board is sent the last one of each parameter, every 5 ms at most, as many in one request
//! as there may be. Nothing here grows with what comes in.

mod log;
mod map_file;
mod mapping;
mod midi;
mod osc;
mod player;
mod ports;
mod queue;
mod socket;
mod wish;
mod worker;

pub use log::Log;
pub use map_file::{learn, open as open_mapping, parse as parse_mapping};
pub use mapping::{Mapping, Notes, Programs, Rule, radius};
pub use player::Wanted;
pub use ports::list as devices;
pub use socket::PORT;
pub use worker::{Opener, PACE};

use std::io::{BufRead, Read};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context, Result, bail};
use clap::Args;
use freshet::param;

use crate::client::{BAUD, Client};
use crate::scene_file::unknown_path;
use player::Player;
use queue::Queue;
use socket::Socket;
use worker::Worker;

/// What `freshet bridge` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// The board's serial port, or the simulated one of `freshet simulate`
    pub port: Option<String>,
    /// Bits a second
    #[arg(long, default_value_t = BAUD)]
    pub baud: u32,
    /// Hear OSC at this address or port [default, where no --midi is given: 127.0.0.1:9000]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "9000")]
    pub osc: Option<String>,
    /// Send OSC answers to this address or port, not to whoever asked
    #[arg(long, value_name = "ADDR")]
    pub reply: Option<String>,
    /// Hear this MIDI device (a part of its name will do); `-`: raw MIDI bytes on the standard input; without a name:
    /// list the devices
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "")]
    pub midi: Option<String>,
    /// What the MIDI messages mean, as TOML
    #[arg(long, value_name = "FILE", requires = "midi")]
    pub map: Option<PathBuf>,
    /// Bind the controller that is moved next to this parameter, and keep it in the mapping file; may be given again;
    /// without a parameter: ask for them
    #[arg(long, value_name = "PATH", num_args = 0..=1, default_missing_value = "", requires_all = ["midi", "map"])]
    pub learn: Vec<String>,
}

/// What a bridge hears.
pub struct Inputs {
    /// OSC, and where its answers go; none: to whoever asked.
    pub osc: Option<(SocketAddr, Option<SocketAddr>)>,
    /// Raw MIDI bytes; where they end and there is no OSC, the bridge ends.
    pub midi: Option<Box<dyn Read + Send>>,
    /// What MIDI messages mean.
    pub mapping: Mapping,
    /// Where what is learnt is kept.
    pub map: Option<PathBuf>,
    /// What is to be learnt.
    pub wanted: Wanted,
}

/// A bridge that is ready.
pub struct Bridge {
    socket: Option<Arc<Socket>>,
    queue: Arc<Queue>,
    log: Arc<Log>,
    worker: Worker,
    player: Option<(Box<dyn Read + Send>, Player)>,
    /// Kept for as long as it plays.
    device: Option<ports::Device>,
}

impl Bridge {
    /// Opens the board and all that is to be heard.
    pub fn new(mut opener: Opener, inputs: Inputs, log: Log) -> Result<Self> {
        let client = opener()?;
        Self::with_client(client, opener, inputs, log)
    }

    fn with_client(client: Client, opener: Opener, inputs: Inputs, log: Log) -> Result<Self> {
        let (queue, log) = (Arc::new(Queue::default()), Arc::new(log));
        let socket = (inputs.osc)
            .map(|(address, reply)| Socket::bind(address, reply).map(Arc::new))
            .transpose()?;
        let player = inputs.midi.map(|bytes| {
            let player = Player::new(
                inputs.mapping,
                inputs.map,
                inputs.wanted,
                Arc::clone(&queue),
                Arc::clone(&log),
            );
            (bytes, player)
        });
        let worker = Worker::new(
            client,
            opener,
            socket.clone(),
            Arc::clone(&queue),
            Arc::clone(&log),
        );
        Ok(Self {
            socket,
            queue,
            log,
            worker,
            player,
            device: None,
        })
    }

    /// Where it hears OSC.
    pub fn osc(&self) -> Option<SocketAddr> {
        self.socket.as_ref()?.address().ok()
    }

    /// Runs until `stop`, or until there is nothing more to hear.
    ///
    /// # Errors
    /// Where the last values could not be set.
    pub fn run(mut self, stop: &Arc<AtomicBool>) -> Result<()> {
        // Threads hear until then, whatever ends the bridge.
        let ended = Arc::new(AtomicBool::new(false));
        let listener = self.socket.clone().map(|socket| {
            let (queue, log) = (Arc::clone(&self.queue), Arc::clone(&self.log));
            let ended = Arc::clone(&ended);
            thread::spawn(move || socket.listen(&queue, &log, &ended))
        });
        if let Some((bytes, mut player)) = self.player.take() {
            let (queue, alone) = (Arc::clone(&self.queue), self.socket.is_none());
            // Nothing can wake it while it reads: it ends with the program at the latest.
            thread::spawn(move || {
                ports::read(bytes, &mut player);
                if alone {
                    queue.close();
                }
            });
        }
        let _playing = self.device.take();
        let result = self.worker.run(stop);
        ended.store(true, Ordering::Relaxed);
        if let Some(listener) = listener {
            let _ = listener.join();
        }
        result
    }
}

/// The lines that `freshet bridge --midi` says.
pub fn list_devices() -> Result<String> {
    let names = devices()?;
    if names.is_empty() {
        bail!("no MIDI device was found (is it plugged in and on?)");
    }
    Ok(names.join("\n"))
}

/// Runs the command until `stop`; returns what is to be printed.
pub fn bridge(request: &Request, stop: &Arc<AtomicBool>) -> Result<Option<String>> {
    if request.midi.as_deref() == Some("") {
        return list_devices().map(Some);
    }
    let Some(port) = request.port.clone() else {
        bail!(
            "which serial port? `freshet bridge PORT` (a name after --osc or --midi is theirs: put the port first)"
        );
    };
    let osc = match (&request.osc, &request.midi) {
        (Some(address), _) => Some(address.clone()),
        (None, None) => Some(PORT.to_string()),
        (None, Some(_)) => None,
    };
    let osc = (osc.map(|text| socket::address(&text)).transpose()).context("--osc")?;
    let reply = request.reply.as_deref().map(socket::address).transpose();
    let reply = reply.context("--reply")?;
    if reply.is_some() && osc.is_none() {
        bail!("--reply: answers are OSC's; add --osc");
    }
    let (wanted, asks) = wanted(request)?;
    let mapping = match &request.map {
        // A file to learn into need not be there yet.
        Some(path) if !request.learn.is_empty() => map_file::open_or_new(path)?,
        Some(path) => map_file::open(path)?,
        None => Mapping::default(),
    };
    let raw = request.midi.as_deref() == Some("-");
    let inputs = Inputs {
        osc: osc.map(|address| (address, reply)),
        midi: raw.then(|| Box::new(std::io::stdin()) as Box<dyn Read + Send>),
        mapping: mapping.clone(),
        map: request.map.clone(),
        wanted: wanted.clone(),
    };
    let (name, baud) = (port.clone(), request.baud);
    let mut opener: Opener = Box::new(move || Client::open(&name, baud));
    let mut client = opener()?;
    let hello = client.hello()?;
    let mut bridge = Bridge::with_client(client, opener, inputs, Log::stderr())?;
    let mut heard = Vec::new();
    if let Some(address) = bridge.osc() {
        heard.push(format!("OSC at {address}"));
        if !address.ip().is_loopback() {
            bridge
                .log
                .say("anybody who reaches this machine over the network can play the board");
        }
    }
    match request.midi.as_deref() {
        Some("-") => heard.push("MIDI bytes of the standard input".to_owned()),
        Some(name) => {
            let player = Player::new(
                mapping,
                request.map.clone(),
                wanted.clone(),
                Arc::clone(&bridge.queue),
                Arc::clone(&bridge.log),
            );
            bridge.device = Some(ports::open(name, player)?);
            heard.push(format!("MIDI of {name}"));
        }
        None => {}
    }
    bridge.log.say(&format!(
        "{} at {port} plays {}; hears {}; Ctrl-C ends it",
        hello.board,
        hello.scene,
        heard.join(" and ")
    ));
    if let Some(first) = wanted.first() {
        let path = param::TABLE[first].path;
        bridge.log.say(&format!("move the controller for {path}"));
    }
    if asks {
        let log = Arc::clone(&bridge.log);
        log.say("type a parameter, such as water.rate, then move its controller");
        thread::spawn(move || ask(&wanted, &log));
    }
    bridge.run(stop)?;
    Ok(None)
}

/// What is to be learnt, and whether more is asked for.
fn wanted(request: &Request) -> Result<(Wanted, bool)> {
    let (wanted, mut asks) = (Wanted::default(), false);
    for path in &request.learn {
        if path.is_empty() {
            asks = true;
            continue;
        }
        let index = param::index_of(path).ok_or_else(|| unknown_path(path));
        wanted.push(index.context("--learn")?);
    }
    if asks && request.midi.as_deref() == Some("-") {
        bail!("--learn: name a parameter; the standard input is MIDI's here");
    }
    Ok((wanted, asks))
}

/// Takes parameters from the standard input, as long as it lasts.
fn ask(wanted: &Wanted, log: &Log) {
    for line in std::io::stdin().lock().lines() {
        let Ok(line) = line else { return };
        match (line.trim(), param::index_of(line.trim())) {
            ("", _) => {}
            (path, None) => log.say(&unknown_path(path).to_string()),
            (path, Some(index)) => {
                wanted.push(index);
                log.say(&format!("move the controller for {path}"));
            }
        }
    }
}
