//! Watches the others: feeds the watchdog when all have checked in, and shows on the lights how things stand.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;

use crate::board::{Lights, Watchdog};
use crate::{audio, i2s, log, stack};

/// Without a check-in of every client for so long the chip is reset, µs.
const PATIENCE: u32 = 250_000;
/// The same until the sound starts, µs: the first start of all writes an option byte, which takes half a second at most.
const FIRST_PATIENCE: u32 = 2_000_000;
/// Which of the two holds.
static NOW: AtomicU32 = AtomicU32::new(FIRST_PATIENCE);
/// Time between two looks, ms.
const LOOK: u64 = 50;
/// Looks between two reports in the log: ten seconds.
const REPORT: u32 = 200;

/// Who has to check in.
#[derive(Clone, Copy)]
pub enum Client {
    /// The audio task, each block.
    Audio = 1,
    /// The control task, each tick.
    Control = 2,
}

const ALL: u32 = Client::Audio as u32 | Client::Control as u32;

static CHECKED_IN: AtomicU32 = AtomicU32::new(0);
static TROUBLE: AtomicBool = AtomicBool::new(false);

/// Says that `client` is well.
pub fn check_in(client: Client) {
    CHECKED_IN.fetch_or(client as u32, Relaxed);
}

/// Something is not as it should be, though the sound goes on: the lights show it.
pub fn set_trouble(trouble: bool) {
    TROUBLE.fetch_or(trouble, Relaxed);
}

/// Whether anything was so since the start.
pub fn is_trouble() -> bool {
    TROUBLE.load(Relaxed)
}

/// Feeds the watchdog for all clients; where it was not started, nothing happens.
#[cfg(feature = "h743")]
pub fn feed_watchdog() {
    pac::IWDG1
        .kr()
        .write(|w| w.set_key(pac::iwdg::vals::Key::RESET));
}

/// Feeds it, and makes it wait for as long as a sector may take to erase, even where its oscillator is as fast as it may
/// be, 47 kHz for 32.
#[cfg(not(feature = "h743"))]
pub fn stretch_watchdog() {
    set_watchdog(1_500_000);
}

/// Feeds it, and all is as it was.
#[cfg(not(feature = "h743"))]
pub fn relax_watchdog() {
    set_watchdog(NOW.load(Relaxed));
}

/// The watchdog's time, µs, up to 8 s. Where it was not started, nothing happens.
#[cfg(not(feature = "h743"))]
fn set_watchdog(micros: u32) {
    use pac::iwdg::vals::{Key, Pr};
    /// At 32 kHz over 64, µs.
    const STEP: u32 = 2_000;
    /// Turns of the loop that waits until it has taken a value: 5 cycles of its oscillator.
    const TURNS: u32 = 100_000;
    let watchdog = pac::IWDG;
    watchdog.kr().write(|w| w.set_key(Key::ENABLE));
    watchdog.pr().write(|w| w.set_pr(Pr::DIVIDE_BY64));
    (watchdog.rlr()).write(|w| w.set_rl((micros / STEP) as u16));
    let _ = (0..TURNS).any(|_| {
        let status = watchdog.sr().read();
        !status.pvu() && !status.rvu()
    });
    watchdog.kr().write(|w| w.set_key(Key::RESET));
}

/// Why the chip started.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Reset {
    /// Power came on, or dropped too low.
    Power,
    /// The reset pin.
    Pin,
    /// The program itself, after a crash or where it was asked to.
    Software,
    /// The watchdog.
    Watchdog,
}

impl Reset {
    /// Whether something went wrong before; a crash leaves a record of its own.
    pub fn is_trouble(self) -> bool {
        self == Self::Watchdog
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Power => "power-on",
            Self::Pin => "the reset pin",
            Self::Software => "a restart by the program",
            Self::Watchdog => "the watchdog",
        }
    }
}

/// Reads why the chip started, and clears it for the next time.
pub fn take_reset_cause() -> Reset {
    #[cfg(not(feature = "h743"))]
    let (flags, clear) = {
        let flags = pac::RCC.csr().read();
        ((flags.wdgrstf(), flags.sftrstf(), flags.porrstf()), || {
            pac::RCC.csr().modify(|w| w.set_rmvf(true))
        })
    };
    #[cfg(feature = "h743")]
    let (flags, clear) = {
        let flags = pac::RCC.rsr().read();
        (
            (flags.iwdg1rstf(), flags.sftrstf(), flags.porrstf()),
            || pac::RCC.rsr().modify(|w| w.set_rmvf(true)),
        )
    };
    clear();
    match flags {
        (true, _, _) => Reset::Watchdog,
        (_, true, _) => Reset::Software,
        (_, _, true) => Reset::Power,
        _ => Reset::Pin,
    }
}

/// Makes the chip reset below 2.7 V instead of running on with wrong answers. An option byte: written once in a life.
pub fn enable_brown_out_reset() {
    #[cfg(not(feature = "h743"))]
    {
        const HIGHEST: u8 = 0;
        let flash = pac::FLASH;
        if flash.optcr().read().bor_lev() == HIGHEST {
            return;
        }
        flash.optkeyr().write_value(0x0819_2a3b);
        flash.optkeyr().write_value(0x4c5d_6e7f);
        flash.optcr().modify(|w| w.set_bor_lev(HIGHEST));
        flash.optcr().modify(|w| w.set_optstrt(true));
        while flash.sr().read().bsy() {}
        flash.optcr().modify(|w| w.set_optlock(true));
    }
    #[cfg(feature = "h743")]
    {
        const HIGHEST: u8 = 3;
        let flash = pac::FLASH;
        if flash.optsr_cur().read().bor_lev() == HIGHEST {
            return;
        }
        flash.optkeyr().write_value(0x0819_2a3b);
        flash.optkeyr().write_value(0x4c5d_6e7f);
        flash.optsr_prg().modify(|w| w.set_bor_lev(HIGHEST));
        flash.optcr().modify(|w| w.set_optstart(true));
        while flash.optsr_cur().read().opt_busy() {}
        flash.optcr().modify(|w| w.set_optlock(true));
    }
}

/// Starts the watchdog, before all that may go wrong.
pub fn unleash(watchdog: &mut Peri<'static, Watchdog>) {
    IndependentWatchdog::new(watchdog.reborrow(), FIRST_PATIENCE).unleash();
}

/// Watches for ever.
pub async fn run(mut lights: Lights, watchdog: Peri<'static, Watchdog>) -> ! {
    let mut watchdog = IndependentWatchdog::new(watchdog, PATIENCE);
    NOW.store(PATIENCE, Relaxed);
    watchdog.pet();
    let mut seen = (i2s::faults(), 0);
    let mut looks = 0u32;
    loop {
        Timer::after_millis(LOOK).await;
        if CHECKED_IN.load(Relaxed) == ALL {
            CHECKED_IN.store(0, Relaxed);
            watchdog.pet();
        }
        let clipped = audio::moment().map_or(0, |moment| moment.stats.clipped);
        let now = (i2s::faults(), clipped);
        lights.show(
            looks,
            now.1 != seen.1,
            now.0 != seen.0,
            TROUBLE.load(Relaxed),
        );
        seen = now;
        looks = looks.wrapping_add(1);
        if looks.is_multiple_of(REPORT) {
            let (last, peak) = audio::METER.read();
            let (used, size) = stack::used();
            log::info!(
                "block {} cycles, at most {}; late {}, errors {}, missed ticks {}; stack {} of {} bytes",
                last,
                peak,
                now.0.late,
                now.0.errors,
                audio::missed(),
                used,
                size
            );
        }
    }
}
