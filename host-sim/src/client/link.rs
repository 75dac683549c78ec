//! How bytes get to a board and back.

use std::io::{self, Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use freshet::{Frame, TICK};
use serialport::{ClearBuffer, ErrorKind, SerialPort};

use super::Error;
use crate::twin::Twin;

/// Bytes to a board and back.
pub trait Link: Send {
    /// Sends all of `bytes`. An error means that the link is gone for good, but for [`io::ErrorKind::TimedOut`]:
    /// nobody takes them.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Waits for bytes, at most `timeout`; returns how many came, 0 where none did. An error means that the link is gone.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;
    /// What to call it in messages.
    fn name(&self) -> &str;
}

/// Longest time to get rid of a request.
const WRITE: Duration = Duration::from_secs(1);
/// Bytes written at once: a terminal that says it has room has room for so many.
const CHUNK: usize = 64;

/// A serial port.
pub struct Serial {
    port: Box<dyn SerialPort>,
    name: String,
}

impl Serial {
    /// Opens the port of that path or name, for this program alone. What waited in it unread is thrown away.
    pub fn open(path: &str, baud: u32) -> Result<Self, Error> {
        // A pseudo-terminal of a Mac knows no baud rate.
        let pseudo = cfg!(target_os = "macos") && path.starts_with("/dev/ttys");
        let port = serialport::new(path, if pseudo { 0 } else { baud })
            .timeout(WRITE)
            .open()
            .map_err(|error| Error::Open {
                port: path.to_owned(),
                reason: reason(&error),
            })?;
        // Whoever cannot do that only has more to skip.
        let _ = port.clear(ClearBuffer::Input);
        Ok(Self {
            port,
            name: path.to_owned(),
        })
    }
}

/// Why a port cannot be opened, and what to do.
fn reason(error: &serialport::Error) -> String {
    match error.kind() {
        ErrorKind::NoDevice => "another program has it, or the board is gone".to_owned(),
        ErrorKind::Io(io::ErrorKind::NotFound) => format!("there is no such port; {}", ports()),
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            "this user may not (on Linux: add it to the group dialout, and log in again)".to_owned()
        }
        _ => format!("that is no serial port ({error}); {}", ports()),
    }
}

/// The ports there are, for people.
fn ports() -> String {
    let ports = serialport::available_ports().unwrap_or_default();
    let names: Vec<String> = ports.into_iter().map(|port| port.port_name).collect();
    if names.is_empty() {
        "none was found here (is the board plugged in?)".to_owned()
    } else {
        format!("here are {}", names.join(", "))
    }
}

impl Link for Serial {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.set_timeout(WRITE)?;
        bytes
            .chunks(CHUNK)
            .try_for_each(|chunk| self.port.write_all(chunk))
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.port.set_timeout(timeout)?;
        match self.port.read(buffer) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(error) if is_nothing(&error) => Ok(0),
            other => other,
        }
    }
    fn name(&self) -> &str {
        &self.name
    }
}

/// Whether that only says that nothing has come yet.
fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | Interrupted | WouldBlock)
}

/// A twin in this very program, whose time passes only while its answers are waited for: for tests.
impl Link for Twin {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.receive(bytes);
        Ok(())
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let mut left = timeout;
        loop {
            let count = self.take_into(buffer);
            if count > 0 || left.is_zero() {
                return Ok(count);
            }
            self.render(&mut [Frame::ZERO; TICK]);
            left = left.saturating_sub(self.tick_time());
        }
    }
    fn name(&self) -> &str {
        "the twin"
    }
}

/// A twin that somebody else renders, a sound card for instance.
impl Link for Arc<Mutex<Twin>> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        locked(self).receive(bytes);
        Ok(())
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let until = Instant::now() + timeout;
        loop {
            let count = locked(self).take_into(buffer);
            if count > 0 || Instant::now() >= until {
                return Ok(count);
            }
            thread::sleep(Duration::from_millis(1));
        }
    }
    fn name(&self) -> &str {
        "the twin"
    }
}

fn locked(twin: &Mutex<Twin>) -> MutexGuard<'_, Twin> {
    twin.lock().unwrap_or_else(PoisonError::into_inner)
}
