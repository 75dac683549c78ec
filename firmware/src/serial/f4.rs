//! The USART of the STM32F4.

use embassy_stm32::pac::dma::regs::Cr;

use super::Damage;
use crate::board::{SERIAL, SERIAL_CHANNEL};

/// Where DMA finds what came, and puts what goes.
pub fn registers() -> (*mut (), *mut ()) {
    (SERIAL.dr().as_ptr().cast(), SERIAL.dr().as_ptr().cast())
}

/// Starts both directions; a bit takes `divider` clocks.
pub fn start(divider: u16) {
    SERIAL.brr().write(|w| w.set_brr(divider));
    SERIAL.cr3().write(|w| {
        w.set_dmar(true);
        w.set_dmat(true);
    });
    SERIAL.cr1().write(|w| {
        w.set_ue(true);
        w.set_te(true);
        w.set_re(true);
    });
}

/// Has the requests of both directions serve their streams.
pub fn route(_receives: bool, stream: &mut Cr) {
    stream.set_chsel(SERIAL_CHANNEL);
}

/// What went wrong with the bytes since it was asked last. Call only where there were some: the flags clear when DMA
/// takes the next byte after they were read, so that without one they would be told again.
pub fn take_damage() -> Damage {
    let status = SERIAL.sr().read();
    Damage {
        lost: status.ore(),
        garbled: status.fe() || status.ne(),
    }
}
