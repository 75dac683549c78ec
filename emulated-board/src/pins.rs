//! What hears the pins of an STM32H743: its external interrupts, and the board.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::RegisterSpec;
use rigless::soc::stm32h743::generated::exti;
use rigless::soc::stm32h743::peripherals::exti::Exti;
use rigless::time::{EventId, VirtualNanos};

use crate::wires::Wires;

/// The external interrupts, which hear every pin, and the board's wires beside them.
#[derive(Debug)]
pub(crate) struct Pins {
    pub(crate) exti: Exti,
    pub(crate) wires: Wires,
}

impl Device for Pins {
    type Register = exti::Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        self.exti.layout()
    }

    fn read(
        &mut self,
        register: exti::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.exti.read(register, registers, context)
    }

    fn peek(
        &self,
        register: exti::Register,
        registers: &RegisterFile,
        now: VirtualNanos,
    ) -> Option<u64> {
        self.exti.peek(register, registers, now)
    }

    fn write(
        &mut self,
        register: exti::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.exti.write(register, value, registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.exti.on_event(event, registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.wires.pin(change, context.now());
        self.exti.on_request(change, registers, context);
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.exti.on_access(token, value, registers, context);
    }

    fn on_refused(
        &mut self,
        token: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.exti.on_refused(token, registers, context);
    }
}
