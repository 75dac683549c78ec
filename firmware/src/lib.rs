//! The firmware: [`audio`] plays above everything else, [`control`] computes what it plays next, [`supervisor`]
//! watches both. [`board`] is the only place that names a pin.
//!
//! ```text
//! scenes in flash ─► control ─(the Control itself, once a tick)─► audio ─► i2s ─► DAC
//!          button ─►    └──────────── checks in ──► supervisor ◄── checks in ──┘
//! ```
#![no_std]

mod log;

mod audio;
mod blackbox;
mod board;
mod clock;
mod control;
mod flash;
mod i2s;
mod meter;
mod stack;
mod supervisor;

use embassy_executor::Spawner;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    stack::paint();
    meter::start();
    let reset = supervisor::take_reset_cause();
    let mut board = board::init();
    supervisor::unleash(&mut board.watchdog);
    supervisor::set_trouble(board.trouble | reset.is_trouble() | blackbox::report());
    log::info!(
        "freshet on {}, {} Hz, after {}",
        board::NAME,
        board::CLOCK.rate() as f32,
        reset.name()
    );
    supervisor::enable_brown_out_reset();
    control::start(board.button, spawner);
    supervisor::run(board.lights, board.watchdog).await
}
