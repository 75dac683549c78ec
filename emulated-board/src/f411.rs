//! The STM32F411CE of a WeAct "Black Pill" with a DAC that needs no setting up: RM0383, DS10314.

use rigless::device::Level;
use rigless::soc::{Cpu, Endian, Region};

use crate::f4::Sheet;
use crate::flash;
use crate::part::Facts;

pub(crate) static SHEET: Sheet = Sheet {
    facts: Facts {
        core_hz: 96_000_000,
        crystal_hz: 25_000_000,
        flash: (flash::BASE, SIZE),
        ram: &[(0x2000_0000, 128 << 10)],
        identity: 0x1FFF_7A10,
        flash_size: 0x1FFF_7A22,
    },
    // RM0383 table 37: up to that of SPI5, 85.
    cpu: Cpu::new("CM4", true, 86, Endian::Little),
    memory: &MEMORY,
    nothing: &[
        ("below flash", 0x0008_0000, 0x0800_0000),
        ("above flash", 0x0808_0000, 0x1FFF_0000),
        ("above SRAM", 0x2002_0000, 0x2200_0000),
    ],
    // Revision A, RM0383 23.6.1.
    idcode: 0x1000_6431,
    absent: &[
        "GPIOF",
        "GPIOG",
        "GPIOI",
        "GPIOJ",
        "GPIOK",
        "TIM6",
        "TIM7",
        "TIM8",
        "TIM12",
        "TIM13",
        "TIM14",
        "USART3",
        "UART4",
        "UART5",
        "UART7",
        "UART8",
        "SPI6",
        "SAI1",
        "CAN1",
        "CAN2",
        "DAC",
        "ADC2",
        "ADC3",
        "Ethernet_MAC",
        "Ethernet_MMC",
        "Ethernet_PTP",
        "Ethernet_DMA",
        "LTDC",
        "DMA2D",
        "OTG_HS_GLOBAL",
        "OTG_HS_HOST",
        "OTG_HS_DEVICE",
        "OTG_HS_PWRCLK",
        "DCMI",
        "CRYP",
        "HASH",
        "RNG",
        "FMC",
    ],
    // RM0383 6.3.20.
    audio_divider: true,
    i2s: "SPI2",
    // PC13, between the pin and the rail.
    leds: &[(2, 13)],
    lit: Level::Low,
    codec_reset: None,
    // To ground; the pull-up is the firmware's.
    button: [None, Some(Level::Low)],
    supply_mv: 3_300,
};

/// The flash array, bytes.
const SIZE: u32 = 512 << 10;

/// RM0383 section 2.3.
static MEMORY: [Region; 3] = [
    Region::flash("flash", flash::BASE as u64, SIZE as u64)
        .erased_to(0xFF)
        .programmed_by("FLASH"),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
];
