//! STM32F407G-DISC1: STM32F407VG, 168 MHz, with a CS43L22 on the board. Pins from its manual, UM1472.

use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Pull, Speed};
use embassy_stm32::i2c::{self, I2c, Master};
use embassy_stm32::mode::Blocking;
use embassy_stm32::rcc::{APBPrescaler, PllMul, PllPDiv, PllQDiv};
use embassy_stm32::{Peri, interrupt, pac, rcc};
use embassy_time::Duration;

use super::f4::CoreClock;
use super::{Board, Button, Lights};
use crate::clock::SampleClock;
use crate::dma::Stream;
use crate::{audio, i2s, log};

/// The board's name.
pub const NAME: &str = "STM32F407G-DISC1";
/// The I2S block.
pub type I2s = embassy_stm32::peripherals::SPI3;
/// Its independent watchdog.
pub type Watchdog = embassy_stm32::peripherals::IWDG;
/// Clock of the core, Hz.
pub const CORE: u32 = 168_000_000;
/// What it can hold.
pub type Capacity = freshet::profile::F407;

/// 8 MHz / 5 · 192 / 5 = 61.44 MHz = 48 000 · 256 · 5.
pub const CLOCK: SampleClock = SampleClock {
    crystal: 8_000_000,
    m: 5,
    n: 192,
    r: 5,
    div: 2,
    odd: true,
    master_clock: true,
};

/// I2S3 and the stream and channel that serve it; stream 5 would too, but that is the only one for USART2.
pub const SPI: pac::spi::Spi = pac::SPI3;
/// See [`SPI`].
pub const DMA: Stream = Stream::new(pac::DMA1, 7);
/// See [`SPI`].
pub const CHANNEL: u8 = 0;

/// The serial line's USART, and the streams and the channel that serve it.
pub const SERIAL: pac::usart::Usart = pac::USART2;
/// See [`SERIAL`].
pub type SerialPort = embassy_stm32::peripherals::USART2;
/// See [`SERIAL`].
pub const SERIAL_RX: Stream = Stream::new(pac::DMA1, 5);
/// See [`SERIAL`].
pub const SERIAL_TX: Stream = Stream::new(pac::DMA1, 6);
/// See [`SERIAL`].
pub const SERIAL_CHANNEL: u8 = 4;

/// An interrupt that nothing on this board uses: it stands for the audio task.
pub const AUDIO_INTERRUPT: interrupt::Interrupt = interrupt::UART5;

#[interrupt]
unsafe fn UART5() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { audio::EXECUTOR.on_interrupt() }
}

#[interrupt]
fn DMA1_STREAM7() {
    i2s::on_interrupt();
}

/// Sets up clocks, pins and the codec.
pub fn init() -> Board {
    // 168 MHz for the core, 48 MHz for USB.
    let (p, crystal) = super::f4::start(CoreClock {
        pll: (PllMul::MUL210, PllPDiv::DIV2, PllQDiv::DIV7),
        apb: (APBPrescaler::DIV4, APBPrescaler::DIV2),
    });
    rcc::enable_and_reset::<I2s>();
    super::give_to_i2s(
        [p.PC7.into(), p.PC10.into(), p.PC12.into(), p.PA4.into()],
        6,
    );
    super::give_to_serial([p.PA2.into(), p.PA3.into()]);
    // The codec wants its master clock before it is switched on.
    i2s::idle();
    let mut reset = Output::new(p.PD4, Level::Low, Speed::Low);
    embassy_time::block_for(Duration::from_millis(1));
    reset.set_high();
    core::mem::forget(reset);
    let mut bus = i2c::Config::default();
    bus.timeout = Duration::from_millis(10);
    let codec = start_codec(&mut I2c::new_blocking(p.I2C1, p.PB6, p.PB9, bus));
    if codec.is_err() {
        log::error!("the codec does not answer");
    }
    let light = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low);
    Board {
        lights: Lights {
            alive: light(p.PD12.into()),
            clip: Some(light(p.PD13.into())),
            late: Some(light(p.PD14.into())),
            trouble: Some(light(p.PD15.into())),
            inverted: false,
        },
        button: Button {
            pin: Input::new(p.PA0, Pull::Down),
            down: true,
        },
        #[cfg(feature = "usb")]
        usb: crate::usb::Pins {
            port: p.USB_OTG_FS,
            plus: p.PA12,
            minus: p.PA11,
        },
        watchdog: p.IWDG,
        trouble: !crystal || codec.is_err(),
    }
}

/// Address of the CS43L22.
const CODEC: u8 = 0x4a;

/// Initialises the CS43L22 as its data sheet asks (§4.11), headphones on, 24-bit I2S, -12 dB.
fn start_codec(bus: &mut I2c<'static, Blocking, Master>) -> Result<(), i2c::Error> {
    const SEQUENCE: [(u8, u8); 14] = [
        (0x02, 0x01), // power down
        (0x00, 0x99), // required settings
        (0x47, 0x80),
        (0x32, 0x80),
        (0x32, 0x00),
        (0x00, 0x00),
        (0x04, 0xaf), // headphones on, speaker off
        (0x05, 0x81), // clocks found out by itself
        (0x06, 0x04), // slave, I2S, up to 24 bits
        (0x0a, 0x00), // no soft ramp, no zero crossing: the core does not click
        (0x20, 0xe8), // both channels at -12 dB
        (0x21, 0xe8),
        (0x1a, 0x00), // PCM volume 0 dB
        (0x1b, 0x00),
    ];
    for (register, value) in SEQUENCE {
        bus.blocking_write(CODEC, &[register, value])?;
    }
    bus.blocking_write(CODEC, &[0x02, 0x9e])
}

/// Silences the codec at once, by its reset.
pub fn mute() {
    pac::GPIOD.bsrr().write(|w| w.set_br(4, true));
}
