//! The transmitting half of an STM32H7 I2S, RM0433 chapter 50.9: words through the FIFO behind `TXDR`.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::spi1::{Register as R, cfg1, cgfr, cr1, ier, ifcr, sr};
use rigless::time::{EventId, VirtualNanos};

use crate::i2s::AudioFormat;
use crate::record::Shared;
use crate::transmitter::{Shape, Transmitter};

/// The instance's one interrupt.
const GLOBAL: usize = 0;
/// The DMA request of a FIFO with room, in the numbering of rigless' SPI model.
const TRANSMIT_REQUEST: usize = 1;
/// `I2SCFG` of a master that transmits, 50.11.14.
const MASTER_TRANSMIT: u64 = 0b010;

/// A FIFO of 16 bytes; batches of 16 words: eight frames.
const SHAPE: Shape = Shape {
    depth: 4,
    batch: 16,
    sample,
};

/// The format the register asks for.
fn format(config: u64) -> AudioFormat {
    AudioFormat::from_fields(
        cgfr::DATLEN.get(config),
        cgfr::CHLEN.get(config),
        cgfr::I2SSTD.get(config),
        cgfr::MCKOE.is_set(config),
    )
}

/// A channel is one word, its sample at the left.
fn sample(format: &AudioFormat, words: &[u32]) -> i32 {
    let word = words.first().copied().unwrap_or(0);
    word.cast_signed() >> (32 - format.data_bits)
}

/// Kernel clocks of a frame; a divider of 0 divides by 1, 50.11.14.
fn frame_cycles(config: u64) -> u64 {
    let divider = 2 * cgfr::I2SDIV.get(config) + cgfr::ODD.get(config);
    format(config).frame_cycles(divider.max(1))
}

/// One I2S, transmitting into the record.
#[derive(Debug)]
pub(crate) struct I2sH7 {
    transmitter: Transmitter,
    kernel_hz: u64,
    suspended: bool,
    request: Level,
    interrupt: Level,
}

impl I2sH7 {
    pub(crate) fn new(record: Shared) -> Self {
        Self {
            transmitter: Transmitter::new(record, SHAPE),
            kernel_hz: 0,
            suspended: false,
            request: Level::Low,
            interrupt: Level::Low,
        }
    }

    /// Frames a second as the registers stand, 0 while nothing clocks them.
    pub(crate) fn sample_rate(&self, registers: &RegisterFile) -> f64 {
        self.kernel_hz as f64 / frame_cycles(registers.get(R::Cgfr)) as f64
    }

    fn follow_control(
        &mut self,
        written: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let (control, config) = (registers.get(R::Cr1), registers.get(R::Cgfr));
        let i2s = cgfr::I2SMOD.is_set(config) && cgfr::I2SCFG.get(config) == MASTER_TRANSMIT;
        if !i2s || !cr1::SPE.is_set(control) {
            self.transmitter.disable(true);
            self.suspended = false;
            registers.set(R::Cr1, cr1::CSTART.set(control, 0));
        } else if cr1::CSUSP.is_set(written) {
            self.transmitter.disable(false);
            self.suspended = true;
            registers.set(R::Cr1, cr1::CSTART.set(control, 0));
        } else if cr1::CSTART.is_set(control) && !self.transmitter.enabled() {
            self.suspended = false;
            self.transmitter
                .enable(format(config), 1, frame_cycles(config), context);
        }
    }

    fn push(&mut self, value: u64, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let config = registers.get(R::Cgfr);
        let format = format(config);
        let left = cgfr::DATFMT.is_set(config);
        let mut word = |value: u32| {
            let unused = 32 - format.data_bits;
            let aligned = if left { value } else { value << unused };
            self.transmitter.push(aligned, context);
        };
        let value = (value & u64::from(u32::MAX)) as u32;
        word(value);
        // 50.11.8: a word written holds two samples of 16 bits.
        if format.data_bits == 16 && context_width(context) == Width::W32 {
            self.transmitter.push(value & 0xFFFF_0000, context);
        }
    }

    fn drive(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let on = cr1::SPE.is_set(registers.get(R::Cr1));
        let room = on && self.transmitter.has_room();
        let dma = cfg1::TXDMAEN.is_set(registers.get(R::Cfg1)) || self.transmitter.behind();
        let request = Level::from(room && dma);
        if request != self.request {
            self.request = request;
            context.request(TRANSMIT_REQUEST, request);
        }
        let enables = registers.get(R::Ier);
        let interrupt = Level::from(
            (room && ier::TXPIE.is_set(enables))
                || (self.transmitter.underrun() && ier::UDRIE.is_set(enables)),
        );
        if interrupt != self.interrupt {
            self.interrupt = interrupt;
            context.interrupt(GLOBAL, interrupt);
        }
    }
}

fn context_width(context: &DeviceContext<'_>) -> Width {
    context.access_width().unwrap_or(Width::W32)
}

impl Device for I2sH7 {
    type Register = R;

    fn read(
        &mut self,
        register: R,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.transmitter.look(context.now());
        self.peek(register, registers, context.now())
    }

    fn peek(&self, register: R, _registers: &RegisterFile, _now: VirtualNanos) -> Option<u64> {
        let flags = [
            (sr::TXP, self.transmitter.has_room()),
            (sr::UDR, self.transmitter.underrun()),
            (sr::SUSP, self.suspended),
            (sr::TXC, !self.transmitter.running()),
        ];
        (register == R::Sr).then(|| {
            flags
                .iter()
                .fold(0, |status, (field, set)| field.set(status, u64::from(*set)))
        })
    }

    fn write(
        &mut self,
        register: R,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            R::Txdr => self.push(value, registers, context),
            R::Cfg1 => {
                self.transmitter.settle(context.now());
                let dma = cfg1::TXDMAEN.is_set(registers.get(R::Cfg1));
                self.transmitter.set_dma(dma, context);
            }
            R::Cr1 => {
                self.transmitter.settle(context.now());
                self.follow_control(value, registers, context);
            }
            R::Ifcr if ifcr::UDRC.is_set(value) => self.transmitter.clear_underrun(),
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

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.kernel_hz = hz;
        self.transmitter.on_clock(1000 * hz, context);
        self.drive(registers, context);
    }

    fn reset(&mut self) {
        self.transmitter.reset();
        self.suspended = false;
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
    use super::*;

    /// 24 bits at the left of 32, master transmit, I2SDIV 12, ODD.
    const LEFT_24: u64 = 0b101 | 1 << 8 | 1 << 14 | 12 << 16 | 1 << 24;

    #[test]
    fn the_frame_and_its_samples_are_what_the_register_says() {
        assert_eq!(76_800_000.0 / frame_cycles(LEFT_24) as f64, 48_000.0);
        assert_eq!(
            frame_cycles(LEFT_24 | 1 << 25),
            256 * 25,
            "with a master clock"
        );
        let format = format(LEFT_24);
        assert_eq!((format.data_bits, format.channel_bits), (24, 32));
        assert_eq!(sample(&format, &[0x7FFF_FF00]), 0x7F_FFFF);
        assert_eq!(sample(&format, &[0xFFFF_FE00]), -2);
    }
}
