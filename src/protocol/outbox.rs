//! Bytes on their way out: a queue that never waits.

use heapless::Deque;

/// Bytes that wait to be sent, at most `N`.
#[derive(Debug, Default)]
pub struct Outbox<const N: usize> {
    bytes: Deque<u8, N>,
    dropped: u32,
}

impl<const N: usize> Outbox<N> {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            bytes: Deque::new(),
            dropped: 0,
        }
    }

    /// Bytes that still fit.
    pub fn room(&self) -> usize {
        N - self.bytes.len()
    }

    /// Takes all of `bytes`, or nothing of them, which is counted.
    pub fn put(&mut self, bytes: &[u8]) {
        if bytes.len() > self.room() {
            return self.drop_one();
        }
        for byte in bytes {
            // There is room.
            let _ = self.bytes.push_back(*byte);
        }
    }

    /// Counts a reply that was not even written, for want of room.
    pub fn drop_one(&mut self) {
        self.dropped = self.dropped.wrapping_add(1);
    }

    /// Moves up to all of `out` out; returns how many bytes.
    pub fn take(&mut self, out: &mut [u8]) -> usize {
        let mut count = 0;
        for place in out {
            match self.bytes.pop_front() {
                Some(byte) => *place = byte,
                None => break,
            }
            count += 1;
        }
        count
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Replies that found no room.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}
