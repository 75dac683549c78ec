//! The independent watchdog of an STM32H743, RM0433 chapter 45, which rigless leaves out.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::iwdg::Register as R;
use rigless::soc::stm32h743::peripherals::rcc::IWDG_STARTED;
use rigless::time::{EventId, VirtualNanos};

/// 45.4.1.
const UNLOCK: u64 = 0x5555;
const START: u64 = 0xCCCC;
const RELOAD: u64 = 0xAAAA;
/// The counter's and the window's reset value.
const FULL: u64 = 0xFFF;

/// The watchdog. Its registers cross into its clock domain at once, so `SR` never shows an update.
#[derive(Debug)]
pub(crate) struct Watchdog {
    clock_hz: u64,
    started: bool,
    unlocked: bool,
    /// When the counter was loaded, and with what.
    loaded: (VirtualNanos, u64),
    /// What the registers hold when they are locked.
    kept: [(R, u64); 3],
    expiry: Option<EventId>,
}

impl Default for Watchdog {
    fn default() -> Self {
        Self {
            clock_hz: 0,
            started: false,
            unlocked: false,
            loaded: (VirtualNanos(0), FULL),
            kept: [(R::Pr, 0), (R::Rlr, FULL), (R::Winr, FULL)],
            expiry: None,
        }
    }
}

impl Watchdog {
    fn tick_nanos(&self, registers: &RegisterFile) -> Option<u64> {
        let divider = 4u64 << registers.get(R::Pr).min(6);
        (1_000_000_000 * divider).checked_div(self.clock_hz)
    }

    fn schedule(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let (at, count) = self.loaded;
        let tick = self.tick_nanos(registers).filter(|_| self.started);
        self.expiry = tick.map(|tick| context.schedule(VirtualNanos(at.0 + tick * (count + 1))));
    }

    fn load(&mut self, count: u64, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        self.loaded = (context.now(), count);
        self.schedule(registers, context);
    }

    /// 45.3.2: a reload while the counter is above the window resets the part.
    fn too_early(&self, registers: &RegisterFile, now: VirtualNanos) -> bool {
        let (at, count) = self.loaded;
        let gone = self
            .tick_nanos(registers)
            .and_then(|tick| (now.0 - at.0).checked_div(tick))
            .unwrap_or(0);
        count.saturating_sub(gone) > registers.get(R::Winr)
    }
}

impl Device for Watchdog {
    type Register = R;

    fn write(
        &mut self,
        register: R,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register != R::Kr {
            for (name, kept) in &mut self.kept {
                if *name == register && self.unlocked {
                    *kept = registers.get(register);
                } else if *name == register {
                    registers.set(register, *kept);
                }
            }
            self.schedule(registers, context);
            return;
        }
        let key = value & 0xFFFF;
        self.unlocked = key == UNLOCK;
        match key {
            START if !self.started => {
                self.started = true;
                context.request(IWDG_STARTED, Level::High);
                self.load(FULL, registers, context);
            }
            RELOAD if self.started && self.too_early(registers, context.now()) => {
                context.request_reset();
            }
            RELOAD if self.started => self.load(registers.get(R::Rlr), registers, context),
            _ => {}
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.expiry == Some(event) {
            context.request_reset();
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.clock_hz = hz;
        self.load(self.loaded.1, registers, context);
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
