//! The STM32F4, put together from rigless' STM32F427 models and the ones it lacks: a memory map of its
//! own, a flash that programs, external interrupts and an I2S. What differs from part to part is in
//! `f407` and `f411`.
//!
//! Citations are of RM0090, whose even chapters of each pair are the F405/407's; the F411 has the same
//! blocks.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::cpu::armv7m::{self, Dwt};
use rigless::device::{ErasedDevice, Level, ResetCause};
use rigless::emulator::CoreSpec;
use rigless::machine::armv7m::{Core, Fpu, MpuRegions, Variant};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::generated::{rcc as rcc_table, usart6};
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::i2c::I2c;
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc::HSI_HZ;
use rigless::soc::stm32f427::peripherals::rtc::Rtc;
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::stm32f427::peripherals::{CONTROLLERS, Controller, TIMERS};
use rigless::soc::{
    Bus, Clock, Cpu, Error, Gate, Layout, Region, RegisterSpec, WriteModify, stm32f427,
};
use rigless::time::VirtualNanos;

use crate::clocks::{Clocks, I2S_KERNEL};
use crate::exti::{Exti, Selection, Syscfg};
use crate::flash::{self, Flash};
use crate::i2s_f4::{self, I2sF4};
use crate::part::{Facts, Fittings, Part};
use crate::serial::Terminal;
use crate::timer::Timer;
use crate::wires::{self, PinName, Wires};

/// What sets one part of the family apart, and the board it is on.
#[derive(Debug)]
pub(crate) struct Sheet {
    pub(crate) facts: Facts,
    pub(crate) cpu: Cpu,
    pub(crate) memory: &'static [Region],
    /// What lies between the memories, where an access is a bus fault: a stack that overflows meets it. Name, first
    /// address and end.
    pub(crate) nothing: &'static [(&'static str, u64, u64)],
    /// `DBGMCU_IDCODE`.
    pub(crate) idcode: u64,
    /// What the F427 has and this part has not.
    pub(crate) absent: &'static [&'static str],
    /// Whether the PLLI2S has an input divider of its own.
    pub(crate) audio_divider: bool,
    /// The I2S the board plays on.
    pub(crate) i2s: &'static str,
    pub(crate) leds: &'static [PinName],
    /// What lights one.
    pub(crate) lit: Level,
    /// The codec's reset; none where there is no codec to set up.
    pub(crate) codec_reset: Option<PinName>,
    /// What drives the button's pin while it is up, and while it is down.
    pub(crate) button: [Option<Level>; 2],
    /// The rail, mV.
    pub(crate) supply_mv: u32,
}

/// The button of both boards, PA0.
const BUTTON_PIN: u8 = 0;

/// Each instance that answers behind a clock, with its enable and its reset bit, sections 7.3.5 to
/// 7.3.14. ST's file spells the resets of USART2 and USART3 in its own way.
const GATES: [(&str, &str, &str, &str, &str); 27] = [
    ("GPIOA", "AHB1ENR", "GPIOAEN", "AHB1RSTR", "GPIOARST"),
    ("GPIOB", "AHB1ENR", "GPIOBEN", "AHB1RSTR", "GPIOBRST"),
    ("GPIOC", "AHB1ENR", "GPIOCEN", "AHB1RSTR", "GPIOCRST"),
    ("GPIOD", "AHB1ENR", "GPIODEN", "AHB1RSTR", "GPIODRST"),
    ("GPIOE", "AHB1ENR", "GPIOEEN", "AHB1RSTR", "GPIOERST"),
    ("GPIOF", "AHB1ENR", "GPIOFEN", "AHB1RSTR", "GPIOFRST"),
    ("GPIOG", "AHB1ENR", "GPIOGEN", "AHB1RSTR", "GPIOGRST"),
    ("GPIOH", "AHB1ENR", "GPIOHEN", "AHB1RSTR", "GPIOHRST"),
    ("GPIOI", "AHB1ENR", "GPIOIEN", "AHB1RSTR", "GPIOIRST"),
    ("DMA1", "AHB1ENR", "DMA1EN", "AHB1RSTR", "DMA1RST"),
    ("DMA2", "AHB1ENR", "DMA2EN", "AHB1RSTR", "DMA2RST"),
    ("TIM2", "APB1ENR", "TIM2EN", "APB1RSTR", "TIM2RST"),
    ("TIM3", "APB1ENR", "TIM3EN", "APB1RSTR", "TIM3RST"),
    ("TIM4", "APB1ENR", "TIM4EN", "APB1RSTR", "TIM4RST"),
    ("TIM5", "APB1ENR", "TIM5EN", "APB1RSTR", "TIM5RST"),
    ("SPI3", "APB1ENR", "SPI3EN", "APB1RSTR", "SPI3RST"),
    ("USART2", "APB1ENR", "USART2EN", "APB1RSTR", "UART2RST"),
    ("USART3", "APB1ENR", "USART3EN", "APB1RSTR", "UART3RST"),
    ("UART4", "APB1ENR", "UART4EN", "APB1RSTR", "UART4RST"),
    ("UART5", "APB1ENR", "UART5EN", "APB1RSTR", "UART5RST"),
    ("I2C1", "APB1ENR", "I2C1EN", "APB1RSTR", "I2C1RST"),
    ("I2C2", "APB1ENR", "I2C2EN", "APB1RSTR", "I2C2RST"),
    ("I2C3", "APB1ENR", "I2C3EN", "APB1RSTR", "I2C3RST"),
    ("PWR", "APB1ENR", "PWREN", "APB1RSTR", "PWRRST"),
    ("USART1", "APB2ENR", "USART1EN", "APB2RSTR", "USART1RST"),
    ("USART6", "APB2ENR", "USART6EN", "APB2RSTR", "USART6RST"),
    ("SYSCFG", "APB2ENR", "SYSCFGEN", "APB2RSTR", "SYSCFGRST"),
];

/// A row of any register table, to carry reset values from one bus to another.
#[derive(Debug, Clone, Copy)]
struct Row(usize);

impl Layout for Row {
    const REGISTERS: &'static [RegisterSpec] = &[];

    fn from_index(index: usize) -> Option<Self> {
        Some(Self(index))
    }

    fn index(self) -> usize {
        self.0
    }
}

impl Sheet {
    /// Whether it has an instance of the F427.
    fn has(&self, instance: &str) -> bool {
        !self.absent.contains(&instance)
    }
}

/// The bus: rigless' F427 corrected and cut down, with this part's memory, gates and wires.
fn bus(sheet: &Sheet) -> Result<Bus, Error> {
    let wider = stm32f427::builder().build()?;
    let kept = || {
        wider
            .slots()
            .iter()
            .filter(|slot| sheet.has(slot.peripheral().name))
    };
    let instances = kept()
        .map(|slot| *slot.peripheral())
        .chain([wires::INSTANCE]);
    let mut builder = Bus::builder(sheet.cpu, sheet.memory, instances);
    for slot in kept() {
        for (row, register) in slot.peripheral().registers.iter().enumerate() {
            let value = slot.registers().get(Row(row));
            if value != register.reset {
                builder = builder.reset(slot.peripheral().name, register.name, value);
            }
        }
    }
    builder = builder.reset("DBG", "DBGMCU_IDCODE", sheet.idcode);
    // The flags that clear by writing, which ST's file does not say: 18.4.5, 27.6.6, 3.8.4, 12.3.6.
    for timer in TIMERS {
        builder = builder.write_modify(timer.instance, "SR", WriteModify::ZeroToClear);
    }
    for interface in I2CS {
        builder = builder.write_modify(interface, "SR1", WriteModify::ZeroToClear);
    }
    builder = builder
        .write_modify("FLASH", "SR", WriteModify::OneToClear)
        .write_modify("EXTI", "PR", WriteModify::OneToClear);
    let gates = GATES.into_iter().filter(|gate| sheet.has(gate.0));
    for (instance, enable, on, reset, off) in gates {
        builder = builder
            .gate(instance, Gate::by("RCC", enable, on))
            .reset_by(instance, Gate::by("RCC", reset, off));
    }
    // 5.4.1 bit 8: the backup domain takes no write until the power controller lets it.
    builder = builder
        .gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP"))
        .gate_writes("RTC", &[], Gate::by("PWR", "CR", "DBP"));
    for name in CLOCKED
        .iter()
        .copied()
        .chain(USARTS.iter().map(|usart| usart.0))
        .filter(|name| sheet.has(name))
    {
        if let Some(clock) = wider.clock_of(name) {
            builder = builder.clocked_by(name, clock);
        }
    }
    builder = builder.clocked_by(sheet.i2s, Clock::output("RCC", I2S_KERNEL));
    for sink in ["RCC", "RTC", "DMA1", "DMA2", "EXTI", "WIRES"] {
        builder = builder.reads_requests(sink);
    }
    for (name, base, end) in sheet.nothing {
        builder = builder.aborts_in(name, *base, end - base);
    }
    builder.routes_interrupts("WIRES").build()
}

const I2CS: [&str; 3] = ["I2C1", "I2C2", "I2C3"];
const USARTS: [(&str, Kind); 6] = [
    ("USART1", Kind::Usart),
    ("USART2", Kind::Usart),
    ("USART3", Kind::Usart),
    ("USART6", Kind::Usart),
    ("UART4", Kind::Uart),
    ("UART5", Kind::Uart),
];
/// The port the terminal is on: USART2, PA2 and PA3.
const SERIAL: usize = 1;
const PORTS: [&str; 9] = [
    "GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "GPIOH", "GPIOI",
];
/// The instances that keep time, besides the serial ports.
const CLOCKED: [&str; 9] = [
    "TIM2",
    "TIM3",
    "TIM4",
    "TIM5",
    "I2C1",
    "I2C2",
    "I2C3",
    "IWDG",
    armv7m::DWT,
];

/// Which model answers for a slot.
#[derive(Debug, Clone, Copy)]
enum Field {
    None,
    Rcc,
    Pwr,
    Rtc,
    Dbg,
    Dwt,
    Iwdg,
    Flash,
    Exti,
    Syscfg,
    Wires,
    I2s,
    Gpio(usize),
    Usart(usize),
    I2c(usize),
    Tim(usize),
    Dma(usize),
}

fn field(instance: &str, i2s: &str) -> Field {
    let nth = |names: &[&str]| names.iter().position(|name| *name == instance);
    match instance {
        "RCC" => Field::Rcc,
        "PWR" => Field::Pwr,
        "RTC" => Field::Rtc,
        "DBG" => Field::Dbg,
        "IWDG" => Field::Iwdg,
        "FLASH" => Field::Flash,
        "EXTI" => Field::Exti,
        "SYSCFG" => Field::Syscfg,
        "WIRES" => Field::Wires,
        _ if instance == i2s => Field::I2s,
        armv7m::DWT => Field::Dwt,
        _ => nth(&PORTS)
            .map(Field::Gpio)
            .or_else(|| nth(&USARTS.map(|usart| usart.0)).map(Field::Usart))
            .or_else(|| nth(&I2CS).map(Field::I2c))
            .or_else(|| nth(&TIMERS.map(|timer| timer.instance)).map(Field::Tim))
            .or_else(|| nth(&CONTROLLERS.each_ref().map(|one| one.instance)).map(Field::Dma))
            .unwrap_or(Field::None),
    }
}

/// The models a reset builds anew.
#[derive(Debug)]
struct Models {
    rcc: Clocks,
    pwr: Pwr,
    rtc: Rtc,
    dbg: Dbg,
    dwt: Dwt,
    iwdg: Iwdg,
    flash: Flash,
    exti: Exti,
    syscfg: Syscfg,
    i2s: I2sF4,
    gpio: [Gpio; PORTS.len()],
    usart: [Usart; USARTS.len()],
    i2c: [I2c; I2CS.len()],
    tim: [Timer; TIMERS.len()],
    dma: [Dma; CONTROLLERS.len()],
}

impl Models {
    fn new(sheet: &Sheet, fittings: &Fittings, options: u32, bus: &mut Bus) -> Result<Self, Error> {
        let selection = Selection::default();
        let mut pwr = Pwr::new();
        let slot = bus.slot("PWR")?;
        pwr.set_supply(sheet.supply_mv, bus.slot_mut(slot).registers_mut());
        let slot = bus.slot("FLASH")?;
        let flash = Flash::new(
            options,
            sheet.facts.flash.1,
            bus.slot_mut(slot).registers_mut(),
        );
        Ok(Self {
            rcc: Clocks::new(fittings.crystal_hz, sheet.audio_divider),
            pwr,
            rtc: Rtc,
            dbg: Dbg,
            dwt: Dwt::with_clock(HSI_HZ),
            iwdg: Iwdg::new(),
            flash,
            exti: Exti::new(selection.clone()),
            syscfg: Syscfg::new(selection),
            i2s: I2sF4::new(fittings.record.clone()),
            gpio: std::array::from_fn(|_| Gpio::default()),
            usart: std::array::from_fn(|nth| Usart::with_clock(USARTS[nth].1, HSI_HZ)),
            i2c: std::array::from_fn(|_| I2c::with_clock(HSI_HZ)),
            tim: std::array::from_fn(|nth| Timer::new(HSI_HZ, TIMERS[nth].counter)),
            dma: std::array::from_fn(|nth| {
                let Controller {
                    wiring,
                    last_data,
                    reaches_memory,
                    ..
                } = CONTROLLERS[nth];
                Dma::new(wiring, last_data, reaches_memory)
            }),
        })
    }
}

/// The part.
#[derive(Debug)]
pub(crate) struct F4 {
    sheet: &'static Sheet,
    bus: Bus,
    wiring: Box<[Field]>,
    models: Models,
    wires: Wires,
    fittings: Fittings,
    pressed: bool,
    slots: Slots,
}

/// The slots reached by name.
#[derive(Debug, Clone, Copy)]
struct Slots {
    rcc: usize,
    rtc: usize,
    button: usize,
    serial: usize,
    i2s: usize,
    wires: usize,
}

impl F4 {
    pub(crate) fn new(sheet: &'static Sheet, fittings: Fittings) -> Result<Self, Error> {
        let mut bus = bus(sheet)?;
        let wiring = bus
            .slots()
            .iter()
            .map(|slot| field(slot.peripheral().name, sheet.i2s))
            .collect();
        let slots = Slots {
            rcc: bus.slot("RCC")?,
            rtc: bus.slot("RTC")?,
            button: bus.slot("GPIOA")?,
            serial: bus.slot("USART2")?,
            i2s: bus.slot(sheet.i2s)?,
            wires: bus.slot("WIRES")?,
        };
        let options = fittings.options.unwrap_or(flash::FACTORY_OPTIONS);
        let mut models = Models::new(sheet, &fittings, options, &mut bus)?;
        models.usart[SERIAL].attach(Terminal::new(fittings.record.clone()));
        if sheet.codec_reset.is_some() {
            models.i2c[0].attach(fittings.codec.clone());
        }
        let wires = Wires::new(
            fittings.record.clone(),
            sheet.leds,
            sheet.lit,
            fittings.codec.clone(),
            sheet.codec_reset,
        );
        let mut part = Self {
            sheet,
            bus,
            wiring,
            models,
            wires,
            fittings,
            pressed: false,
            slots,
        };
        part.button(VirtualNanos(0), false);
        part.check()?;
        Ok(part)
    }
}

impl Mcu for F4 {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// A system reset, 7.1.1: everything anew but the backup domain, the reset flags, the option
    /// bytes and what hangs on the pins.
    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        let flags = self.bus.slots()[self.slots.rcc]
            .registers()
            .get(rcc_table::Register::Csr);
        let backup = self.bus.slots()[self.slots.rcc]
            .registers()
            .get(rcc_table::Register::Bdcr);
        let calendar = self.bus.slots()[self.slots.rtc]
            .peripheral()
            .registers
            .len();
        let calendar: Vec<u64> = (0..calendar)
            .map(|row| self.bus.slots()[self.slots.rtc].registers().get(Row(row)))
            .collect();
        self.bus.reset();
        let fresh = Models::new(
            self.sheet,
            &self.fittings,
            self.models.flash.options(),
            &mut self.bus,
        )
        .expect("the part was built from these instances");
        let mut old = std::mem::replace(&mut self.models, fresh);
        for (usart, old) in self.models.usart.iter_mut().zip(&mut old.usart) {
            usart.inherit(old);
        }
        for (i2c, old) in self.models.i2c.iter_mut().zip(&mut old.i2c) {
            i2c.inherit(old);
        }
        let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
        registers.set(rcc_table::Register::Bdcr, backup);
        self.models.rcc.restarted(cause, flags, registers);
        // The table's own layout has to be named to set a register, and any row will do for one.
        let registers = self.bus.slot_mut(self.slots.rtc).registers_mut();
        for (register, value) in stm32f427::generated::rtc::Register::ALL
            .into_iter()
            .zip(calendar)
        {
            registers.set(register, value);
        }
        self.wires.restarted(at);
        self.button(at, self.pressed);
    }

    fn poll(&mut self, now: VirtualNanos) {
        // Only the serial line has anything outside that is no event of its own.
        let (registers, mut context) = self.bus.drive(now, self.slots.serial);
        rigless::device::Device::poll(&mut self.models.usart[SERIAL], registers, &mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let models = &mut self.models;
        let field = self.wiring.get(slot).copied().unwrap_or(Field::None);
        let model: Option<&mut dyn ErasedDevice> = match field {
            Field::None => None,
            Field::Rcc => Some(&mut models.rcc),
            Field::Pwr => Some(&mut models.pwr),
            Field::Rtc => Some(&mut models.rtc),
            Field::Dbg => Some(&mut models.dbg),
            Field::Dwt => Some(&mut models.dwt),
            Field::Iwdg => Some(&mut models.iwdg),
            Field::Flash => Some(&mut models.flash),
            Field::Exti => Some(&mut models.exti),
            Field::Syscfg => Some(&mut models.syscfg),
            Field::Wires => Some(&mut self.wires),
            Field::I2s => Some(&mut models.i2s),
            Field::Gpio(nth) => Some(&mut models.gpio[nth]),
            Field::Usart(nth) => Some(&mut models.usart[nth]),
            Field::I2c(nth) => Some(&mut models.i2c[nth]),
            Field::Tim(nth) => Some(&mut models.tim[nth]),
            Field::Dma(nth) => Some(&mut models.dma[nth]),
        };
        (&mut self.bus, model)
    }
}

impl Part for F4 {
    fn core(&self, instructions_per_second: NonZeroU64) -> CoreSpec {
        let one = |value: u32| NonZeroU32::new(value).unwrap_or(NonZeroU32::MIN);
        Core {
            variant: Variant::M4,
            clock_hz: NonZeroU64::new(self.sheet.facts.core_hz).unwrap_or(NonZeroU64::MIN),
            interrupt_lines: one(u32::from(self.sheet.cpu.interrupt_lines)),
            priority_bits: 4,
            refclk_divider: one(8),
            instructions_per_second,
            boot: "flash",
        }
        .spec_with_parts(&armv7m::windows(&self.bus), Fpu::FpV4Sp, MpuRegions::Eight)
    }

    fn power_on(&mut self) {
        for slot in [self.slots.rcc, self.slots.rtc] {
            self.bus.slot_mut(slot).registers_mut().reset();
        }
        self.models.rcc = Clocks::new(self.fittings.crystal_hz, self.sheet.audio_divider);
    }

    fn type_serial(&mut self, bytes: &[u8]) {
        if let Some(terminal) = self.models.usart[SERIAL].chip_mut::<Terminal>() {
            terminal.send(bytes);
        }
    }

    fn serial_divider(&mut self, clocks: u32) {
        let registers = self.bus.slot_mut(self.slots.serial).registers_mut();
        registers.set(usart6::Register::Brr, u64::from(clocks));
    }

    fn garble_serial(&mut self, per_million: u32) {
        let errors = self.models.usart[SERIAL].errors_mut();
        errors.framing = rigless::chip::uart::Rate {
            name: "framing",
            per_million,
        };
    }

    fn button(&mut self, at: VirtualNanos, pressed: bool) {
        self.pressed = pressed;
        let level = self.sheet.button[usize::from(pressed)];
        let (registers, mut context) = self.bus.drive(at, self.slots.button);
        if let Some(pin) = Pin::new(BUTTON_PIN) {
            self.models.gpio[0].drive(pin, level, registers, &mut context);
        }
    }

    fn cut_interrupt(&mut self, at: VirtualNanos, line: u16, until: VirtualNanos) -> bool {
        let (_, mut context) = self.bus.drive(at, self.slots.wires);
        self.wires.cut(line, until, &mut context);
        true
    }

    fn flash_operation(&self) -> Option<flash::Operation> {
        self.models.flash.operation()
    }

    fn options(&self) -> u32 {
        self.models.flash.options()
    }

    fn sample_rate(&self) -> f64 {
        let registers = self.bus.slots()[self.slots.i2s].registers();
        i2s_f4::sample_rate(self.models.rcc.i2s_kernel_hz(), registers)
    }
}
