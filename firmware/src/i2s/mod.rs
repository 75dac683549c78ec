//! Blocks out through I2S: a circular DMA over two halves, each one block long.
//!
//! **Deadline.** The DMA's interrupt comes each time a half begins to play; the other half is then free, and has to be
//! filled before the next interrupt, one block (32 frames, 667 µs) later. **When it is missed**, the interrupt itself
//! puts into the half that begins to play a fade from the last frame heard to silence, or silence: nothing old is ever
//! repeated, and no channel can change places, for DMA and I2S never stop. The first frames of that fade stand there
//! before, for DMA has read the first word by the time the interrupt runs. The block that came late plays next, and
//! [`audio`](crate::audio) fades in. When the hardware reports an error, both are built anew.
//!
//! embassy's ring buffer is not used: after an underrun its write index may land in the middle of a frame.

#[cfg_attr(any(feature = "f407", feature = "f411"), path = "f4.rs")]
#[cfg_attr(feature = "h743", path = "h7.rs")]
mod hardware;

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering::Relaxed};
use core::task::Poll;

use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::rcc;
use embassy_sync::waitqueue::AtomicWaker;
use freshet::{BLOCK, Block, Frame};

use crate::board::{DMA, I2s, SPI};
use crate::dma::Transfer;

/// Frames of a fade that stand ready, in case no block comes: 40 µs of interrupt latency.
const AHEAD: usize = 2;
/// Words of a half: a left and a right one for each frame.
const HALF: usize = 2 * BLOCK;

#[repr(transparent)]
struct Halves(UnsafeCell<[[u32; HALF]; 2]>);
// SAFETY: written by the audio task with interrupts masked, or by the DMA's interrupt, which then is the only one.
unsafe impl Sync for Halves {}

#[unsafe(link_section = ".dma")]
static HALVES: Halves = Halves(UnsafeCell::new([[0; HALF]; 2]));

/// Interrupts so far: halves that have begun to play.
static TURN: AtomicU32 = AtomicU32::new(0);
/// The turn for which a block has been handed in, or [`NOBODY`].
static FILLED: AtomicU32 = AtomicU32::new(0);
/// Silence is played and nobody is late.
const NOBODY: u32 = u32::MAX;
/// The frame heard last, 24 bits.
static LAST: [AtomicI32; 2] = [AtomicI32::new(0), AtomicI32::new(0)];
/// Halves that had to be muted.
static LATE: AtomicU32 = AtomicU32::new(0);
/// Hardware errors.
static ERRORS: AtomicU32 = AtomicU32::new(0);
static FAILED: AtomicBool = AtomicBool::new(false);
/// No block is wanted for a while.
static HELD: AtomicBool = AtomicBool::new(false);
static WAKER: AtomicWaker = AtomicWaker::new();

/// What the audio task is woken for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// A half is free for the next block.
    Block,
    /// The hardware reported an error: [`restart`], then go on.
    Restart,
}

/// What went wrong so far.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct Faults {
    /// Blocks that came too late.
    pub late: u32,
    /// Errors of DMA or I2S, each followed by a restart.
    pub errors: u32,
}

/// Starts the clocks and plays silence, for a codec that wants its clocks first.
#[cfg_attr(
    not(feature = "f407"),
    expect(dead_code, reason = "its board has such a codec")
)]
pub fn idle() {
    restart();
    FILLED.store(NOBODY, Relaxed);
}

/// Builds the driver and starts it in silence; from here on blocks are due.
pub fn restart() {
    stop();
    // SAFETY: DMA is off.
    unsafe { *HALVES.0.get() = [[0; HALF]; 2] };
    LAST.iter().for_each(|last| last.store(0, Relaxed));
    TURN.store(0, Relaxed);
    FILLED.store(0, Relaxed);
    FAILED.store(false, Relaxed);
    hardware::prepare();
    let transfer = Transfer {
        register: hardware::register(),
        buffer: HALVES.0.get().cast(),
        items: 2 * HALF * hardware::ITEMS,
        size: hardware::SIZE,
        dir: Dir::MEMORY_TO_PERIPHERAL,
        circular: true,
        urgent: true,
    };
    DMA.start(&transfer, |w| {
        hardware::route(w);
        w.set_htie(true);
        w.set_tcie(true);
        w.set_teie(true);
        w.set_dmeie(true);
    });
    hardware::enable();
}

/// Stops both, the I2S block first, and leaves nothing in it: a half-word kept from before would put all that follows
/// out of place.
fn stop() {
    rcc::enable_and_reset_without_stop::<I2s>();
    DMA.stop();
}

/// Plays silence and wants nothing, until [`release`]: the core may stand still meanwhile. From below the audio task, so
/// that this does not come in the middle of a block.
pub fn hold() {
    cortex_m::interrupt::free(|_| {
        HELD.store(true, Relaxed);
        FILLED.store(NOBODY, Relaxed);
        end_with(Frame::ZERO);
        // SAFETY: interrupts are masked, and DMA only reads.
        unsafe { *HALVES.0.get() = [[0; HALF]; 2] };
    });
}

/// Blocks are wanted again, from the next half on.
pub fn release() {
    HELD.store(false, Relaxed);
    WAKER.wake();
}

/// Waits until something is wanted.
pub async fn wanted() -> Wanted {
    core::future::poll_fn(|context| {
        WAKER.register(context.waker());
        if HELD.load(Relaxed) {
            Poll::Pending
        } else if FAILED.load(Relaxed) {
            Poll::Ready(Wanted::Restart)
        } else if TURN.load(Relaxed) != FILLED.load(Relaxed) {
            Poll::Ready(Wanted::Block)
        } else {
            Poll::Pending
        }
    })
    .await
}

/// Hands in a block of 24-bit frames for the half that is free now.
pub fn hand_in(block: &Block) {
    // 64 words in about 3 µs: the half that is free stays so meanwhile.
    cortex_m::interrupt::free(|_| {
        let turn = TURN.load(Relaxed);
        fill(turn, block);
        end_with(block[BLOCK - 1]);
        FILLED.store(turn, Relaxed);
    });
}

/// Fills the half that is free in `turn`, from its beginning. Call with interrupts masked.
fn fill(turn: u32, frames: &[Frame]) {
    let half = (turn.wrapping_sub(1) & 1) as usize;
    // SAFETY: interrupts are masked, and DMA reads the other half.
    let words = unsafe { &mut (*HALVES.0.get())[half] };
    for (words, frame) in words.chunks_exact_mut(2).zip(frames) {
        words[0] = hardware::word(frame.left);
        words[1] = hardware::word(frame.right);
    }
}

/// Remembers what is heard last of what was filled in.
fn end_with(frame: Frame) {
    LAST[0].store(frame.left, Relaxed);
    LAST[1].store(frame.right, Relaxed);
}

/// What went wrong so far.
pub fn faults() -> Faults {
    Faults {
        late: LATE.load(Relaxed),
        errors: ERRORS.load(Relaxed),
    }
}

/// Silence at once, for good: before a restart of the chip.
pub fn mute() {
    // SAFETY: called with interrupts off; what DMA reads while it is written is at worst one old word.
    unsafe { *HALVES.0.get() = [[0; HALF]; 2] };
    crate::board::mute();
}

/// The DMA's interrupt.
pub fn on_interrupt() {
    let flags = DMA.take_flags();
    // An underrun of the I2S block means that words were lost: the channels may have changed places.
    if flags.failed || SPI.sr().read().udr() {
        stop();
        ERRORS.fetch_add(1, Relaxed);
        FAILED.store(true, Relaxed);
    } else if flags.half || flags.whole {
        let left = DMA.left();
        let turn = TURN.load(Relaxed);
        // Half 1 begins to play in odd turns; an interrupt that was held up may have missed one.
        let second = left <= HALF * hardware::ITEMS;
        let in_step = second == (turn & 1 == 0);
        let filled = FILLED.load(Relaxed);
        let now = turn.wrapping_add(if in_step { 1 } else { 2 });
        if filled != NOBODY && (filled != turn || !in_step) {
            LATE.fetch_add(1, Relaxed);
            // Into the half that begins to play.
            fill(now.wrapping_add(1), &fade_out::<BLOCK>());
            end_with(Frame::ZERO);
        }
        fill(now, &fade_out::<AHEAD>());
        TURN.store(now, Relaxed);
    }
    WAKER.wake();
}

/// The beginning of a fade over a block, from the last frame heard to silence.
fn fade_out<const N: usize>() -> [Frame; N] {
    let last = [LAST[0].load(Relaxed), LAST[1].load(Relaxed)];
    core::array::from_fn(|i| {
        let left = (BLOCK - 1 - i) as i32;
        Frame {
            left: last[0] / BLOCK as i32 * left,
            right: last[1] / BLOCK as i32 * left,
        }
    })
}
