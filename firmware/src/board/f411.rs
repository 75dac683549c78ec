//! "Black Pill" of WeAct: STM32F411CE, 96 MHz, with a PCM5102A.

use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllRDiv,
    PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, interrupt, pac, rcc};

use super::{Board, Button, DMA_PRIORITY, Lights};
use crate::clock::SampleClock;
use crate::{audio, i2s, log};

/// The board's name.
pub const NAME: &str = "Black Pill STM32F411";
/// The I2S block.
pub type I2s = embassy_stm32::peripherals::SPI2;
/// Its independent watchdog.
pub type Watchdog = embassy_stm32::peripherals::IWDG;
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

/// I2S2 and the stream and channel of DMA1 that serve it.
pub const SPI: pac::spi::Spi = pac::SPI2;
/// See [`SPI`].
pub const DMA: pac::dma::Dma = pac::DMA1;
/// See [`SPI`].
pub const STREAM: usize = 4;
/// See [`SPI`].
pub const CHANNEL: u8 = 0;

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
    let crystal = super::f4::crystal_starts();
    // The internal 16 MHz serve in need, at the same 1 MHz into the loops: 1 % off pitch, but it sounds.
    let (source, prediv) = if crystal {
        (PllSource::HSE, PllPreDiv::from(CLOCK.m as u8))
    } else {
        log::error!("the crystal does not start");
        (PllSource::HSI, PllPreDiv::DIV16)
    };
    let mut config = Config::default();
    config.dma_interrupt_priority = DMA_PRIORITY;
    config.rcc.hse = crystal.then_some(Hse {
        freq: Hertz(CLOCK.crystal),
        mode: HseMode::Oscillator,
    });
    config.rcc.pll_src = source;
    // 96 MHz for the core, 48 MHz for USB.
    config.rcc.pll = Some(Pll {
        prediv,
        mul: PllMul::MUL384,
        divp: Some(PllPDiv::DIV4),
        divq: Some(PllQDiv::DIV8),
        divr: None,
    });
    config.rcc.plli2s = Some(Pll {
        prediv,
        mul: PllMul::from(CLOCK.n as u16),
        divp: None,
        divq: None,
        divr: Some(PllRDiv::from(CLOCK.r as u8)),
    });
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV1;
    config.rcc.sys = Sysclk::PLL1_P;
    let p = embassy_stm32::init(config);
    super::f4::speed_up();
    rcc::enable_and_reset::<I2s>();
    let af5 = AfType::output(OutputType::PushPull, Speed::VeryHigh);
    for mut pin in [Flex::new(p.PB12), Flex::new(p.PB13), Flex::new(p.PB15)] {
        pin.set_as_af_unchecked(5, af5);
        core::mem::forget(pin);
    }
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
        watchdog: p.IWDG,
        trouble: !crystal,
    }
}

/// The PCM5102A falls silent by itself when its clocks stop, as they do in a reset.
pub fn mute() {}
