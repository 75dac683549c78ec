//! The STM32H743ZI: rigless' own part, with an I2S, a watchdog and the board's wires put in.
//!
//! Citations are of RM0433. What rigless' part carries of the chip is told in its own documentation; the
//! data cache is not there, so firmware that forgets to clean it runs here all the same.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::cpu::armv7m;
use rigless::device::{ErasedDevice, Level, ResetCause};
use rigless::emulator::CoreSpec;
use rigless::machine::armv7m::{
    BranchPrediction, Caches, Config, Core, Fpu, ImplementationRegister, MpuRegions, Variant,
};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::{self, flash as flash_table, rcc, tim2};
use rigless::soc::stm32h743::peripherals::exti::Exti;
use rigless::soc::stm32h743::peripherals::gpio::Pin;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::flash;
use crate::i2s_h7::I2sH7;
use crate::part::{Facts, Fittings, Part};
use crate::pins::Pins;
use crate::serial::Terminal;
use crate::watchdog::Watchdog;
use crate::wires::{PinName, Wires};

pub(crate) static FACTS: Facts = Facts {
    core_hz: 480_000_000,
    crystal_hz: 8_000_000,
    flash: (0x0800_0000, 2 << 20),
    ram: &[
        (0x0000_0000, 64 << 10),
        (0x2000_0000, 128 << 10),
        (0x2400_0000, 512 << 10),
        (0x3000_0000, 288 << 10),
        (0x3800_0000, 64 << 10),
    ],
    identity: 0x1FF1_E800,
    flash_size: 0x1FF1_E880,
};

/// LD1 green PB0, LD2 yellow PE1, LD3 red PB14 of the Nucleo.
static LEDS: [PinName; 3] = [(1, 0), (4, 1), (1, 14)];
/// The blue button, PC13.
const BUTTON: (usize, u8) = (2, 13);
/// The port of the probe's serial line: USART3, PD8 and PD9.
const SERIAL: usize = 2;
/// The rail of the board, mV.
const SUPPLY_MV: u32 = 3300;

/// Where the core finds its vectors at reset, table 9: address 0 is the ITCM.
const VECTORS: u32 = 0x0800_0000;
/// A Cortex-M7 r1p1, ES0392 2.1.
const CPUID: u32 = 0x411F_C271;
/// 16 kB of each, PM0253 tables 77 and 81.
const CACHES: Caches = Caches {
    clidr: 0x0900_0003,
    ctr: 0x8303_C003,
    ccsidr: &[0xF00F_E019, 0xF01F_E009],
};
/// The access control registers, PM0253 table 104: offset, reset value and writable bits.
const ACCESS_CONTROL: [(u64, u32, u32); 6] = [
    (0xF90, 0b0111 << 3, 0b111),
    (0xF94, 0b1000 << 3, 0b111),
    (0xF98, 0, 0b1),
    (0xF9C, 0, 0b111),
    (0xFA0, 0b01 << 11, 0x1FFB | 0b11),
    (0xFA8, 0, 0),
];

/// The flags of the four channels in a timer's `SR`.
const COMPARE_FLAGS: u64 = 0b1_1110;

/// The part.
#[derive(Debug)]
pub(crate) struct H743 {
    part: Box<Stm32h743>,
    i2s: I2sH7,
    watchdog: Watchdog,
    pins: Pins,
    /// 0 for a clock that does not start.
    crystal_hz: u64,
    pressed: bool,
    slots: Slots,
}

/// The slots that are answered or looked after here.
#[derive(Debug)]
struct Slots {
    rcc: usize,
    rtc: usize,
    flash: usize,
    spi3: usize,
    iwdg: usize,
    exti: usize,
    timers: Vec<usize>,
}

impl H743 {
    pub(crate) fn new(fittings: Fittings) -> Result<Self, Error> {
        let mut part = Box::new(Stm32h743::new()?);
        part.rcc.attach_crystals(fittings.crystal_hz, 0);
        part.set_supply(SUPPLY_MV);
        part.set_analog_supply(SUPPLY_MV);
        part.usart[SERIAL].attach(Terminal::new(fittings.record.clone()));
        let bus = part.bus();
        let timers = bus.slots().iter().enumerate().filter(|(_, slot)| {
            std::ptr::eq(slot.peripheral().registers, &raw const tim2::REGISTERS)
        });
        let slots = Slots {
            rcc: bus.slot("RCC")?,
            rtc: bus.slot("RTC")?,
            flash: bus.slot("Flash")?,
            spi3: bus.slot("SPI3")?,
            iwdg: bus.slot("IWDG")?,
            exti: bus.slot("EXTI")?,
            timers: timers.map(|(slot, _)| slot).collect(),
        };
        let record = fittings.record;
        let mut part = Self {
            part,
            i2s: I2sH7::new(record.clone()),
            watchdog: Watchdog::default(),
            pins: Pins {
                exti: Exti::new(generated::SYSCFG.base),
                wires: Wires::new(record, &LEDS, Level::High, fittings.codec, None),
            },
            crystal_hz: fittings.crystal_hz,
            pressed: false,
            slots,
        };
        part.button(VirtualNanos(0), false);
        part.check()?;
        Ok(part)
    }

    /// Puts right what rigless' models leave in a register file, before `slot` is reached.
    fn correct(&mut self, slot: usize) {
        let registers = self.part.bus_mut().slot_mut(slot).registers_mut();
        if slot == self.slots.rcc && self.crystal_hz == 0 {
            // rigless has an empty oscillator reach ready at no frequency; a crystal does not.
            registers.restore(rcc::Register::Cr, rcc::cr::HSERDY.mask(), 0);
        }
        // See `timer`: no compare flag while the counter stands.
        let timer = self.slots.timers.contains(&slot);
        if timer && !tim2::cr1::CEN.is_set(registers.get(tim2::Register::Cr1)) {
            registers.restore(tim2::Register::Sr, COMPARE_FLAGS, 0);
        }
    }
}

impl Mcu for H743 {
    fn bus(&self) -> &Bus {
        self.part.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.part.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.part.reset(at, cause);
        self.i2s.reset();
        self.watchdog.reset();
        self.pins.exti = Exti::new(generated::SYSCFG.base);
        self.pins.wires.restarted(at);
        self.button(at, self.pressed);
    }

    fn poll(&mut self, now: VirtualNanos) {
        // Only the serial line has anything outside that is no event of its own.
        let slot = self.part.bus().slot_of("USART3").unwrap_or_default();
        let (bus, Some(model)) = self.part.split(slot) else {
            return;
        };
        let (registers, mut context) = bus.drive(now, slot);
        model.poll(registers, &mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        self.correct(slot);
        let model: &mut dyn ErasedDevice = if slot == self.slots.spi3 {
            &mut self.i2s
        } else if slot == self.slots.iwdg {
            &mut self.watchdog
        } else if slot == self.slots.exti {
            &mut self.pins
        } else {
            return self.part.split(slot);
        };
        (self.part.bus_mut(), Some(model))
    }
}

impl Part for H743 {
    fn core(&self, instructions_per_second: NonZeroU64) -> CoreSpec {
        let one = |value: u32| NonZeroU32::new(value).unwrap_or(NonZeroU32::MIN);
        let core = Core {
            variant: Variant::M7,
            clock_hz: NonZeroU64::new(FACTS.core_hz).unwrap_or(NonZeroU64::MIN),
            interrupt_lines: one(u32::from(self.cpu().interrupt_lines)),
            priority_bits: 4,
            refclk_divider: one(8),
            instructions_per_second,
            boot: "flash",
        };
        let mut config = Config::new(core, &armv7m::windows(self.bus()));
        config.fpu = Fpu::FpV5Dp;
        config.mpu_regions = MpuRegions::Sixteen;
        config.cpuid = CPUID;
        config.caches = Some(CACHES);
        config.branch_prediction = BranchPrediction::Always;
        config.implementation_registers = ACCESS_CONTROL
            .iter()
            .map(|&(offset, reset, writable)| ImplementationRegister {
                offset,
                reset,
                writable,
            })
            .collect();
        config.vector_table = Some(VECTORS);
        config.spec()
    }

    fn power_on(&mut self) {
        let bus = self.part.bus_mut();
        bus.slot_mut(self.slots.rtc).registers_mut().reset();
        bus.slot_mut(self.slots.rcc).registers_mut().reset();
    }

    fn type_serial(&mut self, bytes: &[u8]) {
        if let Some(terminal) = self.part.usart[SERIAL].chip_mut::<Terminal>() {
            terminal.send(bytes);
        }
    }

    fn serial_divider(&mut self, clocks: u32) {
        let slot = self.part.bus().slot_of("USART3").unwrap_or_default();
        let registers = self.part.bus_mut().slot_mut(slot).registers_mut();
        registers.set(generated::usart1::Register::Brr, u64::from(clocks));
    }

    fn garble_serial(&mut self, per_million: u32) {
        let errors = self.part.usart[SERIAL].errors_mut();
        errors.framing = rigless::chip::uart::Rate {
            name: "framing",
            per_million,
        };
    }

    fn button(&mut self, at: VirtualNanos, pressed: bool) {
        self.pressed = pressed;
        let (port, pin) = BUTTON;
        if let Some(pin) = Pin::new(pin) {
            self.part.drive_port(at, port, |port, registers, context| {
                port.drive(pin, Some(Level::from(pressed)), registers, context);
            });
        }
    }

    /// rigless' H743 hands its interrupts straight to the core: there is no wire to cut.
    fn cut_interrupt(&mut self, _at: VirtualNanos, _line: u16, _until: VirtualNanos) -> bool {
        false
    }

    /// Two banks: rigless lets the core run on while one is busy.
    fn flash_operation(&self) -> Option<flash::Operation> {
        None
    }

    fn options(&self) -> u32 {
        let registers = self.bus().slots()[self.slots.flash].registers();
        registers.get(flash_table::Register::OptsrCur) as u32
    }

    fn sample_rate(&self) -> f64 {
        let registers = self.bus().slots()[self.slots.spi3].registers();
        self.i2s.sample_rate(registers)
    }
}
