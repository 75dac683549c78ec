//! What the STM32F4 boards share.

use embassy_stm32::pac::{FLASH, RCC};

/// Turns of the loop that waits for the crystal; at 16 MHz well over the 10 ms that a crystal may take.
const PATIENCE: u32 = 200_000;

/// Starts the crystal and waits for it. embassy would wait for ever.
pub fn crystal_starts() -> bool {
    RCC.cr().modify(|w| w.set_hseon(true));
    (0..PATIENCE).any(|_| RCC.cr().read().hserdy())
}

/// Switches on what makes up for the flash's wait states: prefetch and both caches.
pub fn speed_up() {
    FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
}
