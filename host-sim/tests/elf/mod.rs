//! ELF files as a linker leaves them, small enough to be written by hand.

/// A program for a 32-bit little-endian machine.
#[derive(Clone)]
pub struct Elf {
    /// The machine's number; 40 is ARM.
    pub machine: u16,
    /// Names of symbols.
    pub symbols: Vec<String>,
    /// Where something is loaded to, by address in memory, address in flash, and how many bytes.
    pub segments: Vec<[u32; 3]>,
}

impl Elf {
    /// What the firmware of a board with settings in sectors 1 and 2 looks like.
    pub fn firmware(board: &str) -> Self {
        Self {
            machine: 40,
            symbols: vec!["main".into(), format!("__freshet_board_{board}")],
            segments: vec![
                [0x0800_0000, 0x0800_0000, 0x188],
                [0x0800_C000, 0x0800_C000, 5_000],
                // Variables: their initial values lie behind the code, and some have none.
                [0x2000_0000, 0x0800_D388, 64],
                [0x2000_0040, 0x2000_0040, 0],
            ],
        }
    }

    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        const HEADER: usize = 52;
        let mut names = vec![0];
        let mut symbols = vec![0; 16];
        for name in &self.symbols {
            // Global, absolute, value 0.
            put32(&mut symbols, [names.len() as u32, 0, 0]);
            put16(&mut symbols, [0x10, 0xFFF1]);
            names.extend(name.bytes().chain([0]));
        }
        let data_at = (HEADER + 32 * self.segments.len()) as u32;
        let size = self.segments.iter().map(|segment| segment[2]).sum::<u32>();
        let data = (0..size).map(|i| (i % 251) as u8);
        let symbols_at = data_at + size;
        let names_at = symbols_at + symbols.len() as u32;
        let sections_at = names_at + names.len() as u32;

        let mut file = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        put16(&mut file, [2, self.machine]);
        put32(&mut file, [1, 0x0800_0000, HEADER as u32, sections_at, 0]);
        put16(
            &mut file,
            [HEADER as u16, 32, self.segments.len() as u16, 40, 3, 2],
        );
        let mut at = data_at;
        for &[memory, flash, size] in &self.segments {
            put32(&mut file, [1, at, memory, flash, size, size, 5, 4]);
            at += size;
        }
        file.extend(data);
        file.extend(&symbols);
        file.extend(&names);
        put32(&mut file, [0; 10]);
        let (symbols, names) = (symbols.len() as u32, names.len() as u32);
        put32(&mut file, [0, 2, 0, 0, symbols_at, symbols, 2, 1, 4, 16]);
        put32(&mut file, [0, 3, 0, 0, names_at, names, 0, 0, 1, 0]);
        file
    }
}

fn put16<const N: usize>(to: &mut Vec<u8>, numbers: [u16; N]) {
    to.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
}

fn put32<const N: usize>(to: &mut Vec<u8>, numbers: [u32; N]) {
    to.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
}
