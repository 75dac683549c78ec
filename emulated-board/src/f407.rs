//! The STM32F407VG of an STM32F407G-DISC1: RM0090, DS8626.

use rigless::device::Level;
use rigless::soc::{Cpu, Endian, Region};

use crate::f4::Sheet;
use crate::flash;
use crate::part::Facts;

pub(crate) static SHEET: Sheet = Sheet {
    facts: Facts {
        core_hz: 168_000_000,
        crystal_hz: 8_000_000,
        flash: (flash::BASE, SIZE),
        ram: &[
            (0x2000_0000, 128 << 10),
            (0x1000_0000, 64 << 10),
            (0x4002_4000, 4 << 10),
        ],
        identity: 0x1FFF_7A10,
        flash_size: 0x1FFF_7A22,
    },
    // Table 62: up to the FPU's, 81.
    cpu: Cpu::new("CM4", true, 82, Endian::Little),
    memory: &MEMORY,
    nothing: &[
        ("below flash", 0x0010_0000, 0x0800_0000),
        ("below CCM", 0x0810_0000, 0x1000_0000),
        ("above CCM", 0x1001_0000, 0x1FFF_0000),
        ("above SRAM", 0x2002_0000, 0x2200_0000),
    ],
    // Revision 2, 38.6.1.
    idcode: 0x2003_6413,
    absent: &[
        "GPIOJ",
        "GPIOK",
        "SPI4",
        "SPI5",
        "SPI6",
        "UART7",
        "UART8",
        "SAI1",
        "LTDC",
        "DMA2D",
        "OTG_HS_PWRCLK",
    ],
    audio_divider: false,
    i2s: "SPI3",
    // LD4 green, LD3 orange, LD5 red, LD6 blue: PD12 to PD15.
    leds: &[(3, 12), (3, 13), (3, 14), (3, 15)],
    lit: Level::High,
    // PD4.
    codec_reset: Some((3, 4)),
    button: [Some(Level::Low), Some(Level::High)],
    supply_mv: 3_000,
};

/// The flash array, bytes.
const SIZE: u32 = 1 << 20;

/// Section 2.3, DS8626 figure 18.
static MEMORY: [Region; 5] = [
    Region::flash("flash", flash::BASE as u64, SIZE as u64)
        .erased_to(0xFF)
        .programmed_by("FLASH"),
    Region::ram("ccm", 0x1000_0000, 64 << 10),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
    Region::ram("backup_sram", 0x4002_4000, 4 << 10),
];
