//! The DMA stream that feeds the I2S block; the same on every chip here.

use embassy_stm32::pac::dma::regs::Cr;
use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};

use crate::board::{DMA, STREAM};

/// What an interrupt was for.
pub struct Flags {
    /// A half has been read to its end, and so many items are left of the whole.
    pub left: Option<usize>,
    /// The stream reported an error.
    pub failed: bool,
}

/// Starts to carry `items` of `size` from `buffer` to the `register`, over and over; `route` says which request asks for
/// them, on chips whose stream knows that.
pub fn start(
    register: *mut (),
    buffer: *const u32,
    items: usize,
    size: Size,
    route: impl FnOnce(&mut Cr),
) {
    let stream = DMA.st(STREAM);
    stream.par().write_value(register as u32);
    stream.m0ar().write_value(buffer as u32);
    stream.ndtr().write(|w| w.set_ndt(items as u16));
    clear();
    stream.cr().write(|w| {
        route(w);
        w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
        w.set_minc(true);
        w.set_msize(size);
        w.set_psize(size);
        w.set_circ(true);
        w.set_pl(Pl::VERY_HIGH);
        w.set_htie(true);
        w.set_tcie(true);
        w.set_teie(true);
        w.set_dmeie(true);
    });
    stream.cr().modify(|w| w.set_en(true));
}

/// Stops.
pub fn stop() {
    let stream = DMA.st(STREAM);
    stream.cr().modify(|w| w.set_en(false));
    while stream.cr().read().en() {}
    clear();
}

/// Reads what the interrupt was for, and takes it away.
pub fn acknowledge() -> Flags {
    let flags = DMA.isr(STREAM / 4).read();
    let at = STREAM % 4;
    let left = (flags.htif(at) || flags.tcif(at)).then(|| {
        clear();
        usize::from(DMA.st(STREAM).ndtr().read().ndt())
    });
    Flags {
        left,
        failed: flags.teif(at) || flags.dmeif(at),
    }
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
