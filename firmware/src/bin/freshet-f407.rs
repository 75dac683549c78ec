//! The firmware of STM32F407G-DISC1.
#![no_std]
#![no_main]

use freshet_firmware as _;
