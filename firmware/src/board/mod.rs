//! The boards. Each file names its pins, its clock tree and its capacities; nothing else in the firmware does.

#[cfg_attr(feature = "f407", path = "f407.rs")]
#[cfg_attr(feature = "f411", path = "f411.rs")]
#[cfg_attr(feature = "h743", path = "h743.rs")]
mod chosen;
#[cfg(any(feature = "f407", feature = "f411"))]
mod f4;

pub use chosen::*;

use embassy_executor::SendSpawner;
use embassy_stm32::Peri;
use embassy_stm32::gpio::{AfType, AnyPin, Flex, Input, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};

/// The DMA's interrupt goes above the audio task's, and that above all else.
pub const DMA_PRIORITY: Priority = Priority::P5;
const AUDIO_PRIORITY: Priority = Priority::P6;

/// A board, set up.
pub struct Board {
    /// The lights.
    pub lights: Lights,
    /// The button that steps through the scenes.
    pub button: Button,
    /// The USB port.
    #[cfg(feature = "usb")]
    pub usb: crate::usb::Pins,
    /// The watchdog, not started.
    pub watchdog: Peri<'static, Watchdog>,
    /// Something did not start as it should: the crystal, or the codec.
    pub trouble: bool,
}

/// Starts the executor of the audio task.
pub fn spawner() -> SendSpawner {
    AUDIO_INTERRUPT.set_priority(AUDIO_PRIORITY);
    crate::audio::EXECUTOR.start(AUDIO_INTERRUPT)
}

/// Gives pins to the I2S block for good; `function` is their alternate function's number.
fn give_to_i2s<const N: usize>(pins: [Peri<'static, AnyPin>; N], function: u8) {
    for pin in pins {
        let mut pin = Flex::new(pin);
        pin.set_as_af_unchecked(
            function,
            AfType::output(OutputType::PushPull, Speed::VeryHigh),
        );
        core::mem::forget(pin);
    }
}

/// Gives the pins that send and receive to the USART for good. An open input would receive noise: it is pulled up.
fn give_to_serial([tx, rx]: [Peri<'static, AnyPin>; 2]) {
    const USART: u8 = 7;
    let [mut tx, mut rx] = [Flex::new(tx), Flex::new(rx)];
    tx.set_as_af_unchecked(USART, AfType::output(OutputType::PushPull, Speed::Low));
    rx.set_as_af_unchecked(USART, AfType::input(Pull::Up));
    core::mem::forget((tx, rx));
}

/// A button.
pub struct Button {
    pin: Input<'static>,
    /// What the pin is when it is pressed.
    down: bool,
}

impl Button {
    /// Whether it is pressed.
    pub fn is_down(&self) -> bool {
        self.pin.is_high() == self.down
    }
}

/// Looks between two changes of the light that says all is well: half a second.
const SLOW: u32 = 10;

/// Up to four lights; where there is only one it blinks for all.
pub struct Lights {
    alive: Output<'static>,
    clip: Option<Output<'static>>,
    late: Option<Output<'static>>,
    trouble: Option<Output<'static>>,
    /// Whether a low pin is a light that is on.
    inverted: bool,
}

impl Lights {
    /// Shows how things stand at look number `look`, twenty a second.
    pub fn show(&mut self, look: u32, clip: bool, late: bool, trouble: bool) {
        let inverted = self.inverted;
        let set = |pin: &mut Output<'static>, on: bool| pin.set_level((on != inverted).into());
        let mut alive = (look / SLOW).is_multiple_of(2);
        for (light, on) in [(&mut self.clip, clip), (&mut self.late, late)] {
            match light {
                Some(light) => set(light, on),
                None if on => alive = look.is_multiple_of(2),
                None => {}
            }
        }
        match &mut self.trouble {
            Some(light) => set(light, trouble),
            None => alive |= trouble && !clip && !late,
        }
        set(&mut self.alive, alive);
    }
}
