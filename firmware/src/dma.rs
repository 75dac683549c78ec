//! Streams of the DMA controllers; the same on every chip here.

use embassy_stm32::pac::dma::Dma;
use embassy_stm32::pac::dma::regs::Cr;
use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};

/// A stream of a controller.
#[derive(Clone, Copy)]
pub struct Stream {
    dma: Dma,
    number: usize,
}

/// What a stream carries.
pub struct Transfer {
    /// A peripheral's data register.
    pub register: *mut (),
    /// Where in memory.
    pub buffer: *mut (),
    /// How many items.
    pub items: usize,
    /// Of which size.
    pub size: Size,
    /// Out of memory, or into it.
    pub dir: Dir,
    /// Over and over.
    pub circular: bool,
    /// Before others.
    pub urgent: bool,
}

/// What happened since it was asked last.
#[derive(Clone, Copy)]
pub struct Flags {
    /// The first half was carried to its end.
    pub half: bool,
    /// The second half was.
    pub whole: bool,
    /// The stream reported an error.
    pub failed: bool,
}

impl Stream {
    /// Stream `number` of `dma`.
    pub const fn new(dma: Dma, number: usize) -> Self {
        Self { dma, number }
    }

    /// Its place in a controller.
    #[cfg(feature = "h743")]
    pub const fn number(&self) -> usize {
        self.number
    }

    /// Starts to carry; `route` says which request asks for items, on chips whose stream knows that, and what interrupts.
    pub fn start(&self, transfer: &Transfer, route: impl FnOnce(&mut Cr)) {
        let stream = self.dma.st(self.number);
        stream.par().write_value(transfer.register as u32);
        stream.m0ar().write_value(transfer.buffer as u32);
        (stream.ndtr()).write(|w| w.set_ndt(transfer.items as u16));
        self.clear();
        stream.cr().write(|w| {
            route(w);
            w.set_dir(transfer.dir);
            w.set_minc(true);
            w.set_msize(transfer.size);
            w.set_psize(transfer.size);
            w.set_circ(transfer.circular);
            if transfer.urgent {
                w.set_pl(Pl::VERY_HIGH);
            }
        });
        stream.cr().modify(|w| w.set_en(true));
    }

    /// Stops.
    pub fn stop(&self) {
        let stream = self.dma.st(self.number);
        stream.cr().modify(|w| w.set_en(false));
        while stream.cr().read().en() {}
        self.clear();
    }

    /// Whether it carries: one that is not circular ends by itself.
    pub fn is_running(&self) -> bool {
        self.dma.st(self.number).cr().read().en()
    }

    /// Items left until the end of the buffer.
    pub fn left(&self) -> usize {
        usize::from(self.dma.st(self.number).ndtr().read().ndt())
    }

    /// What happened, which is taken away where it was a half's end.
    pub fn take_flags(&self) -> Flags {
        let flags = self.dma.isr(self.number / 4).read();
        let at = self.number % 4;
        let flags = Flags {
            half: flags.htif(at),
            whole: flags.tcif(at),
            failed: flags.teif(at) || flags.dmeif(at),
        };
        if flags.half || flags.whole {
            self.clear();
        }
        flags
    }

    fn clear(&self) {
        let at = self.number % 4;
        self.dma.ifcr(self.number / 4).write(|w| {
            w.set_htif(at, true);
            w.set_tcif(at, true);
            w.set_teif(at, true);
            w.set_dmeif(at, true);
            w.set_feif(at, true);
        });
    }
}
