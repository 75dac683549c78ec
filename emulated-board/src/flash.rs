//! The flash interface of an STM32F405/407 (RM0090 chapter 3): erasing, programming and the option
//! bytes. Its stores really change the array, which outlives every reset.
//!
//! While an operation runs, the core stands still: the code is in the same flash, and RM0090 3.5 has
//! any read of it wait. Peripherals and DMA go on.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::flash::{Register as R, cr, optcr, sr};
use rigless::time::{EventId, VirtualNanos};

/// Where the array starts.
pub(crate) const BASE: u32 = 0x0800_0000;

/// The instance's one interrupt.
const GLOBAL: usize = 0;
/// RM0090 3.5.1 and 3.6.2.
const KEYS: [u64; 2] = [0x4567_0123, 0xCDEF_89AB];
const OPTION_KEYS: [u64; 2] = [0x0819_2A3B, 0x4C5D_6E7F];
/// The factory's option bytes: no protection, brown-out reset off.
pub(crate) const FACTORY_OPTIONS: u32 = 0x0FFF_AAEC;
/// One word of any width, DS8626 table 40, typical.
const PROGRAM_NANOS: u64 = 16_000;
/// Erase times by `PSIZE` in ms, DS8626 table 40, typical: 16, 64 and 128 kB and the whole array.
const ERASE_MS: [[u64; 3]; 4] = [
    [400, 300, 250],
    [1_200, 700, 550],
    [2_000, 1_300, 1_000],
    [16_000, 11_000, 8_000],
];
/// Option bytes are a sector of their own: the time of a small one.
const OPTIONS_NANOS: u64 = 250_000_000;

/// The sectors of the largest array, first address and bytes: four of 16 kB, one of 64 kB, seven of 128 kB.
pub(crate) fn sector(number: u64) -> Option<(u32, u32)> {
    const KB: u32 = 1024;
    let number = u32::try_from(number).ok()?;
    match number {
        0..=3 => Some((BASE + number * 16 * KB, 16 * KB)),
        4 => Some((BASE + 64 * KB, 64 * KB)),
        5..=11 => Some((BASE + (number - 4) * 128 * KB, 128 * KB)),
        _ => None,
    }
}

/// What a power cut would catch half done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Operation {
    /// `bytes` from `start` being erased.
    Erase { start: u32, bytes: u32 },
    /// `bytes` at `address` being programmed; the array already holds the result.
    Program { address: u32, bytes: u32 },
    /// The option bytes.
    Options,
}

/// Progress through a pair of keys; a wrong one locks until the next reset.
#[derive(Debug, Default)]
struct Lock {
    first: bool,
    open: bool,
    dead: bool,
}

impl Lock {
    fn take(&mut self, key: u64, keys: [u64; 2]) {
        match (self.dead || self.open, self.first) {
            (true, _) => {}
            (_, false) if key == keys[0] => self.first = true,
            (_, true) if key == keys[1] => self.open = true,
            _ => self.dead = true,
        }
    }

    fn shut(&mut self) {
        self.open = false;
        self.first = false;
    }
}

/// The flash interface.
#[derive(Debug)]
pub(crate) struct Flash {
    keys: Lock,
    option_keys: Lock,
    control: u64,
    options: u32,
    /// The array, bytes.
    size: u32,
    running: Option<(EventId, Operation)>,
    interrupt: Level,
}

impl Flash {
    /// An interface whose option bytes are `options`, as `OPTCR` shows them.
    pub(crate) fn new(options: u32, size: u32, registers: &mut RegisterFile) -> Self {
        registers.set(
            R::Optcr,
            u64::from(options) & !optcr::OPTSTRT.mask() | optcr::OPTLOCK.mask(),
        );
        Self {
            keys: Lock::default(),
            option_keys: Lock::default(),
            control: cr::LOCK.mask(),
            options,
            size,
            running: None,
            interrupt: Level::Low,
        }
    }

    /// The option bytes as last programmed.
    pub(crate) fn options(&self) -> u32 {
        self.options
    }

    /// What is being done to the array now.
    pub(crate) fn operation(&self) -> Option<Operation> {
        self.running.map(|(_, operation)| operation)
    }

    fn begin(
        &mut self,
        operation: Operation,
        nanos: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let event = context.schedule(VirtualNanos(context.now().0 + nanos));
        self.running = Some((event, operation));
        flag(registers, sr::BSY.mask(), true);
    }

    fn write_control(
        &mut self,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if !self.keys.open || self.running.is_some() {
            registers.set(R::Cr, self.control);
            return;
        }
        if cr::LOCK.is_set(value) {
            self.keys.shut();
        }
        self.control = cr::STRT.set(value, 0);
        if cr::STRT.is_set(value) {
            let size = usize::try_from(cr::PSIZE.get(value)).unwrap_or(0).min(2);
            let erase = if cr::MER.is_set(value) {
                Some((BASE, self.size, 3))
            } else if cr::SER.is_set(value) {
                let sector = sector(cr::SNB.get(value));
                let within = sector.filter(|(start, _)| *start < BASE + self.size);
                within.map(|(start, bytes)| {
                    let row = match bytes >> 10 {
                        16 => 0,
                        64 => 1,
                        _ => 2,
                    };
                    (start, bytes, row)
                })
            } else {
                None
            };
            match erase {
                Some((start, bytes, row)) => {
                    self.control = cr::STRT.set(self.control, 1);
                    let nanos = ERASE_MS[row][size] * 1_000_000;
                    self.begin(Operation::Erase { start, bytes }, nanos, registers, context);
                }
                None => flag(registers, sr::WRPERR.mask(), true),
            }
        }
        registers.set(R::Cr, self.control);
    }

    fn write_options(
        &mut self,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if !self.option_keys.open || self.running.is_some() {
            let kept = u64::from(self.options) & !optcr::OPTSTRT.mask();
            registers.set(R::Optcr, kept | optcr::OPTLOCK.mask());
            return;
        }
        if optcr::OPTLOCK.is_set(value) {
            self.option_keys.shut();
        }
        if optcr::OPTSTRT.is_set(value) {
            self.options = (value & !(optcr::OPTSTRT.mask() | optcr::OPTLOCK.mask())) as u32;
            self.begin(Operation::Options, OPTIONS_NANOS, registers, context);
        }
    }

    fn drive(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let status = registers.get(R::Sr);
        let level = Level::from(
            (sr::EOP.is_set(status) && cr::EOPIE.is_set(self.control))
                || (sr::OPERR.is_set(status) && cr::ERRIE.is_set(self.control)),
        );
        if level != self.interrupt {
            self.interrupt = level;
            context.interrupt(GLOBAL, level);
        }
    }
}

fn flag(registers: &mut RegisterFile, mask: u64, set: bool) {
    let status = registers.get(R::Sr);
    registers.set(R::Sr, if set { status | mask } else { status & !mask });
}

impl Device for Flash {
    type Register = R;

    fn write(
        &mut self,
        register: R,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            R::Keyr => {
                self.keys.take(value, KEYS);
                if self.keys.open {
                    self.control = cr::LOCK.set(self.control, 0);
                    registers.set(R::Cr, self.control);
                }
            }
            R::Optkeyr => {
                self.option_keys.take(value, OPTION_KEYS);
                if self.option_keys.open {
                    registers.set(R::Optcr, u64::from(self.options) & !optcr::OPTLOCK.mask());
                }
            }
            R::Cr => self.write_control(value, registers, context),
            R::Optcr => self.write_options(value, registers, context),
            _ => {}
        }
        self.drive(registers, context);
    }

    /// 3.5.4: a store programs a word of the width `PSIZE` says, and can only clear bits.
    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        let bytes = width.bytes();
        if !cr::PG.is_set(self.control) || !self.keys.open || self.running.is_some() {
            flag(registers, sr::PGSERR.mask(), true);
        } else if 1 << cr::PSIZE.get(self.control) != bytes {
            flag(registers, sr::PGPERR.mask(), true);
        } else if !address.is_multiple_of(u64::from(bytes)) {
            flag(registers, sr::PGAERR.mask(), true);
        } else {
            let operation = Operation::Program {
                address: address as u32,
                bytes,
            };
            self.begin(operation, PROGRAM_NANOS, registers, context);
            // The old word comes back in `on_access`, with the new one as its token.
            context.read_from(address, width, value);
        }
        self.drive(registers, context);
        true
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if let Some(Operation::Program { address, bytes }) = self.operation() {
            let width = match bytes {
                1 => Width::W8,
                2 => Width::W16,
                4 => Width::W32,
                _ => Width::W64,
            };
            // Also the answer to the programming itself, which is zero; a word of zeros stays one.
            if value != 0 {
                context.program(u64::from(address), width, value & token, 0);
            }
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some((_, operation)) = self.running.take_if(|(running, _)| *running == event) else {
            return;
        };
        if let Operation::Erase { start, bytes } = operation {
            for address in (start..start + bytes).step_by(8) {
                context.program(u64::from(address), Width::W64, u64::MAX, 0);
            }
            self.control = cr::STRT.set(self.control, 0);
            registers.set(R::Cr, self.control);
        }
        if operation == Operation::Options {
            let shown = registers.get(R::Optcr);
            registers.set(R::Optcr, optcr::OPTSTRT.set(shown, 0));
        }
        flag(registers, sr::BSY.mask(), false);
        if cr::EOPIE.is_set(self.control) {
            flag(registers, sr::EOP.mask(), true);
        }
        self.drive(registers, context);
    }
}

/// `array` as a cut of the supply during `operation` leaves it: an erase has set some bits and not
/// others, a word has cleared some bits and not others. Which ones is drawn from `seed`.
pub(crate) fn cut(array: &mut [u8], operation: Option<Operation>, seed: u64) {
    let (start, bytes, erase) = match operation {
        Some(Operation::Erase { start, bytes }) => (start, bytes, true),
        Some(Operation::Program { address, bytes }) => (address, bytes, false),
        Some(Operation::Options) | None => return,
    };
    let start = (start - BASE) as usize;
    let Some(caught) = array.get_mut(start..start + bytes as usize) else {
        return;
    };
    let mut noise = seed | 1;
    for byte in caught {
        // xorshift64*: any bits will do, as long as they are the same ones every time.
        noise ^= noise >> 12;
        noise ^= noise << 25;
        noise ^= noise >> 27;
        let drawn = (noise.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 56) as u8;
        *byte |= if erase { drawn } else { drawn & 0x0F };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sectors_cover_the_array_in_order() {
        let mut next = BASE;
        for number in 0..12 {
            let (start, bytes) = sector(number).expect("twelve sectors");
            assert_eq!(start, next, "sector {number}");
            next += bytes;
        }
        assert_eq!(next, BASE + (1 << 20));
        assert_eq!(sector(12), None);
    }

    #[test]
    fn a_wrong_key_locks_for_good() {
        let mut lock = Lock::default();
        lock.take(KEYS[0], KEYS);
        lock.take(KEYS[1], KEYS);
        assert!(lock.open);
        let mut lock = Lock::default();
        lock.take(KEYS[1], KEYS);
        lock.take(KEYS[0], KEYS);
        lock.take(KEYS[1], KEYS);
        assert!(!lock.open);
    }

    #[test]
    fn a_cut_erase_is_neither_old_nor_new() {
        let mut array = vec![0; 1 << 20];
        let erase = Operation::Erase {
            start: BASE + 0x4000,
            bytes: 0x4000,
        };
        cut(&mut array, Some(erase), 7);
        assert!(
            array[..0x4000]
                .iter()
                .chain(&array[0x8000..])
                .all(|&byte| byte == 0)
        );
        let caught = &array[0x4000..0x8000];
        assert!(caught.iter().any(|&byte| byte != 0) && caught.iter().any(|&byte| byte != 0xFF));
    }
}
