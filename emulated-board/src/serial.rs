//! The far end of the serial line: a terminal on USART2.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use crate::record::Shared;

/// What types and reads. Bytes it is given go out one after the other as fast as the receiver's
/// programmed rate takes them.
#[derive(Debug)]
pub(crate) struct Terminal {
    record: Shared,
    typed: VecDeque<u8>,
}

impl Terminal {
    pub(crate) fn new(record: Shared) -> Self {
        Self {
            record,
            typed: VecDeque::new(),
        }
    }

    /// Types `bytes`.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        self.typed.extend(bytes);
    }
}

impl Store for Terminal {}

impl Peer for Terminal {
    fn receive(&mut self, word: u16, _context: &mut Timeline<'_, '_>) {
        self.record.lock().sent.push((word & 0xFF) as u8);
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.typed.pop_front().map(u16::from)
    }
}
