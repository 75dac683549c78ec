//! The firmware: [`audio`] plays above everything else, [`control`] computes what it plays next, [`supervisor`]
//! watches both. [`board`] is the only place that names a pin.
//!
//! ```text
//! scenes in flash ─► control ─(the Control itself, once a tick)─► audio ─► i2s ─► DAC
//!  serial, button ─►    └──────────── checks in ──► supervisor ◄── checks in ──┘
//! ```
#![no_std]

mod log;

mod audio;
mod blackbox;
mod board;
mod clock;
mod control;
mod device;
mod dma;
mod flash;
mod i2s;
mod meter;
mod serial;
mod stack;
mod storage;
mod supervisor;
#[cfg(feature = "usb")]
mod usb;

use device::Past;
use embassy_executor::Spawner;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    stack::paint();
    meter::start();
    let reset = supervisor::take_reset_cause();
    let mut board = board::init();
    supervisor::unleash(&mut board.watchdog);
    let panic = blackbox::take();
    supervisor::set_trouble(board.trouble | reset.is_trouble() | panic.is_some());
    log::info!(
        "freshet on {}, {} Hz, after {}",
        board::NAME,
        board::CLOCK.rate() as f32,
        reset.name()
    );
    supervisor::enable_brown_out_reset();
    let past = Past {
        cause: reset.name(),
        panic: panic.unwrap_or(""),
    };
    #[cfg(feature = "usb")]
    let usb = usb::start(board.usb, spawner);
    control::start(
        board.button,
        past,
        #[cfg(feature = "usb")]
        usb,
        spawner,
    );
    supervisor::run(board.lights, board.watchdog).await
}
