//! A pseudo-terminal: one end is ours, the other a port that any program can open.

use std::io;
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, fcntl_setfl, open};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};

/// How often the port is freed for the next program, whatever became of the one before.
const FREED: Duration = Duration::from_secs(1);

/// Our end of a pseudo-terminal.
pub struct Pty {
    ours: OwnedFd,
    /// Kept open, so that the port stays as it is when a program leaves it.
    theirs: OwnedFd,
    path: String,
    freed: Instant,
}

impl Pty {
    /// A new pseudo-terminal whose port passes all bytes as they are.
    pub fn open() -> Result<Self> {
        let all = || -> rustix::io::Result<_> {
            let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
            grantpt(&ours)?;
            unlockpt(&ours)?;
            let path = ptsname(&ours, Vec::new())?;
            let flags = OFlags::RDWR | OFlags::NOCTTY;
            let theirs = open(&path, flags, Mode::empty())?;
            let mut settings = tcgetattr(&theirs)?;
            settings.make_raw();
            tcsetattr(&theirs, OptionalActions::Now, &settings)?;
            fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
            Ok((ours, theirs, path))
        };
        let (ours, theirs, path) = all()
            .map_err(io::Error::from)
            .context("the system gives no pseudo-terminal")?;
        Ok(Self {
            ours,
            theirs,
            path: path.to_string_lossy().into_owned(),
            freed: Instant::now(),
        })
    }

    /// The path of the port.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Waits for bytes, at most `timeout`; returns how many came.
    pub fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize> {
        if self.freed.elapsed() > FREED {
            self.freed = Instant::now();
            // A program that was killed leaves the port locked to all others.
            let _ = ioctl_tiocnxcl(&self.theirs);
        }
        let timeout = Timespec {
            tv_sec: timeout.as_secs().try_into().unwrap_or(1),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        let mut polled = [PollFd::new(&self.ours, PollFlags::IN)];
        match poll(&mut polled, Some(&timeout)) {
            Ok(0) | Err(Errno::INTR) => return Ok(0),
            Ok(_) => {}
            Err(error) => return Err(io::Error::from(error).into()),
        }
        match rustix::io::read(&self.ours, buffer) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(io::Error::from(error).into()),
        }
    }

    /// Writes what fits now; returns how many bytes that were.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        match rustix::io::write(&self.ours, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(io::Error::from(error).into()),
        }
    }
}
