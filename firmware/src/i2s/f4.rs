//! The I2S block of the STM32F4: 24-bit samples go out as two half-words, the upper one first.

use embassy_stm32::pac::dma::regs::Cr;
use embassy_stm32::pac::dma::vals::Size;
use embassy_stm32::pac::spi::vals::{Chlen, Datlen, I2scfg, I2sstd, Odd};

use crate::board::{CHANNEL, CLOCK, SPI};

/// DMA's items in a word.
pub const ITEMS: usize = 2;
/// What each is.
pub const SIZE: Size = Size::BITS16;

/// A 24-bit sample as DMA reads it: in memory the upper half-word comes first.
#[inline(always)]
pub fn word(sample: i32) -> u32 {
    ((sample as u32) << 8).rotate_left(16)
}

/// What DMA writes to.
pub fn register() -> *mut () {
    SPI.dr().as_ptr().cast()
}

/// Sets the block up.
pub fn prepare() {
    SPI.i2spr().write(|w| {
        w.set_i2sdiv(CLOCK.div);
        w.set_odd(if CLOCK.odd { Odd::ODD } else { Odd::EVEN });
        w.set_mckoe(CLOCK.master_clock);
    });
    SPI.i2scfgr().write(|w| {
        w.set_i2smod(true);
        w.set_i2scfg(I2scfg::MASTER_TX);
        w.set_i2sstd(I2sstd::PHILIPS);
        w.set_datlen(Datlen::BITS24);
        w.set_chlen(Chlen::BITS32);
    });
}

/// Has the block's request serve the stream.
pub fn route(stream: &mut Cr) {
    stream.set_chsel(CHANNEL);
}

/// Starts to play.
pub fn enable() {
    SPI.cr2().modify(|w| w.set_txdmaen(true));
    SPI.i2scfgr().modify(|w| w.set_i2se(true));
}
