//! What the STM32F4 boards share: the crystal, the clocks, the flash.

use embassy_stm32::pac::{FLASH, RCC};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllRDiv,
    PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, Peripherals};

use super::{CLOCK, DMA_PRIORITY};
use crate::log;

/// The internal oscillator, Hz.
const INTERNAL: u32 = 16_000_000;
/// Turns of the loop that waits for the crystal; at 16 MHz well over the 10 ms that a crystal may take.
const PATIENCE: u32 = 200_000;

/// The core's clocks, from what comes out of the input divider that the sample clock has too.
pub struct CoreClock {
    /// Multiplier of the main loop, and its dividers for the core and for USB.
    pub pll: (PllMul, PllPDiv, PllQDiv),
    /// Dividers of the two peripheral buses.
    pub apb: (APBPrescaler, APBPrescaler),
}

/// Starts the clocks and embassy. False where the crystal does not start: the internal oscillator serves in need, at the
/// same rate into the loops; 1 % off pitch, but it sounds.
pub fn start(core: CoreClock) -> (Peripherals, bool) {
    let crystal = crystal_starts();
    if !crystal {
        log::error!("the crystal does not start");
    }
    let (source, input) = if crystal {
        (PllSource::HSE, CLOCK.crystal)
    } else {
        (PllSource::HSI, INTERNAL)
    };
    let prediv = PllPreDiv::from((input / (CLOCK.crystal / CLOCK.m)) as u8);
    let mut config = Config::default();
    config.dma_interrupt_priority = DMA_PRIORITY;
    config.rcc.hse = crystal.then_some(Hse {
        freq: Hertz(CLOCK.crystal),
        mode: HseMode::Oscillator,
    });
    config.rcc.pll_src = source;
    config.rcc.pll = Some(Pll {
        prediv,
        mul: core.pll.0,
        divp: Some(core.pll.1),
        divq: Some(core.pll.2),
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
    (config.rcc.apb1_pre, config.rcc.apb2_pre) = core.apb;
    config.rcc.sys = Sysclk::PLL1_P;
    let peripherals = embassy_stm32::init(config);
    speed_up();
    (peripherals, crystal)
}

/// Starts the crystal and waits for it. embassy would wait for ever.
fn crystal_starts() -> bool {
    RCC.cr().modify(|w| w.set_hseon(true));
    (0..PATIENCE).any(|_| RCC.cr().read().hserdy())
}

/// Switches on what makes up for the flash's wait states: prefetch and both caches.
fn speed_up() {
    FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
}
