//! Each firmware's stack stands where its board's memory map says.

mod common;

use common::elf;

#[test]
fn every_stack_stands_at_the_lowest_address_of_its_memory() {
    // The stack grows down to where there is no memory, so that one that overflows faults.
    for (board, start) in [
        ("f407", 0x2000_8000_u32),
        ("f411", 0x2000_8000),
        ("h743", 0x2401_0000),
    ] {
        let elf = elf(board);
        let first = elf.read(0x0800_0000, 4).expect("the vectors");
        assert_eq!(first, start.to_le_bytes(), "{board}");
        let bank = elf.section(".bank").expect("the scenes are linked");
        assert!(bank.loaded && bank.size > 1_000, "{board}: {bank:?}");
    }
}
