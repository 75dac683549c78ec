//! The wires of the board: from the pins to the lights and the codec's reset, and from the
//! peripherals' interrupts to the core, where a fault can cut one for a while.

use std::time::Duration;

use rigless::device::{Device, DeviceContext, InterruptChange, Level, RegisterFile, RequestChange};
use rigless::emulator::InterruptLine;
use rigless::soc::{Access, Layout, Peripheral, ReadAction, RegisterSpec, Width, WriteModify};
use rigless::time::{EventId, VirtualNanos};

use crate::codec::Codec;
use crate::exti::port_of;
use crate::record::{LedChange, Shared};

/// One past the highest interrupt of the parts emulated here.
const LINES: usize = 256;

/// A pin: the port counted from 0 for A, and its number.
pub(crate) type PinName = (usize, usize);

static REGISTERS: [RegisterSpec; 1] = [RegisterSpec {
    name: "NONE",
    offset: 0,
    width: Width::W32,
    reset: 0,
    access: Access::ReadOnly,
    read: ReadAction::None,
    write: WriteModify::None,
    fields: &[],
}];

/// A register no firmware knows of, since rigless reaches a model through an instance on the bus.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoRegister;

impl Layout for NoRegister {
    const REGISTERS: &'static [RegisterSpec] = &REGISTERS;

    fn from_index(index: usize) -> Option<Self> {
        (index == 0).then_some(Self)
    }

    fn index(self) -> usize {
        0
    }
}

/// The instance, at an address RM0090 reserves.
pub(crate) const INSTANCE: Peripheral = Peripheral {
    name: "WIRES",
    base: 0x5FFF_F000,
    size: 4,
    interrupts: &[],
    registers: &REGISTERS,
};

/// The wires.
#[derive(Debug)]
pub(crate) struct Wires {
    record: Shared,
    leds: &'static [PinName],
    /// What lights one.
    lit: Level,
    codec: Codec,
    codec_reset: Option<PinName>,
    /// What the peripherals drive on each line.
    driven: [Level; LINES],
    /// Lines cut, and the event that mends each.
    cut: Vec<(u16, EventId)>,
}

impl Wires {
    pub(crate) fn new(
        record: Shared,
        leds: &'static [PinName],
        lit: Level,
        codec: Codec,
        codec_reset: Option<PinName>,
    ) -> Self {
        record.lock().leds = vec![false; leds.len()];
        Self {
            record,
            leds,
            lit,
            codec,
            codec_reset,
            driven: [Level::Low; LINES],
            cut: Vec::new(),
        }
    }

    /// The part restarted at `at`: its pins let go, and the lights go out.
    pub(crate) fn restarted(&mut self, at: VirtualNanos) {
        self.reset();
        let at = Duration::from_nanos(at.0);
        let mut record = self.record.lock();
        for led in 0..self.leds.len() {
            if std::mem::take(&mut record.leds[led]) {
                record.led_changes.push(LedChange { at, led, on: false });
            }
        }
    }

    /// A pin of a port changed at `at`.
    pub(crate) fn pin(&mut self, change: RequestChange, at: VirtualNanos) {
        let Some(port) = port_of(change.instance) else {
            return;
        };
        let pin = (port, change.request);
        let at = Duration::from_nanos(at.0);
        if let Some(led) = self.leds.iter().position(|led| *led == pin) {
            let on = change.level == self.lit;
            let mut record = self.record.lock();
            if record.leds[led] != on {
                record.leds[led] = on;
                record.led_changes.push(LedChange { at, led, on });
            }
        }
        if self.codec_reset == Some(pin) {
            self.codec.reset_pin(change.level == Level::High, at);
        }
    }

    /// Cuts the line of interrupt `line` until `until`.
    pub(crate) fn cut(&mut self, line: u16, until: VirtualNanos, context: &mut DeviceContext<'_>) {
        self.cut.retain(|(other, _)| *other != line);
        let event = context.schedule(until);
        self.cut.push((line, event));
        drive(line, Level::Low, context);
    }
}

fn drive(line: u16, level: Level, context: &mut DeviceContext<'_>) {
    if let Some(line) = InterruptLine::new(line) {
        context.drive_line(line, level);
    }
}

impl Device for Wires {
    type Register = NoRegister;

    fn on_request(
        &mut self,
        change: RequestChange,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.pin(change, context.now());
    }

    fn on_interrupt(
        &mut self,
        change: InterruptChange,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if let Some(driven) = self.driven.get_mut(usize::from(change.interrupt)) {
            *driven = change.level;
        }
        if self.cut.iter().all(|(line, _)| *line != change.interrupt) {
            drive(change.interrupt, change.level, context);
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let driven = &self.driven;
        self.cut.retain(|(line, mends)| {
            if *mends == event {
                let level = driven.get(usize::from(*line)).copied();
                drive(*line, level.unwrap_or_default(), context);
            }
            *mends != event
        });
    }

    fn reset(&mut self) {
        self.driven = [Level::Low; LINES];
        self.cut.clear();
    }
}
