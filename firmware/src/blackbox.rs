//! What a crash leaves behind: a record in RAM that a reset does not clear, read at the next start.

use core::arch::global_asm;
use core::cell::UnsafeCell;
use core::fmt::Write;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;

use crate::{log, stack};

/// Tells a record from what RAM holds after power-on.
const MAGIC: u32 = 0xdead_f1a5;
/// Longest message kept, bytes.
const TEXT: usize = 116;

/// The record. It is valid where `magic` is [`MAGIC`] and `check` matches.
#[repr(C)]
struct Record {
    magic: u32,
    /// Sum of the text's bytes and of `length`.
    check: u32,
    length: u32,
    text: [u8; TEXT],
}

#[repr(transparent)]
struct Box(UnsafeCell<MaybeUninit<Record>>);
// SAFETY: written only by the panic handler, which masks interrupts, and read only at the start, before anything runs.
unsafe impl Sync for Box {}

#[unsafe(link_section = ".uninit.blackbox")]
#[unsafe(no_mangle)]
static BLACKBOX: Box = Box(UnsafeCell::new(MaybeUninit::uninit()));

impl Record {
    fn sum(&self) -> u32 {
        let text = self.text.iter().take(self.length as usize);
        text.fold(self.length, |sum, byte| {
            sum.wrapping_mul(31) + u32::from(*byte)
        })
    }
}

/// What the last crash before this start said. Call once, at the start: the next start is told nothing of it.
pub fn take() -> Option<&'static str> {
    // SAFETY: every pattern of bits is a Record; after this only a crash writes to it, which does not return.
    let record = unsafe { &mut *BLACKBOX.0.get().cast::<Record>() };
    let valid =
        record.magic == MAGIC && record.length as usize <= TEXT && record.check == record.sum();
    record.magic = 0;
    let text = &record.text[..record.length as usize % (TEXT + 1)];
    // A character that found no room whole is left out.
    let text = text.utf8_chunks().next().map_or("", |chunk| chunk.valid());
    if valid {
        log::error!("crashed before: {}", text);
    }
    valid.then_some(text)
}

/// Writes into the record until it is full.
struct Pen<'a>(&'a mut Record);

impl Write for Pen<'_> {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        for byte in text.bytes() {
            let at = self.0.length as usize;
            let Some(place) = self.0.text.get_mut(at) else {
                break;
            };
            *place = byte;
            self.0.length += 1;
        }
        Ok(())
    }
}

/// Mutes, leaves `what` in the record and starts again.
fn crash(what: core::fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    crate::i2s::mute();
    // SAFETY: interrupts are off, and this does not return.
    let record = unsafe { &mut *BLACKBOX.0.get().cast::<Record>() };
    record.length = 0;
    let _ = Pen(record).write_fmt(what);
    record.magic = MAGIC;
    record.check = record.sum();
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    crash(format_args!("{info}"))
}

// A stack that overflowed holds no frame, and none of a handler's: it is begun anew, which loses nothing that this needs.
global_asm!(
    ".section .HardFaultTrampoline, \"ax\"",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "mov r0, sp",
    "ldr r1, ={end}",
    "cmp r0, r1",
    "bhs 1f",
    "ldr r1, ={start}",
    "mov sp, r1",
    "movs r0, #0",
    "1: b {handler}",
    ".size HardFault, . - HardFault",
    ".text",
    end = sym stack::_stack_end,
    start = sym stack::_stack_start,
    handler = sym hard_fault,
);

/// `frame` is none where the stack overflowed.
extern "C" fn hard_fault(frame: Option<&cortex_m_rt::ExceptionFrame>) -> ! {
    match frame {
        Some(frame) => crash(format_args!(
            "hard fault at {:#x}, called from {:#x}",
            frame.pc(),
            frame.lr()
        )),
        None => crash(format_args!("the stack overflowed")),
    }
}
