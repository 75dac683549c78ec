//! The resonators' inner loops in assembly for ARMv7E-M; [`resonator`](crate::resonator) has their twins in Rust, which
//! give the same bits. The only file with unsafe code.
//!
//! A compiler finds the 64-bit multiply-accumulate (SMLAL) but not a place for everything: both ears' eight words,
//! three coefficients, the pointer and a frame fill all fourteen registers. All 32 frames are unrolled, and a shorter
//! run jumps into them.
#![allow(unsafe_code)]

use core::arch::global_asm;

use crate::frame::{BLOCK, Frame};

// The number of frames that are unrolled.
const _: () = assert!(BLOCK == 32);

// Instructions a frame, both ears: 10 (circle), 12 (direct); and about 30 a call.
global_asm!(
    ".syntax unified",
    ".thumb",
    // (r0: words yl, vl, yr, vr as 64 bits; r1: frames; r2: out; r3: -g, Q32; [sp]: -b, Q32)
    ".section .text.freshet_circle,\"ax\",%progbits",
    ".balign 4",
    ".global freshet_circle",
    ".type freshet_circle,%function",
    ".thumb_func",
    "freshet_circle:",
    "push {{r0, r4-r11, lr}}",
    "movs r4, #36", // bytes of a frame
    "mul r1, r1, r4",
    "adr.w r4, 9f",
    "subs r4, r4, r1",
    "orr r12, r4, #1",
    "ldr lr, [sp, #40]",
    "ldm r0, {{r4-r11}}",
    "rsb r1, r3, #0",
    "mov r0, r3",
    "bx r12",
    // r0: -g, r1: g, lr: -b; r4-r5: yl, r6-r7: vl, r8-r9: yr, r10-r11: vr; r3, r12: the frame.
    ".rept 32",
    "ldrd r3, r12, [r2]",
    "smlal r6, r7, lr, r7", // v += -b·v
    "smlal r6, r7, r0, r5", // v += -g·y
    "smlal r4, r5, r1, r7", // y += g·v
    "smlal r10, r11, lr, r11",
    "smlal r10, r11, r0, r9",
    "smlal r8, r9, r1, r11",
    "add r3, r5",
    "add r12, r9",
    "strd r3, r12, [r2], #8",
    ".endr",
    ".balign 4",
    "9:",
    "pop {{r0}}",
    "stm r0, {{r4-r11}}",
    "pop {{r4-r11, pc}}",
    ".size freshet_circle, . - freshet_circle",
    // (r0: the same words, of which the upper halves count; r1: frames; r2: out; r3: a1, Q30; [sp]: a2, Q30)
    ".section .text.freshet_direct,\"ax\",%progbits",
    ".balign 4",
    ".global freshet_direct",
    ".type freshet_direct,%function",
    ".thumb_func",
    "freshet_direct:",
    "push {{r0, r4-r11, lr}}",
    "mov r8, r3",
    "ldr r9, [sp, #40]",
    "ldr r4, [r0, #4]",
    "ldr r5, [r0, #12]",
    "ldr r6, [r0, #20]",
    "ldr r7, [r0, #28]",
    // The words change places each frame; an odd run enters with them changed.
    "tst r1, #1",
    "ittt ne",
    "movne r10, r4",
    "movne r4, r5",
    "movne r5, r10",
    "ittt ne",
    "movne r10, r6",
    "movne r6, r7",
    "movne r7, r10",
    "movs r10, #44", // bytes of a frame
    "mul r1, r1, r10",
    "adr.w r10, 9f",
    "subs r10, r10, r1",
    "orr r10, r10, #1",
    "bx r10",
    // r8: a1, r9: a2; r4, r5: the left ear's last words, r6, r7: the right one's; r3, r12: the frame.
    ".rept 16",
    "ldrd r3, r12, [r2]",
    "smull r0, r1, r8, r4",
    "smlal r0, r1, r9, r5",
    "lsl.w r1, r1, #2",
    "orr r5, r1, r0, lsr #30",
    "smull r0, r1, r8, r6",
    "smlal r0, r1, r9, r7",
    "lsl.w r1, r1, #2",
    "orr r7, r1, r0, lsr #30",
    "add r3, r5",
    "add r12, r7",
    "strd r3, r12, [r2], #8",
    "ldrd r3, r12, [r2]",
    "smull r0, r1, r8, r5",
    "smlal r0, r1, r9, r4",
    "lsl.w r1, r1, #2",
    "orr r4, r1, r0, lsr #30",
    "smull r0, r1, r8, r7",
    "smlal r0, r1, r9, r6",
    "lsl.w r1, r1, #2",
    "orr r6, r1, r0, lsr #30",
    "add r3, r4",
    "add r12, r6",
    "strd r3, r12, [r2], #8",
    ".endr",
    ".balign 4",
    "9:",
    "pop {{r0}}",
    "movs r1, #0",
    "strd r1, r4, [r0]",
    "strd r1, r5, [r0, #8]",
    "strd r1, r6, [r0, #16]",
    "strd r1, r7, [r0, #24]",
    "pop {{r4-r11, pc}}",
    ".size freshet_direct, . - freshet_direct",
    ".text",
);

unsafe extern "C" {
    fn freshet_circle(words: *mut i64, frames: usize, out: *mut Frame, g: i32, b: i32);
    fn freshet_direct(words: *mut i64, frames: usize, out: *mut Frame, a1: i32, a2: i32);
}

/// Runs both ears of a circle (words y and v; coefficients −g and −b, Q32) over `out`, which is a block or less, adding.
#[inline(always)]
pub fn circle(ears: &mut [[i64; 2]; 2], [g, b]: [i32; 2], out: &mut [Frame]) {
    let frames = out.len().min(BLOCK);
    // SAFETY: reads and writes the four words and so many frames, no more than are unrolled; keeps every register that
    // the procedure call standard asks for.
    unsafe { freshet_circle(ears.as_mut_ptr().cast(), frames, out.as_mut_ptr(), g, b) }
}

/// The same for a direct form: its last two outputs in the words' upper halves; coefficients a1 and a2, Q30.
#[inline(always)]
pub fn direct(ears: &mut [[i64; 2]; 2], [a1, a2]: [i32; 2], out: &mut [Frame]) {
    let frames = out.len().min(BLOCK);
    // SAFETY: as above.
    unsafe { freshet_direct(ears.as_mut_ptr().cast(), frames, out.as_mut_ptr(), a1, a2) }
}
