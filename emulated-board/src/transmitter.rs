//! What the I2S of every part have in common: slots that leave at the rate of the registers, a buffer
//! that DMA fills, underruns, and the frames a DAC on the pins would hear.
//!
//! The slot a word leaves in is counted from the enable and nothing ever resynchronises it, so
//! firmware that loses a word hears its channels, or the halves of its samples, swapped: as on the
//! chip.
//!
//! While DMA keeps up, slots are carried out a batch at a time, at the instant of the last: a stop of
//! the emulator for each would make it several times slower. DMA then reads memory late by up to a
//! batch, and nothing else moves: samples keep their order and, where the halves of the buffer are
//! whole batches, the half and complete interrupts their instants.

use std::collections::VecDeque;
use std::time::Duration;

use rigless::device::DeviceContext;
use rigless::time::{EventId, VirtualNanos};

use crate::i2s::AudioFormat;
use crate::record::{Shared, Stream};

/// Picoseconds times millihertz in a second of a hertz: what turns clocks at a rate in millihertz
/// into nanoseconds.
const NANOS_AT_MILLIHERTZ: u128 = 1_000_000_000_000;

/// How a part transmits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    /// Words its buffer holds.
    pub(crate) depth: usize,
    /// Words of a batch.
    pub(crate) batch: u64,
    /// The channel's sample from its words.
    pub(crate) sample: fn(&AudioFormat, &[u32]) -> i32,
}

/// Words going out.
#[derive(Debug, Clone, Copy)]
struct Running {
    /// When slot 0 since the last change of clock began.
    base: u64,
    /// Slots begun since.
    slots: u64,
    /// Slots to be begun by the instant `asked`: more than `slots` while DMA is still to feed them.
    wanted: u64,
    asked: VirtualNanos,
}

impl Running {
    fn behind(&self) -> bool {
        self.slots < self.wanted
    }
}

/// A transmitter, sending into the record.
#[derive(Debug)]
pub(crate) struct Transmitter {
    record: Shared,
    shape: Shape,
    /// The kernel clock, mHz.
    kernel_mhz: u64,
    /// Words written and not begun.
    buffer: VecDeque<u32>,
    /// The word in the shift register, sent again after an underrun.
    shifting: u32,
    running: Option<Running>,
    enabled: bool,
    /// Disabled, once what was due before has left.
    stopping: bool,
    /// DMA feeds the buffer.
    dma: bool,
    /// It keeps up, so slots go in batches.
    fed: bool,
    format: AudioFormat,
    /// Words of a channel.
    words: usize,
    /// Kernel clock cycles of a slot.
    slot_cycles: u64,
    /// The frame being sent, and how many of its words have left.
    frame: [u32; 4],
    sent: usize,
    event: Option<EventId>,
    underrun: bool,
}

impl Transmitter {
    pub(crate) fn new(record: Shared, shape: Shape) -> Self {
        Self {
            record,
            shape,
            kernel_mhz: 0,
            buffer: VecDeque::with_capacity(shape.depth),
            shifting: 0,
            running: None,
            enabled: false,
            stopping: false,
            dma: false,
            fed: false,
            format: AudioFormat::default(),
            words: 1,
            slot_cycles: 0,
            frame: [0; 4],
            sent: 0,
            event: None,
            underrun: false,
        }
    }

    /// The part was reset: everything but the clock, which its tree drives.
    pub(crate) fn reset(&mut self) {
        *self = Self {
            kernel_mhz: self.kernel_mhz,
            ..Self::new(self.record.clone(), self.shape)
        };
    }

    /// Whether it wants a word, now or to catch up.
    pub(crate) fn has_room(&self) -> bool {
        self.buffer.len() < self.shape.depth
    }

    /// Whether words are due that DMA has not brought yet.
    pub(crate) fn behind(&self) -> bool {
        self.running.is_some_and(|running| running.behind())
    }

    /// Whether words leave.
    pub(crate) fn running(&self) -> bool {
        self.running.is_some()
    }

    /// Whether it is switched on.
    pub(crate) fn enabled(&self) -> bool {
        self.enabled
    }

    /// Whether a slot began without a word since this was last cleared.
    pub(crate) fn underrun(&self) -> bool {
        self.underrun
    }

    /// Clears [`Transmitter::underrun`].
    pub(crate) fn clear_underrun(&mut self) {
        self.underrun = false;
    }

    /// Whether the next word written belongs to the right channel.
    pub(crate) fn right_is_next(&self, now: VirtualNanos) -> bool {
        let due = self.running.map_or(0, |running| {
            self.slots_by(running.base, now)
                .saturating_sub(running.slots)
        });
        let next = self.sent as u64 + due + self.buffer.len() as u64;
        next % self.frame_words() as u64 >= self.words as u64
    }

    /// Catches up with `now`: whatever was due before and never came is an underrun.
    pub(crate) fn look(&mut self, now: VirtualNanos) {
        if self.running.is_some_and(|running| running.asked < now) {
            self.give_up();
        }
    }

    /// Has what is due by `now` leave under the settings as they are, before they change.
    pub(crate) fn settle(&mut self, now: VirtualNanos) {
        self.look(now);
        if let Some(running) = self.running {
            self.want(self.slots_by(running.base, now), now);
        }
    }

    /// DMA feeds the buffer from here on, or no longer.
    pub(crate) fn set_dma(&mut self, dma: bool, context: &mut DeviceContext<'_>) {
        if dma != self.dma {
            self.dma = dma;
            self.fed = dma;
            self.schedule(context);
        }
    }

    /// Switches on, sending `format` with `words` words a channel and `frame_cycles` kernel clocks a
    /// frame, from the first word there is.
    pub(crate) fn enable(
        &mut self,
        format: AudioFormat,
        words: usize,
        frame_cycles: u64,
        context: &mut DeviceContext<'_>,
    ) {
        self.enabled = true;
        self.stopping = false;
        self.format = format;
        self.words = words;
        self.slot_cycles = frame_cycles / self.frame_words() as u64;
        if !self.buffer.is_empty() && self.running.is_none() {
            self.start(context);
        }
    }

    /// Switches off; what is in the buffer stays there unless `flush`.
    pub(crate) fn disable(&mut self, flush: bool) {
        self.stopping = self.enabled;
        self.stop_when_due();
        if flush {
            self.buffer.clear();
        }
    }

    /// A word is written into the buffer.
    pub(crate) fn push(&mut self, word: u32, context: &mut DeviceContext<'_>) {
        self.look(context.now());
        if !self.has_room() {
            self.buffer.pop_back();
        }
        self.buffer.push_back(word);
        if self.enabled && self.running.is_none() {
            self.start(context);
        } else {
            self.advance();
        }
    }

    /// Carries out what is due if `event` is the one asked for.
    pub(crate) fn on_event(&mut self, event: EventId, context: &mut DeviceContext<'_>) {
        if self.event != Some(event) {
            return;
        }
        let now = context.now();
        let missed = self.behind();
        self.settle(now);
        // After a slot that DMA did feed, the rest may go in batches again.
        self.fed = self.dma && !missed && !self.underrun;
        self.schedule(context);
    }

    /// The kernel clock runs at `mhz` millihertz from here on.
    pub(crate) fn on_clock(&mut self, mhz: u64, context: &mut DeviceContext<'_>) {
        let now = context.now();
        self.settle(now);
        self.kernel_mhz = mhz;
        if let Some(running) = &mut self.running {
            let due = running.wanted - running.slots;
            *running = Running {
                base: now.0,
                slots: 1,
                wanted: 1 + due,
                asked: now,
            };
        }
        self.schedule(context);
    }

    fn frame_words(&self) -> usize {
        2 * self.words
    }

    /// When slot `slot` begins, or `None` while nothing clocks it.
    fn slot_time(&self, base: u64, slot: u64) -> Option<VirtualNanos> {
        if self.kernel_mhz == 0 || self.slot_cycles == 0 {
            return None;
        }
        let cycles = u128::from(slot) * u128::from(self.slot_cycles);
        let nanos = cycles * NANOS_AT_MILLIHERTZ / u128::from(self.kernel_mhz);
        Some(VirtualNanos(base + u64::try_from(nanos).ok()?))
    }

    /// How many slots have begun by `now`.
    fn slots_by(&self, base: u64, now: VirtualNanos) -> u64 {
        let span = NANOS_AT_MILLIHERTZ * u128::from(self.slot_cycles);
        if span == 0 {
            return 0;
        }
        // Slot times are rounded down: the slot that begins within this nanosecond has begun.
        let elapsed = u128::from(now.0.saturating_sub(base) + 1) * u128::from(self.kernel_mhz);
        u64::try_from(elapsed.div_ceil(span)).unwrap_or(u64::MAX)
    }

    fn start(&mut self, context: &mut DeviceContext<'_>) {
        let at = context.now();
        let frame_cycles = self.slot_cycles * self.frame_words() as u64;
        let stream = Stream {
            first_frame: self.record.lock().frames,
            start: Duration::from_nanos(at.0),
            sample_rate: match frame_cycles {
                0 => 0.0,
                cycles => self.kernel_mhz as f64 / 1000.0 / cycles as f64,
            },
            format: self.format,
        };
        self.record.lock().streams.push(stream);
        self.fed = self.dma;
        self.running = Some(Running {
            base: at.0,
            slots: 0,
            wanted: 1,
            asked: at,
        });
        self.advance();
        self.schedule(context);
    }

    fn stop_when_due(&mut self) {
        if self.stopping && !self.behind() {
            self.stopping = false;
            self.enabled = false;
            self.running = None;
            self.event = None;
            self.sent = 0;
        }
    }

    /// Asks to be woken for the next slot, or the last of the next batch.
    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        self.event = self.running.and_then(|running| {
            let next = if self.fed {
                // The batch ends where DMA has brought whole batches: the buffer's words and the
                // one that leaves are ahead of the slot that begins.
                let ahead = self.shape.depth as u64 + 1;
                (running.wanted + ahead + 1).next_multiple_of(self.shape.batch) - ahead
            } else {
                running.wanted
            };
            Some(context.schedule(self.slot_time(running.base, next)?))
        });
    }

    /// Wants `slots` slots to have begun.
    fn want(&mut self, slots: u64, now: VirtualNanos) {
        if let Some(running) = &mut self.running {
            running.wanted = running.wanted.max(slots);
            running.asked = now;
        }
        self.advance();
        // Nothing but DMA answers at the instant it is asked.
        if !self.dma {
            self.give_up();
        }
    }

    /// Carries out the slots wanted as far as there are words for them.
    fn advance(&mut self) {
        while self.behind() {
            let Some(word) = self.buffer.pop_front() else {
                return;
            };
            self.shifting = word;
            self.slot();
        }
        self.stop_when_due();
    }

    /// The slots wanted and not fed go by.
    fn give_up(&mut self) {
        while self.behind() {
            self.fed = false;
            self.underrun = true;
            self.record.lock().underruns += 1;
            self.slot();
        }
        self.stop_when_due();
    }

    /// A slot begins with what is in the shift register.
    fn slot(&mut self) {
        let Some(running) = &mut self.running else {
            return;
        };
        let (base, slot) = (running.base, running.slots);
        running.slots += 1;
        self.frame[self.sent] = self.shifting;
        self.sent += 1;
        if self.sent == self.frame_words() {
            self.sent = 0;
            self.finish_frame(self.slot_time(base, slot));
        }
    }

    fn finish_frame(&mut self, at: Option<VirtualNanos>) {
        let (left, right) = self.frame.split_at(self.words);
        let sample = |words: &[u32]| (self.shape.sample)(&self.format, &words[..self.words]);
        let frame = [sample(left), sample(right)];
        let mut record = self.record.lock();
        record.audio.push(frame);
        record.frames += 1;
        if record.first_sound.is_none() && frame != [0, 0] {
            record.first_sound = at.map(|at| Duration::from_nanos(at.0));
        }
    }
}
