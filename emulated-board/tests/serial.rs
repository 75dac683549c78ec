//! debugging
mod common;
use std::time::Duration;
use common::{START, board, scene};
use emulated_board::Setup;
#[test]
fn it_says_who_it_is() {
    let mut board = board(&[("tap", scene("tap"))], 1, Setup::default());
    board.hang("freshet_firmware::blackbox::crash").or_else(|_| board.hang("rust_begin_unwind")).expect("hang");
    board.run(START).expect("it runs");
    let r = board.registers().unwrap();
    println!("{r}");
    let text = format!("{r:?}");
    println!("{text}");
    let stack = board.read(0x20000000, 0x18000).unwrap();
    let painted = 0xc0de_ca5e_u32.to_le_bytes();
    let free = stack.chunks(4).take_while(|w| *w == painted).count();
    println!("free {} bytes", 4*free);
    for (i, w) in stack.chunks(4).enumerate().skip(free) {
        let w = u32::from_le_bytes(w.try_into().unwrap());
        if (0x0800c000..0x08045000).contains(&w) && w & 1 == 1 { println!("{:08x}: {w:08x}", 0x20000000 + 4*i); }
    }
}
