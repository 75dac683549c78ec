//! The USART of the STM32H7.

use embassy_stm32::pac::DMAMUX1;
use embassy_stm32::pac::dma::regs::Cr;

use super::Damage;
use crate::board::{SERIAL, SERIAL_REQUESTS, SERIAL_RX, SERIAL_TX};

/// Where DMA finds what came, and puts what goes.
pub fn registers() -> (*mut (), *mut ()) {
    (SERIAL.rdr().as_ptr().cast(), SERIAL.tdr().as_ptr().cast())
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
pub fn route(receives: bool, _: &mut Cr) {
    let (stream, request) = if receives {
        (SERIAL_RX, SERIAL_REQUESTS[0])
    } else {
        (SERIAL_TX, SERIAL_REQUESTS[1])
    };
    DMAMUX1
        .ccr(stream.number())
        .write(|w| w.set_dmareq_id(request));
}

/// What went wrong with the bytes since it was asked last.
pub fn take_damage() -> Damage {
    let status = SERIAL.isr().read();
    SERIAL.icr().write(|w| {
        w.set_ore(true);
        w.set_fe(true);
        w.set_ne(true);
    });
    Damage {
        lost: status.ore(),
        garbled: status.fe() || status.ne(),
    }
}
