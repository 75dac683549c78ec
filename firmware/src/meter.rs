//! How long a block takes, in cycles of the core.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::DWT;

/// Cycles of one thing, from its begin to its end.
pub struct Meter {
    last: AtomicU32,
    peak: AtomicU32,
}

impl Meter {
    /// Nothing measured yet.
    pub const fn new() -> Self {
        Self {
            last: AtomicU32::new(0),
            peak: AtomicU32::new(0),
        }
    }

    /// Runs `work` and measures it.
    #[inline(always)]
    pub fn measure<T>(&self, work: impl FnOnce() -> T) -> T {
        let begin = DWT::cycle_count();
        let result = work();
        let cycles = DWT::cycle_count().wrapping_sub(begin);
        self.last.store(cycles, Relaxed);
        self.peak.fetch_max(cycles, Relaxed);
        result
    }

    /// Cycles of the last one, and of the longest since the start.
    pub fn read(&self) -> (u32, u32) {
        (self.last.load(Relaxed), self.peak.load(Relaxed))
    }
}

/// Starts the core's cycle counter.
pub fn start() {
    if let Some(mut core) = cortex_m::Peripherals::take() {
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
    }
}
