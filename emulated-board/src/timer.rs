//! A general-purpose timer of rigless, less some flags.
//!
//! rigless raises a channel's compare flag when software sets a counter that stands still (`CEN`
//! clear) to the channel's value, by a write of `CNT` or by `EGR.UG`. embassy's time driver starts that
//! way, clears no flag, and would then count half a period too many and ring alarms a whole wrap
//! late. On the chips it does not, so the flags do not come.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::tim2::{Register, cr1, egr, sr};
use rigless::soc::stm32f427::peripherals::tim::{Counter, General, Tim};
use rigless::soc::{FieldSpec, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

/// Each channel's flag, and the bit of `EGR` that asks for it by name.
const FLAGS: [(&FieldSpec, &FieldSpec); 4] = [
    (sr::CC1IF, egr::CC1G),
    (sr::CC2IF, egr::CC2G),
    (sr::CC3IF, egr::CC3G),
    (sr::CC4IF, egr::CC4G),
];

/// The timer.
#[derive(Debug)]
pub(crate) struct Timer(Tim<General>);

impl Timer {
    /// A timer counting at `hz` until the clock tree says otherwise.
    pub(crate) fn new(hz: u64, counter: Counter) -> Self {
        Self(Tim::with_clock(hz, counter))
    }
}

impl Device for Timer {
    type Register = Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        self.0.layout()
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.0.read(register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.0.peek(register, registers, now)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let before = registers.get(Register::Sr);
        self.0.write(register, value, registers, context);
        let stands = !cr1::CEN.is_set(registers.get(Register::Cr1));
        let forced = match register {
            Register::Cnt => 0,
            Register::Egr => value,
            _ => return,
        };
        if stands {
            let kept = FLAGS
                .iter()
                .filter(|(_, asked)| !asked.is_set(forced))
                .fold(0, |mask, (flag, _)| mask | flag.mask());
            registers.restore(Register::Sr, kept, before);
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.0.on_event(event, registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.0.on_request(change, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.0.on_clock(hz, registers, context);
    }

    fn reset(&mut self) {
        self.0.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.0.reset_line(registers, context);
    }
}
