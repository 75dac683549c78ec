//! The external interrupts and the pin selection they read (RM0090 chapters 9 and 12), which rigless
//! leaves out of its STM32F4.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::{exti, syscfg};

/// Pins a port has.
const PINS: usize = 16;
/// The first of the ports' names, `GPIOA`; the others follow in the order of `EXTICR`.
const PORT: &str = "GPIO";
/// Each group of lines and its place in the instance's interrupts, which begin with the tamper's.
const GROUPS: [(u64, usize); 7] = [
    (1 << 0, 1),
    (1 << 1, 2),
    (1 << 2, 3),
    (1 << 3, 4),
    (1 << 4, 5),
    (0b1_1111 << 5, 6),
    (0b11_1111 << 10, 7),
];

/// Which port each line listens to, 0 for A: written by [`Syscfg`], read by [`Exti`].
pub(crate) type Selection = Arc<[AtomicU8; PINS]>;

/// The system configuration controller, as far as the pin selection.
#[derive(Debug, Default)]
pub(crate) struct Syscfg {
    selection: Selection,
}

impl Syscfg {
    pub(crate) fn new(selection: Selection) -> Self {
        Self { selection }
    }
}

impl Device for Syscfg {
    type Register = syscfg::Register;

    fn write(
        &mut self,
        register: syscfg::Register,
        _value: u64,
        registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
        let first = match register {
            syscfg::Register::Exticr1 => 0,
            syscfg::Register::Exticr2 => 4,
            syscfg::Register::Exticr3 => 8,
            syscfg::Register::Exticr4 => 12,
            _ => return,
        };
        let value = registers.get(register);
        for (nth, line) in self.selection[first..first + 4].iter().enumerate() {
            line.store((value >> (4 * nth) & 0xF) as u8, Ordering::Relaxed);
        }
    }

    fn reset(&mut self) {
        for line in self.selection.iter() {
            line.store(0, Ordering::Relaxed);
        }
    }
}

/// The external interrupt controller: edges on pins, to `PR`, to the core.
#[derive(Debug)]
pub(crate) struct Exti {
    selection: Selection,
    /// The level each pin last had, by port letter and pin.
    levels: [u16; 16],
    raised: [Level; GROUPS.len()],
}

impl Exti {
    pub(crate) fn new(selection: Selection) -> Self {
        Self {
            selection,
            levels: [0; 16],
            raised: [Level::Low; GROUPS.len()],
        }
    }

    fn drive(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let pending = registers.get(exti::Register::Pr) & registers.get(exti::Register::Imr);
        for ((lines, position), raised) in GROUPS.iter().zip(&mut self.raised) {
            let level = Level::from(pending & lines != 0);
            if level != *raised {
                *raised = level;
                context.interrupt(*position, level);
            }
        }
    }
}

/// The port a request comes from, 0 for `GPIOA`.
pub(crate) fn port_of(instance: &str) -> Option<usize> {
    let letter = instance.strip_prefix(PORT)?.bytes().next()?;
    Some(usize::from(letter.checked_sub(b'A')?)).filter(|&port| port < 16)
}

impl Device for Exti {
    type Register = exti::Register;

    fn write(
        &mut self,
        register: exti::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            // 12.3.5: a line asked for by software is pending until PR is cleared.
            exti::Register::Swier => {
                let pending = registers.get(exti::Register::Pr) | value;
                registers.set(exti::Register::Pr, pending);
            }
            // PR itself clears a written one, as the bus was told.
            exti::Register::Pr => {
                let asked = registers.get(exti::Register::Swier) & !value;
                registers.set(exti::Register::Swier, asked);
            }
            _ => {}
        }
        self.drive(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some(port) = port_of(change.instance).filter(|_| change.request < PINS) else {
            return;
        };
        let line = 1u64 << change.request;
        let was = u64::from(self.levels[port]) & line != 0;
        let is = change.level == Level::High;
        self.levels[port] = self.levels[port] & !(line as u16) | if is { line as u16 } else { 0 };
        let selected = self.selection[change.request].load(Ordering::Relaxed);
        let edges = if is {
            exti::Register::Rtsr
        } else {
            exti::Register::Ftsr
        };
        if was != is && usize::from(selected) == port && registers.get(edges) & line != 0 {
            let pending = registers.get(exti::Register::Pr) | line;
            registers.set(exti::Register::Pr, pending);
            self.drive(registers, context);
        }
    }

    fn reset(&mut self) {
        *self = Self {
            levels: self.levels,
            ..Self::new(self.selection.clone())
        };
    }
}
