//! The stack's high-water mark: what was painted at the start and is painted still was never used.

/// What unused stack holds.
const PAINT: u32 = 0xc0de_ca5e;
/// Left unpainted below the stack pointer, for interrupts that come meanwhile, words.
const MARGIN: usize = 256;

unsafe extern "C" {
    pub static mut _stack_end: u32;
    pub static mut _stack_start: u32;
}

/// Paints the unused part of the stack. A function of its own: inlined, it would stand in the middle of a larger frame,
/// and paint over that.
#[inline(never)]
pub fn paint() {
    // Not a variable's address: a caller's frame, of any size, may lie below that.
    let here = cortex_m::register::msp::read() as *mut u32;
    // SAFETY: the addresses come from the memory map; everything from the stack's end up to well below the stack pointer
    // is free, and written as words through a raw pointer.
    unsafe {
        let mut at = &raw mut _stack_end;
        let top = here.sub(MARGIN);
        while at < top {
            at.write_volatile(PAINT);
            at = at.add(1);
        }
    }
}

/// Bytes of stack used so far, and bytes there are.
pub fn used() -> (usize, usize) {
    // SAFETY: reads words of the stack through raw pointers; both ends come from the memory map.
    unsafe {
        let (end, top) = (&raw const _stack_end, &raw const _stack_start);
        let mut at = end;
        while at < top && at.read_volatile() == PAINT {
            at = at.add(1);
        }
        (
            top.byte_offset_from(at) as usize,
            top.byte_offset_from(end) as usize,
        )
    }
}
