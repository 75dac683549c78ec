//! NUCLEO-H743ZI2: STM32H743ZI, 480 MHz, with a PCM5102A. Pins from its manual, UM2407.

use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};

use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk,
    VoltageScale,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, interrupt, pac, rcc};

use super::{Board, Button, DMA_PRIORITY, Lights};
use crate::clock::SampleClock;
use crate::dma::Stream;
use crate::{audio, i2s, log};

/// The board's name.
pub const NAME: &str = "NUCLEO-H743ZI2";
/// The I2S block.
pub type I2s = embassy_stm32::peripherals::SPI3;
/// Its independent watchdog.
pub type Watchdog = embassy_stm32::peripherals::IWDG1;
/// Clock of the core, Hz.
pub const CORE: u32 = 480_000_000;
/// What it can hold.
pub type Capacity = freshet::profile::H743;

/// 8 MHz / 5 · 240 / 5 = 76.8 MHz = 48 000 · 64 · 25. The clock comes from the probe on the board.
pub const CLOCK: SampleClock = SampleClock {
    crystal: 8_000_000,
    m: 5,
    n: 240,
    r: 5,
    div: 12,
    odd: true,
    master_clock: false,
};

/// I2S3, the stream that serves it, and what that is asked by (RM0433 table 121).
pub const SPI: pac::spi::Spi = pac::SPI3;
/// See [`SPI`].
pub const DMA: Stream = Stream::new(pac::DMA1, 0);
/// See [`SPI`].
pub const REQUEST: u8 = 62;

/// The USART on the probe's serial port, the streams that serve it, and what those are asked by, in and out.
pub const SERIAL: pac::usart::Usart = pac::USART3;
/// See [`SERIAL`].
pub type SerialPort = embassy_stm32::peripherals::USART3;
/// See [`SERIAL`].
pub const SERIAL_RX: Stream = Stream::new(pac::DMA1, 1);
/// See [`SERIAL`].
pub const SERIAL_TX: Stream = Stream::new(pac::DMA1, 2);
/// See [`SERIAL`].
pub const SERIAL_REQUESTS: [u8; 2] = [45, 46];

/// An interrupt that nothing on this board uses: it stands for the audio task.
pub const AUDIO_INTERRUPT: interrupt::Interrupt = interrupt::UART5;

#[interrupt]
unsafe fn UART5() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { audio::EXECUTOR.on_interrupt() }
}

#[interrupt]
fn DMA1_STREAM0() {
    i2s::on_interrupt();
}

/// Turns of the loop that waits for the clock; at 64 MHz well over 10 ms.
const PATIENCE: u32 = 400_000;

/// Starts the outside clock and waits for it. embassy would wait for ever.
fn clock_starts() -> bool {
    pac::RCC.cr().modify(|w| w.set_hsebyp(true));
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    (0..PATIENCE).any(|_| pac::RCC.cr().read().hserdy())
}

/// Sets up clocks and pins.
pub fn init() -> Board {
    let clock = clock_starts();
    // The internal 64 MHz serve in need, at the same 1.6 MHz into the loops: 1 % off pitch, but it sounds.
    let (source, prediv) = if clock {
        (PllSource::HSE, PllPreDiv::from(CLOCK.m as u8))
    } else {
        log::error!("the clock from the probe does not start");
        (PllSource::HSI, PllPreDiv::DIV40)
    };
    let mut config = Config::default();
    config.dma_interrupt_priority = DMA_PRIORITY;
    config.rcc.hse = clock.then_some(Hse {
        freq: Hertz(CLOCK.crystal),
        mode: HseMode::Bypass,
    });
    // 8 MHz / 4 · 480 / 2 = 480 MHz for the core.
    config.rcc.pll1 = Some(Pll {
        source,
        prediv: if clock {
            PllPreDiv::DIV4
        } else {
            PllPreDiv::DIV32
        },
        mul: PllMul::MUL480,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.pll2 = Some(Pll {
        source,
        prediv,
        mul: PllMul::from(CLOCK.n as u16 - 1),
        fracn: None,
        divp: Some(PllDiv::from(CLOCK.r as u8 - 1)),
        divq: None,
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.d1c_pre = AHBPrescaler::DIV1;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.apb3_pre = APBPrescaler::DIV2;
    config.rcc.apb4_pre = APBPrescaler::DIV2;
    config.rcc.voltage_scale = VoltageScale::Scale0;
    config.rcc.mux.spi123sel = rcc::mux::Saisel::PLL2_P;
    #[cfg(feature = "usb")]
    {
        // 48 MHz of its own, trimmed by what the host sends.
        config.rcc.hsi48 = Some(rcc::Hsi48Config {
            sync_from_usb: true,
        });
        config.rcc.mux.usbsel = rcc::mux::Usbsel::HSI48;
    }
    let p = embassy_stm32::init(config);
    // Flash is eight times as slow as the core. No cache for data: it is in the DTCM, and DMA's buffer needs none.
    // SAFETY: only this touches the caches, and nothing but the start runs yet.
    unsafe { cortex_m::Peripherals::steal() }
        .SCB
        .enable_icache();
    rcc::enable_and_reset::<I2s>();
    super::give_to_i2s([p.PC10.into(), p.PC12.into(), p.PA4.into()], 6);
    super::give_to_serial([p.PD8.into(), p.PD9.into()]);
    Board {
        lights: Lights {
            alive: Output::new(p.PB0, Level::Low, Speed::Low),
            clip: Some(Output::new(p.PE1, Level::Low, Speed::Low)),
            late: Some(Output::new(p.PB14, Level::Low, Speed::Low)),
            trouble: None,
            inverted: false,
        },
        button: Button {
            pin: Input::new(p.PC13, Pull::Down),
            down: true,
        },
        #[cfg(feature = "usb")]
        usb: crate::usb::Pins {
            port: p.USB_OTG_FS,
            plus: p.PA12,
            minus: p.PA11,
        },
        watchdog: p.IWDG1,
        trouble: !clock,
    }
}

/// The PCM5102A falls silent by itself when its clocks stop, as they do in a reset.
pub fn mute() {}
