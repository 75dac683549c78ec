//! OSC over UDP: what comes goes into the queue, what is answered goes back.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result, bail};

use super::log::{Limit, Log};
use super::osc;
use super::queue::Queue;

/// The port where none is said.
pub const PORT: u16 = 9000;
/// Errors answered in a second, to all senders together.
const ERRORS: u32 = 50;
/// How soon a stop is noticed.
const LOOK: Duration = Duration::from_millis(100);
/// Bytes of the longest datagram there is.
const DATAGRAM: usize = 1 << 16;

/// An address as people write it: `9001` and `:9001` are ports of this machine alone.
pub fn address(text: &str) -> Result<SocketAddr> {
    let port = text.strip_prefix(':').unwrap_or(text);
    if let Ok(port) = port.parse::<u16>() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    let named = text.strip_prefix("localhost:");
    if let Some(Ok(port)) = named.map(str::parse::<u16>) {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    if let Ok(ip) = text.parse::<IpAddr>() {
        return Ok((ip, PORT).into());
    }
    match text.parse() {
        Ok(address) => Ok(address),
        Err(_) => bail!(
            "{text}: expected an address such as 127.0.0.1:{PORT}, or a port such as {PORT} (0.0.0.0:{PORT} hears the whole network)"
        ),
    }
}

/// The socket, and where answers go.
pub struct Socket {
    socket: UdpSocket,
    /// All answers go here; none: to whoever asked.
    reply: Option<SocketAddr>,
    errors: Mutex<Limit>,
}

impl Socket {
    /// Listens at `address`.
    pub fn bind(address: SocketAddr, reply: Option<SocketAddr>) -> Result<Self> {
        let socket = UdpSocket::bind(address).with_context(|| {
            format!("cannot listen for OSC at {address} (has another program that port? `--osc ADDRESS:PORT` takes another)")
        })?;
        socket
            .set_read_timeout(Some(LOOK))
            .context("cannot listen for OSC")?;
        let errors = Mutex::new(Limit::new(ERRORS));
        Ok(Self {
            socket,
            reply,
            errors,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> Result<SocketAddr> {
        Ok(self.socket.local_addr()?)
    }

    /// Sends an answer to `asker`. Nobody there to hear it is no fault.
    pub fn answer(&self, asker: SocketAddr, packet: &[u8]) {
        if !packet.is_empty() {
            let _ = self.socket.send_to(packet, self.reply.unwrap_or(asker));
        }
    }

    /// Answers `/freshet/error`, but not to a flood.
    pub fn refuse(&self, asker: SocketAddr, address: &str, text: &str) {
        let mut errors = self.errors.lock().unwrap_or_else(PoisonError::into_inner);
        if errors.take().is_some() {
            self.answer(asker, &osc::error(address, text));
        }
    }

    /// Hears until `stop`.
    pub fn listen(&self, queue: &Queue, log: &Arc<Log>, stop: &AtomicBool) {
        let mut buffer = vec![0; DATAGRAM];
        while !stop.load(Ordering::Relaxed) {
            match self.socket.recv_from(&mut buffer) {
                Ok((count, asker)) => self.hear(&buffer[..count], asker, queue, log),
                Err(error) => {
                    use std::io::ErrorKind::{ConnectionReset, Interrupted, TimedOut, WouldBlock};
                    // On Windows an answer that nobody took comes back as a reset.
                    if !matches!(
                        error.kind(),
                        ConnectionReset | Interrupted | TimedOut | WouldBlock
                    ) {
                        log.complain(&format!("OSC: {error}"));
                        std::thread::sleep(LOOK);
                    }
                }
            }
        }
    }

    fn hear(&self, packet: &[u8], asker: SocketAddr, queue: &Queue, log: &Log) {
        let (wishes, problems) = osc::read(packet);
        if !wishes.is_empty() && queue.push(wishes, Some(asker)) > 0 {
            let text = "too many at once; some were left out";
            log.complain(&format!("OSC from {asker}: {text}"));
            self.refuse(asker, "", text);
        }
        for problem in problems {
            let osc::Problem { address, text } = problem;
            let blank = if address.is_empty() { "" } else { " " };
            log.complain(&format!("OSC from {asker}: {address}{blank}{text}"));
            self.refuse(asker, &address, &text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_as_people_write_them() {
        for (text, wanted) in [
            ("9001", "127.0.0.1:9001"),
            (":9001", "127.0.0.1:9001"),
            ("localhost:9001", "127.0.0.1:9001"),
            ("0.0.0.0", "0.0.0.0:9000"),
            ("192.168.1.5:8000", "192.168.1.5:8000"),
            ("[::1]:9000", "[::1]:9000"),
        ] {
            assert_eq!(address(text).unwrap(), wanted.parse().unwrap());
        }
        for text in ["", "99999", "/dev/ttyACM0", "example.org:9000"] {
            assert!(address(text).is_err(), "{text}");
        }
    }
}
