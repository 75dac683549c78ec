//! The serial line: DMA puts bytes into a ring and takes them from a buffer, and the control task looks once a tick. No
//! interrupt, and nothing here waits.
//!
//! A byte that came damaged, or was lost, could make another command of the one it stood in. So what came with it since
//! the look before is thrown away, up to the end of the line or frame that it cut off.

#[cfg_attr(any(feature = "f407", feature = "f411"), path = "serial/f4.rs")]
#[cfg_attr(feature = "h743", path = "serial/h7.rs")]
mod hardware;

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::Release, fence};

use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::rcc;
use freshet::protocol::Outbox;

use crate::board::{SERIAL_RX, SERIAL_TX, SerialPort};
use crate::dma::Transfer;

/// Bits a second; 8 data bits, no parity, one stop bit.
const BAUD: u32 = 115_200;
/// Bytes that may come between two looks, and twice that: half of the ring lasts 89 ms, and 10 ms at 1 000 000 baud.
const RING: usize = 2048;
/// Bytes that are handed to DMA at a time: a tick's worth at 1 000 000 baud.
const SENT: usize = 256;
/// Bytes taken from the ring at a time.
const CHUNK: usize = 64;
/// No byte of a line, and damage in a frame: whatever it stands in is thrown away.
const POISON: [u8; 1] = [0xff];

#[repr(transparent)]
struct Buffer<const N: usize>(UnsafeCell<[u8; N]>);
// SAFETY: DMA writes the ring, and the one Line reads it; the Line writes what is sent while DMA stands still.
unsafe impl<const N: usize> Sync for Buffer<N> {}

#[unsafe(link_section = ".dma")]
static RECEIVED: Buffer<RING> = Buffer(UnsafeCell::new([0; RING]));
#[unsafe(link_section = ".dma")]
static SENDING: Buffer<SENT> = Buffer(UnsafeCell::new([0; SENT]));

/// Bytes that came and were lost, at least.
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
/// Looks that found damaged bytes.
static FRAMING: AtomicU32 = AtomicU32::new(0);

/// What the USART says about the bytes that came.
struct Damage {
    /// One was lost.
    lost: bool,
    /// One came without its stop bit, or with noise.
    garbled: bool,
}

/// Input lost and damaged so far.
pub fn faults() -> (u32, u32) {
    (OVERRUNS.load(Relaxed), FRAMING.load(Relaxed))
}

/// The line. There is one.
pub struct Line {
    /// Where in the ring the next byte is taken.
    next: usize,
}

impl Line {
    /// Starts the line; its pins are given to it already.
    pub fn start() -> Self {
        rcc::enable_and_reset::<SerialPort>();
        let clock = rcc::frequency::<SerialPort>().0;
        hardware::start(((clock + BAUD / 2) / BAUD) as u16);
        let transfer = Transfer {
            register: hardware::registers().0,
            buffer: RECEIVED.0.get().cast(),
            items: RING,
            size: Size::BITS8,
            dir: Dir::PERIPHERAL_TO_MEMORY,
            circular: true,
            urgent: false,
        };
        SERIAL_RX.start(&transfer, |w| hardware::route(true, w));
        Self { next: 0 }
    }

    /// Gives `take` what came since the last time.
    pub fn receive(&mut self, mut take: impl FnMut(&[u8])) {
        let end = (RING - SERIAL_RX.left()) % RING;
        let flags = SERIAL_RX.take_flags();
        let lapped = flags.half && flags.whole;
        if end == self.next && !lapped {
            return;
        }
        let damage = hardware::take_damage();
        if lapped || damage.lost || damage.garbled {
            // More than half of the ring was not looked at in time: what is in there may be mixed up.
            let lost = if lapped {
                RING as u32
            } else {
                u32::from(damage.lost)
            };
            OVERRUNS.fetch_add(lost, Relaxed);
            FRAMING.fetch_add(damage.garbled.into(), Relaxed);
            self.next = end;
            return take(&POISON);
        }
        let mut chunk = [0; CHUNK];
        while self.next != end {
            let mut count = 0;
            while self.next != end && count < CHUNK {
                // SAFETY: in the ring; DMA writes elsewhere in it, for it is less than half a ring ahead.
                chunk[count] =
                    unsafe { RECEIVED.0.get().cast::<u8>().add(self.next).read_volatile() };
                self.next = (self.next + 1) % RING;
                count += 1;
            }
            take(&chunk[..count]);
        }
    }

    /// Sends on what waits, if the line is free.
    pub fn send<const N: usize>(&mut self, out: &mut Outbox<N>) {
        if out.is_empty() || SERIAL_TX.is_running() {
            return;
        }
        // SAFETY: DMA has come to its end.
        let count = out.take(unsafe { &mut *SENDING.0.get() });
        let transfer = Transfer {
            register: hardware::registers().1,
            buffer: SENDING.0.get().cast(),
            items: count,
            size: Size::BITS8,
            dir: Dir::MEMORY_TO_PERIPHERAL,
            circular: false,
            urgent: false,
        };
        // What is sent stands in memory before DMA reads it.
        fence(Release);
        SERIAL_TX.start(&transfer, |w| hardware::route(false, w));
    }

    /// Whether all was sent that was handed to DMA.
    pub fn is_free(&self) -> bool {
        !SERIAL_TX.is_running()
    }
}
