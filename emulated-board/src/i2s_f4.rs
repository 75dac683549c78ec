//! The transmitting half of an STM32F4 I2S, RM0090 chapter 28.4: half-words through `DR`.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::spi1::{Register as R, cr2, i2scfgr, i2spr, sr};
use rigless::time::{EventId, VirtualNanos};

use crate::i2s::AudioFormat;
use crate::record::Shared;
use crate::transmitter::{Shape, Transmitter};

/// The instance's one interrupt.
const GLOBAL: usize = 0;
/// The DMA request of an empty transmit buffer, in the numbering of rigless' SPI model.
const TRANSMIT_REQUEST: usize = 1;
/// `I2SCFG` of a master that transmits, 28.5.8.
const MASTER_TRANSMIT: u64 = 0b10;

/// One half-word in `DR`; batches of 32: eight frames of 24 bits.
const SHAPE: Shape = Shape {
    depth: 1,
    batch: 32,
    sample,
};

/// The format the registers ask for.
fn format(config: u64, prescaler: u64) -> AudioFormat {
    AudioFormat::from_fields(
        i2scfgr::DATLEN.get(config),
        i2scfgr::CHLEN.get(config),
        i2scfgr::I2SSTD.get(config),
        i2spr::MCKOE.is_set(prescaler),
    )
}

/// Half-words of a channel.
fn half_words(format: &AudioFormat) -> usize {
    if format.data_bits > 16 { 2 } else { 1 }
}

/// 28.4.3: the upper half-word comes first; the low 8 bits of 24 are the top of the second.
fn sample(format: &AudioFormat, words: &[u32]) -> i32 {
    let half = |word: u32| (word as u16).cast_signed();
    match (format.data_bits, words) {
        (24, [high, low]) => i32::from(half(*high)) << 8 | (low >> 8 & 0xFF) as i32,
        (32, [high, low]) => i32::from(half(*high)) << 16 | (low & 0xFFFF) as i32,
        (_, [word, ..]) => i32::from(half(*word)),
        _ => 0,
    }
}

/// Kernel clocks of a frame.
fn frame_cycles(config: u64, prescaler: u64) -> u64 {
    let divider = 2 * i2spr::I2SDIV.get(prescaler) + i2spr::ODD.get(prescaler);
    format(config, prescaler).frame_cycles(divider)
}

/// Frames a second with a kernel clock of `kernel_hz`, or 0 where a register stops it.
pub(crate) fn sample_rate(kernel_hz: f64, registers: &RegisterFile) -> f64 {
    let (config, prescaler) = (registers.get(R::I2scfgr), registers.get(R::I2spr));
    match frame_cycles(config, prescaler) {
        0 => 0.0,
        cycles => kernel_hz / cycles as f64,
    }
}

/// One I2S, transmitting into the record.
#[derive(Debug)]
pub(crate) struct I2sF4 {
    transmitter: Transmitter,
    request: Level,
    interrupt: Level,
}

impl I2sF4 {
    pub(crate) fn new(record: Shared) -> Self {
        Self {
            transmitter: Transmitter::new(record, SHAPE),
            request: Level::Low,
            interrupt: Level::Low,
        }
    }

    fn follow_enable(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let (config, prescaler) = (registers.get(R::I2scfgr), registers.get(R::I2spr));
        let on = i2scfgr::I2SE.is_set(config)
            && i2scfgr::I2SMOD.is_set(config)
            && i2scfgr::I2SCFG.get(config) == MASTER_TRANSMIT;
        match (on, self.transmitter.enabled()) {
            (true, false) => {
                let format = format(config, prescaler);
                let cycles = frame_cycles(config, prescaler);
                self.transmitter
                    .enable(format, half_words(&format), cycles, context);
            }
            (false, true) => self.transmitter.disable(false),
            _ => {}
        }
    }

    fn drive(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let control = registers.get(R::Cr2);
        let i2s = i2scfgr::I2SMOD.is_set(registers.get(R::I2scfgr));
        let empty = i2s && self.transmitter.has_room();
        let dma = cr2::TXDMAEN.is_set(control) || self.transmitter.behind();
        let request = Level::from(empty && dma);
        if request != self.request {
            self.request = request;
            context.request(TRANSMIT_REQUEST, request);
        }
        let interrupt = Level::from(
            (empty && cr2::TXEIE.is_set(control))
                || (self.transmitter.underrun() && cr2::ERRIE.is_set(control)),
        );
        if interrupt != self.interrupt {
            self.interrupt = interrupt;
            context.interrupt(GLOBAL, interrupt);
        }
    }

    fn status(&self, now: VirtualNanos) -> u64 {
        let transmitter = &self.transmitter;
        let flags = [
            (sr::TXE, transmitter.has_room()),
            (
                sr::CHSIDE,
                transmitter.enabled() && transmitter.right_is_next(now),
            ),
            (sr::UDR, transmitter.underrun()),
            (sr::BSY, transmitter.running()),
        ];
        flags
            .iter()
            .fold(0, |status, (field, set)| field.set(status, u64::from(*set)))
    }
}

impl Device for I2sF4 {
    type Register = R;

    fn read(
        &mut self,
        register: R,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.transmitter.look(context.now());
        let value = self.peek(register, registers, context.now());
        if register == R::Sr {
            // 28.5.3 bit 3: cleared by a read of SR.
            self.transmitter.clear_underrun();
            self.drive(registers, context);
        }
        value
    }

    fn peek(&self, register: R, _registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        match register {
            R::Sr => Some(self.status(now)),
            R::Dr => Some(0),
            _ => None,
        }
    }

    fn write(
        &mut self,
        register: R,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            R::Dr => self.transmitter.push((value & 0xFFFF) as u32, context),
            R::Cr2 => {
                self.transmitter.settle(context.now());
                let dma = cr2::TXDMAEN.is_set(registers.get(R::Cr2));
                self.transmitter.set_dma(dma, context);
            }
            R::I2scfgr => {
                self.transmitter.settle(context.now());
                self.follow_enable(registers, context);
            }
            _ => {}
        }
        self.drive(registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.transmitter.on_event(event, context);
        self.drive(registers, context);
    }

    fn on_clock(
        &mut self,
        mhz: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.transmitter.on_clock(mhz, context);
        self.drive(registers, context);
    }

    fn reset(&mut self) {
        self.transmitter.reset();
        self.request = Level::Low;
        self.interrupt = Level::Low;
    }

    fn reset_line(&mut self, _registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.request == Level::High {
            context.request(TRANSMIT_REQUEST, Level::Low);
        }
        self.reset();
    }
}

#[cfg(test)]
mod tests {
    use rigless::mcu::{Mcu, Operate, Single};
    use rigless::soc::{Layout, Width, stm32f427};

    use super::*;

    /// `I2SCFGR` of 24-bit samples, Philips, master transmit, disabled.
    const PHILIPS_24: u64 = 0b1010_0000_0010 | 1;
    const I2SE: u64 = 1 << 10;
    /// `I2SPR`: I2SDIV 2, ODD, MCKOE.
    const DIVIDE_BY_5: u64 = 0x302;
    /// A slot of 48 kHz and four half-words, ns.
    const SLOT: f64 = 1e9 / 192_000.0;

    #[test]
    fn the_rate_is_what_the_registers_give() {
        let rate = |hz: f64, prescaler| match frame_cycles(PHILIPS_24, prescaler) {
            0 => 0.0,
            cycles => hz / cycles as f64,
        };
        // PLLI2S of 8 MHz / 5 * 192 / 5.
        assert_eq!(rate(61_440_000.0, DIVIDE_BY_5), 48_000.0);
        // The tree of most examples, 8 MHz / 8 * 258 / 3, and I2SDIV 3 with ODD: nobody notices.
        assert_eq!(rate(86_000_000.0, 0x303), 47_991.071_428_571_43);
        // 96 MHz over 2048: the other usual one.
        assert_eq!(rate(96_000_000.0, 0x204), 46_875.0);
        // No master clock: 64 bit clocks a frame.
        assert_eq!(rate(61_440_000.0, 0x00A), 48_000.0);
        assert_eq!(rate(61_440_000.0, 0x200), 0.0);
    }

    #[test]
    fn samples_come_out_of_their_half_words() {
        let wide = format(PHILIPS_24, DIVIDE_BY_5);
        assert_eq!((wide.data_bits, wide.channel_bits), (24, 32));
        assert!(wide.master_clock && half_words(&wide) == 2);
        assert_eq!(sample(&wide, &[0x7FFF, 0xFF00]), 0x7F_FFFF);
        assert_eq!(sample(&wide, &[0x8000, 0x0000]), -0x80_0000);
        assert_eq!(sample(&wide, &[0xFFFF, 0xFE00]), -2);
        let narrow = format(0xE00, 0x002);
        assert_eq!((narrow.data_bits, narrow.channel_bits), (16, 16));
        assert_eq!((sample(&narrow, &[0xFFFF]), half_words(&narrow)), (-1, 1));
        assert_eq!(sample(&format(0xE05, 0x002), &[0xFFFF, 0xFFFE]), -2);
        assert_eq!(format(0xE01, 0x002).channel_bits, 32, "16 bits in 32");
    }

    /// The block alone, clocked for 48 kHz, fed by hand.
    struct Rig {
        soc: Single<I2sF4>,
        record: Shared,
    }

    impl Rig {
        fn new() -> Self {
            let record = Shared::default();
            let model = I2sF4::new(record.clone());
            let mut soc = Single::new(stm32f427::builder(), "SPI3", model).expect("an SPI3");
            soc.drive(VirtualNanos(0), |i2s, registers, context| {
                i2s.on_clock(61_440_000_000, registers, context);
            });
            let mut rig = Self { soc, record };
            rig.write(0, R::I2spr, DIVIDE_BY_5);
            rig.write(0, R::I2scfgr, PHILIPS_24 | I2SE);
            rig
        }

        fn address(&self, register: R) -> u64 {
            let base = self.soc.bus().peripheral("SPI3").expect("an SPI3").base;
            base + u64::from(register.spec().offset)
        }

        /// Writes at the beginning of slot `at`, or a part of a slot later.
        fn write_in(&mut self, at: f64, value: u64) {
            self.write((at * SLOT) as u64, R::Dr, value);
        }

        fn write(&mut self, at: u64, register: R, value: u64) {
            let (at, address) = (VirtualNanos(at), self.address(register));
            self.soc.advance_to(at);
            let written = self.soc.write(at, address, Width::W16, value);
            written.expect("it answers");
        }

        fn status(&mut self, at: f64) -> u64 {
            let (at, address) = (VirtualNanos((at * SLOT) as u64), self.address(R::Sr));
            self.soc.advance_to(at);
            let read = self.soc.read(at, address, Width::W16);
            read.expect("it answers")
        }
    }

    #[test]
    fn half_words_leave_in_the_order_they_come_one_a_slot() {
        let mut rig = Rig::new();
        assert!(
            !sr::BSY.is_set(rig.status(0.0)),
            "nothing leaves before the first"
        );
        for (slot, word) in [0x0001, 0x0200, 0x0003, 0x0400, 0x0005]
            .into_iter()
            .enumerate()
        {
            rig.write_in(slot as f64 - 0.5_f64.min(slot as f64), word);
        }
        let status = rig.status(4.1);
        assert!(sr::BSY.is_set(status) && sr::TXE.is_set(status));
        assert_eq!(rig.record.lock().audio, [[0x102, 0x304]]);
        assert_eq!(rig.record.lock().streams[0].sample_rate, 48_000.0);
        assert_eq!(rig.record.lock().underruns, 0);
    }

    #[test]
    fn a_half_word_late_is_an_underrun_and_what_follows_has_changed_places() {
        let mut rig = Rig::new();
        rig.write_in(0.0, 0x0001);
        // Slot 1 finds nothing; its half-word leaves in slot 2, where the right channel begins.
        assert!(sr::UDR.is_set(rig.status(1.5)));
        assert!(!sr::UDR.is_set(rig.status(1.6)), "a read clears it");
        assert!(sr::CHSIDE.is_set(rig.status(1.7)), "the right one is next");
        rig.write_in(1.8, 0x0200);
        rig.write_in(2.5, 0x0003);
        rig.status(4.5);
        assert_eq!(rig.record.lock().audio[0], [0x100, 0x20000]);
        assert_eq!(rig.record.lock().underruns, 2, "and slot 4 found nothing");
    }

    #[test]
    fn a_frame_begun_is_dropped_by_a_disable_and_the_next_begins_left() {
        let mut rig = Rig::new();
        rig.write_in(0.0, 0x0001);
        let off = (0.5 * SLOT) as u64;
        rig.write(off, R::I2scfgr, PHILIPS_24);
        rig.write(off, R::I2scfgr, PHILIPS_24 | I2SE);
        let start = off as f64 / SLOT;
        for (slot, word) in [0x0007, 0x0800, 0x0009, 0x0A00].into_iter().enumerate() {
            rig.write_in(start + slot as f64 - 0.5_f64.min(slot as f64), word);
        }
        rig.status(start + 3.5);
        assert_eq!(rig.record.lock().audio, [[0x708, 0x90A]]);
        assert_eq!(rig.record.lock().streams.len(), 2);
    }
}
