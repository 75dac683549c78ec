//! I2S and DMA of the STM32H7: 24-bit samples go out as one word each, at its left.

use embassy_stm32::pac::DMAMUX1;
use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::spi::vals::{Chlen, Datfmt, Datlen, I2scfg, I2sstd, Odd};

use embassy_stm32::rcc;

use super::Event;
use crate::board::{CLOCK, DMA, I2s, REQUEST, SPI, STREAM};

/// A 24-bit sample as the I2S block takes it.
#[inline(always)]
pub fn word(sample: i32) -> u32 {
    (sample as u32) << 8
}

/// Starts to play `words` words from `buffer`, over and over.
pub fn start(buffer: *const u32, words: usize) {
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
    DMAMUX1.ccr(STREAM).write(|w| w.set_dmareq_id(REQUEST));
    let stream = DMA.st(STREAM);
    stream.par().write_value(SPI.txdr32().as_ptr() as u32);
    stream.m0ar().write_value(buffer as u32);
    stream.ndtr().write(|w| w.set_ndt(words as u16));
    clear();
    stream.cr().write(|w| {
        w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
        w.set_minc(true);
        w.set_msize(Size::BITS32);
        w.set_psize(Size::BITS32);
        w.set_circ(true);
        w.set_pl(Pl::VERY_HIGH);
        w.set_htie(true);
        w.set_tcie(true);
        w.set_teie(true);
        w.set_dmeie(true);
    });
    stream.cr().modify(|w| w.set_en(true));
    SPI.cfg1().modify(|w| w.set_txdmaen(true));
    SPI.cr1().modify(|w| w.set_spe(true));
    SPI.cr1().modify(|w| w.set_cstart(true));
}

/// Stops both, the I2S block first, and leaves nothing in it: a half-word kept from before would put all that follows
/// out of place.
pub fn stop() {
    rcc::enable_and_reset_without_stop::<I2s>();
    let stream = DMA.st(STREAM);
    stream.cr().modify(|w| w.set_en(false));
    while stream.cr().read().en() {}
    clear();
}

/// Reads what the interrupt was for, and takes it away.
pub fn acknowledge() -> Event {
    let flags = DMA.isr(STREAM / 4).read();
    let at = STREAM % 4;
    // An underrun of the I2S block means that words were lost: the channels may have changed places.
    let failed = flags.teif(at) || flags.dmeif(at) || SPI.sr().read().udr();
    let began = (flags.htif(at) || flags.tcif(at)).then(|| {
        clear();
        // More than half to go: the first half plays.
        usize::from(DMA.st(STREAM).ndtr().read().ndt()) <= super::HALF
    });
    Event { began, failed }
}

fn clear() {
    let at = STREAM % 4;
    DMA.ifcr(STREAM / 4).write(|w| {
        w.set_htif(at, true);
        w.set_tcif(at, true);
        w.set_teif(at, true);
        w.set_dmeif(at, true);
        w.set_feif(at, true);
    });
}
