//! What can go wrong between a program and a board.

use std::time::Duration;

/// Why a [`Client`](super::Client) did not get what it asked for. Each text is a whole sentence for people: it names
/// the port and says what to look at.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The port cannot be opened.
    #[error("cannot open {port}: {reason}")]
    Open {
        /// Its path.
        port: String,
        /// Why, and what to do about it.
        reason: String,
    },
    /// The port was there, and is no more.
    #[error("{port} is gone ({reason}); is the board still plugged in?")]
    Gone {
        /// Its path.
        port: String,
        /// What the system says.
        reason: String,
    },
    /// Nothing came back, or nothing that is freshet's.
    #[error(
        "{port}: no answer within {within:?}{}; is it the board's port, is the cable in, is the baud rate right, is another program reading?",
        if *.heard == 0 { String::new() } else { format!(", only {heard} bytes of something else") }
    )]
    Timeout {
        /// Its path.
        port: String,
        /// How long was waited.
        within: Duration,
        /// Bytes that came meanwhile and were no answer.
        heard: usize,
    },
    /// What came back was damaged on the way, several times where asking again is harmless. Whether a board did what it
    /// was asked is then not known.
    #[error(
        "{port}: the answer was damaged on the way; is the cable sound, is the baud rate right?"
    )]
    Damaged {
        /// Its path.
        port: String,
    },
    /// The board refused. In its own words.
    #[error("{0}")]
    Refused(String),
    /// Some parameters of a request were refused; the others were set.
    #[error("{}; the rest was set at {at}", .refused.join("; "))]
    Partly {
        /// In the board's words, one each.
        refused: Vec<String>,
        /// The frame from which on the others are heard.
        at: u64,
    },
    /// The board's parameters or messages are not those of this version of freshet.
    #[error(
        "{port}: the board is of another freshet ({theirs}, this is {ours}); flash it anew, or use the freshet that it was flashed with (`freshet send` talks to any)"
    )]
    Version {
        /// Its path.
        port: String,
        /// Version and schema of the board.
        theirs: String,
        /// Version and schema here.
        ours: String,
    },
}
