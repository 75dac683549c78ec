//! A CS43L22 on the I2C bus: its registers, its reset pin, and the order it was set up in.
//!
//! Citations are of Cirrus Logic's data sheet DS792F2.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rigless::chip::Timeline;
use rigless::chip::i2c::Peer;
use rigless::snapshot::Store;

/// Its address with `AD0` low, section 6.1: 7 bits, 0x94 as a byte on the wire.
pub const ADDRESS: u8 = 0x4A;
/// Chip identification, section 7.1.
const ID: u8 = 0x01;
/// Power control 1, section 7.2: 0x01 is down, 0x9E is up, nothing else is documented.
const POWER: u8 = 0x02;
const POWER_UP: u8 = 0x9E;
/// Section 6.1.1: the address of a write counts up by itself when its top bit is set.
const INCREMENT: u8 = 0x80;
/// The settings section 4.11 requires before the chip is powered up; 0x32 by its top bit alone.
const REQUIRED: [(u8, u8, u8); 5] = [
    (0x00, 0x99, 0xFF),
    (0x47, 0x80, 0xFF),
    (0x32, 0x80, 0x80),
    (0x32, 0x00, 0x80),
    (0x00, 0x00, 0xFF),
];
/// Registers that are not 0 out of reset, chapter 7.
const DEFAULTS: [(u8, u8); 7] = [
    (ID, 0xE3),
    (POWER, 0x01),
    (0x04, 0x05),
    (0x05, 0xA0),
    (0x0A, 0x81),
    (0x0D, 0x60),
    (0x1F, 0x88),
];

/// What happened to the codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CodecEvent {
    /// Its reset pin went low, and its registers to their defaults.
    Reset,
    /// Its reset pin went high.
    Released,
    /// A register was written.
    Write {
        /// Which.
        register: u8,
        /// What with.
        value: u8,
    },
}

/// Why a codec plays nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CodecFault {
    /// There is none on this board.
    #[error("the board has no codec")]
    Absent,
    /// Its reset pin is low.
    #[error("its reset pin is low")]
    InReset,
    /// Its power control says down.
    #[error("power control 1 is {0:#04x}, not 0x9e")]
    Down(u8),
    /// It was powered up before the settings section 4.11 requires.
    #[error("it was powered up without the settings data sheet 4.11 requires, in their order")]
    Unprepared,
}

#[derive(Debug)]
struct State {
    present: bool,
    registers: [u8; 128],
    pointer: u8,
    /// The next byte written is the pointer.
    addressed: bool,
    released: bool,
    history: Vec<(Duration, CodecEvent)>,
}

impl State {
    fn set_defaults(&mut self) {
        self.registers = [0; 128];
        for (register, value) in DEFAULTS {
            self.registers[usize::from(register)] = value;
        }
    }

    fn step(&mut self) {
        if self.pointer & INCREMENT != 0 {
            self.pointer = INCREMENT | (self.pointer + 1);
        }
    }
}

/// The codec: one handle for the bus, one for the reset pin, one for whoever looks.
#[derive(Debug, Clone)]
pub struct Codec(Arc<Mutex<State>>);

impl Codec {
    pub(crate) fn new(present: bool) -> Self {
        let mut state = State {
            present,
            registers: [0; 128],
            pointer: 0,
            addressed: false,
            // The pin floats until the firmware drives it; the board pulls it low.
            released: false,
            history: Vec::new(),
        };
        state.set_defaults();
        Self(Arc::new(Mutex::new(state)))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The register `register` as it stands, 0 past the last.
    pub fn register(&self, register: u8) -> u8 {
        self.state()
            .registers
            .get(usize::from(register))
            .copied()
            .unwrap_or(0)
    }

    /// Everything that happened to it, with its time since power-on.
    pub fn history(&self) -> Vec<(Duration, CodecEvent)> {
        self.state().history.clone()
    }

    /// When it was powered up, in the order the data sheet asks for: reset released, the required
    /// settings, then power control 1.
    ///
    /// # Errors
    ///
    /// What keeps it from playing.
    pub fn powered_up(&self) -> Result<Duration, CodecFault> {
        let state = self.state();
        if !state.present {
            return Err(CodecFault::Absent);
        }
        if !state.released {
            return Err(CodecFault::InReset);
        }
        let power = state.registers[usize::from(POWER)];
        if power != POWER_UP {
            return Err(CodecFault::Down(power));
        }
        let since_reset = state
            .history
            .iter()
            .rposition(|(_, event)| *event == CodecEvent::Released)
            .map_or(&state.history[..], |at| &state.history[at..]);
        let mut required = REQUIRED.iter().peekable();
        for (at, event) in since_reset {
            let CodecEvent::Write { register, value } = *event else {
                continue;
            };
            if register == POWER && value == POWER_UP {
                return match required.peek() {
                    None => Ok(*at),
                    Some(_) => Err(CodecFault::Unprepared),
                };
            }
            required.next_if(|(wanted, bits, mask)| register == *wanted && value & mask == *bits);
        }
        Err(CodecFault::Unprepared)
    }

    /// Its supply comes on at `at`, its reset pin low.
    pub(crate) fn power_on(&self, at: Duration) {
        self.reset_pin(false, at);
        self.state().set_defaults();
    }

    /// Its reset pin goes to `high` at `at`.
    pub(crate) fn reset_pin(&self, high: bool, at: Duration) {
        let mut state = self.state();
        if high == state.released {
            return;
        }
        state.released = high;
        let event = if high {
            CodecEvent::Released
        } else {
            state.set_defaults();
            CodecEvent::Reset
        };
        state.history.push((at, event));
    }
}

impl Store for Codec {}

impl Peer for Codec {
    fn start(&mut self, address: u8, read: bool, _context: &mut Timeline<'_, '_>) -> bool {
        let mut state = self.state();
        state.addressed = !read;
        state.present && state.released && address == ADDRESS
    }

    fn write(&mut self, byte: u8, context: &mut Timeline<'_, '_>) -> bool {
        let mut state = self.state();
        if std::mem::take(&mut state.addressed) {
            state.pointer = byte;
            return true;
        }
        let register = state.pointer & !INCREMENT;
        if register != ID {
            state.registers[usize::from(register)] = byte;
        }
        let at = Duration::from_nanos(context.now().0);
        state.history.push((
            at,
            CodecEvent::Write {
                register,
                value: byte,
            },
        ));
        state.step();
        true
    }

    fn read(&mut self, _last: bool, _context: &mut Timeline<'_, '_>) -> u8 {
        let mut state = self.state();
        let value = state.registers[usize::from(state.pointer & !INCREMENT)];
        state.step();
        value
    }

    fn stop(&mut self, _context: &mut Timeline<'_, '_>) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(writes: &[(u8, u8)]) -> Codec {
        let codec = Codec::new(true);
        codec.reset_pin(true, Duration::from_millis(1));
        let mut state = codec.state();
        for (nth, &(register, value)) in (2..).zip(writes) {
            state.registers[usize::from(register)] = value;
            let event = CodecEvent::Write { register, value };
            state.history.push((Duration::from_millis(nth), event));
        }
        drop(state);
        codec
    }

    #[test]
    fn the_order_of_power_up_is_held_to_the_data_sheet() {
        let right = [
            (0x00, 0x99),
            (0x47, 0x80),
            (0x32, 0xBB),
            (0x32, 0x3B),
            (0x00, 0x00),
            (POWER, POWER_UP),
        ];
        assert_eq!(written(&right).powered_up(), Ok(Duration::from_millis(7)));
        assert_eq!(
            written(&right[..5]).powered_up(),
            Err(CodecFault::Down(0x01))
        );
        assert_eq!(
            written(&right[5..]).powered_up(),
            Err(CodecFault::Unprepared)
        );
        let swapped = [right[1], right[0], right[2], right[3], right[4], right[5]];
        assert_eq!(written(&swapped).powered_up(), Err(CodecFault::Unprepared));
        let codec = written(&right);
        codec.reset_pin(false, Duration::from_secs(1));
        assert_eq!(codec.powered_up(), Err(CodecFault::InReset));
        assert_eq!(
            codec.register(POWER),
            0x01,
            "a reset puts the defaults back"
        );
        assert_eq!(Codec::new(false).powered_up(), Err(CodecFault::Absent));
    }
}
