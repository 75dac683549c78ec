//! Everything the serial protocol can do, through the board's own USART.

mod common;

use std::time::Duration;

use common::{START, board, scene};
use emulated_board::Setup;

#[test]
fn it_says_who_it_is() {
    let mut board = board(&[("tap", scene("tap"))], 1, Setup::default());
    board.run(START).expect("it runs");
    board.serial_send(b"status\nget mix.level\nset mix.level -6\nlist mix\n").expect("sent");
    board.run(Duration::from_millis(400)).expect("it runs");
    println!("{}", String::from_utf8_lossy(&board.serial_take()));
    println!("{:?}", board.unmodelled());
}
