//! The firmware of NUCLEO-H743ZI2.
#![no_std]
#![no_main]

use freshet_firmware as _;
