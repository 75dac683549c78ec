//! The firmware of the Black Pill, STM32F411.
#![no_std]
#![no_main]

use freshet_firmware as _;
