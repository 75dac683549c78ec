//! "Black Pill" of WeAct: STM32F411CE, 96 MHz, with a PCM5102A.

use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::rcc::{APBPrescaler, PllMul, PllPDiv, PllQDiv};
use embassy_stm32::{interrupt, pac, rcc};

use super::f4::CoreClock;
use super::{Board, Button, Lights};
use crate::clock::SampleClock;
use crate::dma::Stream;
use crate::{audio, i2s};

/// The board's name.
pub const NAME: &str = "Black Pill STM32F411";
/// The I2S block.
pub type I2s = embassy_stm32::peripherals::SPI2;
/// Its independent watchdog.
pub type Watchdog = embassy_stm32::peripherals::IWDG;
/// Clock of the core, Hz.
pub const CORE: u32 = 96_000_000;
/// What it can hold.
pub type Capacity = freshet::profile::F411;

/// 25 MHz / 25 · 384 / 5 = 76.8 MHz = 48 000 · 64 · 25.
pub const CLOCK: SampleClock = SampleClock {
    crystal: 25_000_000,
    m: 25,
    n: 384,
    r: 5,
    div: 12,
    odd: true,
    master_clock: false,
};

/// I2S2 and the stream and channel that serve it.
pub const SPI: pac::spi::Spi = pac::SPI2;
/// See [`SPI`].
pub const DMA: Stream = Stream::new(pac::DMA1, 4);
/// See [`SPI`].
pub const CHANNEL: u8 = 0;

/// The serial line's USART, and the streams and the channel that serve it.
pub const SERIAL: pac::usart::Usart = pac::USART1;
/// See [`SERIAL`].
pub type SerialPort = embassy_stm32::peripherals::USART1;
/// See [`SERIAL`].
pub const SERIAL_RX: Stream = Stream::new(pac::DMA2, 5);
/// See [`SERIAL`].
pub const SERIAL_TX: Stream = Stream::new(pac::DMA2, 7);
/// See [`SERIAL`].
pub const SERIAL_CHANNEL: u8 = 4;

/// An interrupt that nothing on this board uses: it stands for the audio task.
pub const AUDIO_INTERRUPT: interrupt::Interrupt = interrupt::SPI5;

#[interrupt]
unsafe fn SPI5() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { audio::EXECUTOR.on_interrupt() }
}

#[interrupt]
fn DMA1_STREAM4() {
    i2s::on_interrupt();
}

/// Sets up clocks and pins.
pub fn init() -> Board {
    // 96 MHz for the core, 48 MHz for USB.
    let (p, crystal) = super::f4::start(CoreClock {
        pll: (PllMul::MUL384, PllPDiv::DIV4, PllQDiv::DIV8),
        apb: (APBPrescaler::DIV2, APBPrescaler::DIV1),
    });
    rcc::enable_and_reset::<I2s>();
    super::give_to_i2s([p.PB12.into(), p.PB13.into(), p.PB15.into()], 5);
    super::give_to_serial([p.PA9.into(), p.PA10.into()]);
    Board {
        lights: Lights {
            alive: Output::new(p.PC13, Level::High, Speed::Low),
            clip: None,
            late: None,
            trouble: None,
            inverted: true,
        },
        button: Button {
            pin: Input::new(p.PA0, Pull::Up),
            down: false,
        },
        #[cfg(feature = "usb")]
        usb: crate::usb::Pins {
            port: p.USB_OTG_FS,
            plus: p.PA12,
            minus: p.PA11,
        },
        watchdog: p.IWDG,
        trouble: !crystal,
    }
}

/// The PCM5102A falls silent by itself when its clocks stop, as they do in a reset.
pub fn mute() {}
