//! The I2S block of the STM32H7: 24-bit samples go out as one word each, at its left.

use embassy_stm32::pac::DMAMUX1;
use embassy_stm32::pac::dma::regs::Cr;
use embassy_stm32::pac::dma::vals::Size;
use embassy_stm32::pac::spi::vals::{Chlen, Datfmt, Datlen, I2scfg, I2sstd, Odd};

use crate::board::{CLOCK, DMA, REQUEST, SPI};

/// DMA's items in a word.
pub const ITEMS: usize = 1;
/// What each is.
pub const SIZE: Size = Size::BITS32;

/// A 24-bit sample as the I2S block takes it.
#[inline(always)]
pub fn word(sample: i32) -> u32 {
    (sample as u32) << 8
}

/// What DMA writes to.
pub fn register() -> *mut () {
    SPI.txdr32().as_ptr().cast()
}

/// Sets the block up.
pub fn prepare() {
    SPI.i2scfgr().write(|w| {
        w.set_i2smod(true);
        w.set_i2scfg(I2scfg::MASTER_TX);
        w.set_i2sstd(I2sstd::PHILIPS);
        w.set_datlen(Datlen::BITS24);
        w.set_chlen(Chlen::BITS32);
        w.set_datfmt(Datfmt::LEFT_ALIGNED);
        w.set_i2sdiv(CLOCK.div);
        w.set_odd(if CLOCK.odd { Odd::ODD } else { Odd::EVEN });
        w.set_mckoe(CLOCK.master_clock);
    });
}

/// Has the block's request serve the stream.
pub fn route(_: &mut Cr) {
    DMAMUX1
        .ccr(DMA.number())
        .write(|w| w.set_dmareq_id(REQUEST));
}

/// Starts to play.
pub fn enable() {
    SPI.cfg1().modify(|w| w.set_txdmaen(true));
    SPI.cr1().modify(|w| w.set_spe(true));
    SPI.cr1().modify(|w| w.set_cstart(true));
}
