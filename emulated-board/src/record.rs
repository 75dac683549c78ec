//! What the outside world sees and hears of a board, kept for whoever asks.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::i2s::AudioFormat;

/// A change of one of the board's lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LedChange {
    /// When, since power-on.
    pub at: Duration,
    /// Which, counted from 0 in the board's order.
    pub led: usize,
    /// Whether it went on.
    pub on: bool,
}

/// A stretch of audio without a gap: from the I2S starting to its stopping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stream {
    /// How many frames the board had sent before.
    pub first_frame: u64,
    /// When the first slot of the first frame began, since power-on.
    pub start: Duration,
    /// Frames a second, from the clock registers as they stood.
    pub sample_rate: f64,
    /// How the samples were sent.
    pub format: AudioFormat,
}

impl Stream {
    /// When frame `frame`, counted from power-on, began to leave; it has to be of this stretch.
    pub fn time(&self, frame: u64) -> Duration {
        let frames = frame.saturating_sub(self.first_frame) as f64;
        match self.sample_rate > 0.0 {
            true => self.start + Duration::from_secs_f64(frames / self.sample_rate),
            false => self.start,
        }
    }
}

/// Everything recorded so far.
#[derive(Debug, Default)]
pub(crate) struct Record {
    pub(crate) audio: Vec<[i32; 2]>,
    pub(crate) frames: u64,
    pub(crate) streams: Vec<Stream>,
    pub(crate) first_sound: Option<Duration>,
    pub(crate) underruns: u64,
    pub(crate) led_changes: Vec<LedChange>,
    pub(crate) leds: Vec<bool>,
    pub(crate) sent: Vec<u8>,
}

/// The record, shared between the models that write it and the board that reads it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Shared(Arc<Mutex<Record>>);

impl Shared {
    /// The record. A model that panicked left it whole: nothing in it spans two writes.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Record> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
