//! MIDI, byte by byte: running status, real-time bytes in between, system exclusive skipped.

/// What a channel says. Channels count from 1, as people do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    /// 1 to 16.
    pub channel: u8,
    /// What it is.
    pub kind: Kind,
}

/// The messages that are of use here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A key, 0 to 127, pressed with a velocity of 1 to 127.
    NoteOn(u8, u8),
    /// A controller, 0 to 127, at 0 to 127.
    Control(u8, u8),
    /// A program from 0.
    Program(u8),
}

/// Takes bytes one by one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parser {
    /// The status that data bytes belong to; 0: none.
    status: u8,
    /// The first of two data bytes.
    first: Option<u8>,
}

impl Parser {
    /// The message that ends with `byte`.
    pub fn push(&mut self, byte: u8) -> Option<Message> {
        match byte {
            // Real time: anywhere, and nothing to do with what is around it.
            0xF8.. => None,
            // System common and exclusive: the data after them belongs to no channel.
            0xF0..=0xF7 => {
                *self = Self::default();
                None
            }
            0x80..=0xEF => {
                (self.status, self.first) = (byte, None);
                None
            }
            _ => self.data(byte),
        }
    }

    fn data(&mut self, byte: u8) -> Option<Message> {
        let kind = match self.status & 0xF0 {
            0xC0 => Kind::Program(byte),
            // Pressure of a channel: of one byte too.
            0 | 0xD0 => return None,
            status => {
                let Some(first) = self.first.take() else {
                    self.first = Some(byte);
                    return None;
                };
                match status {
                    // Without velocity it ends a note.
                    0x90 if byte > 0 => Kind::NoteOn(first, byte),
                    0xB0 => Kind::Control(first, byte),
                    _ => return None,
                }
            }
        };
        let channel = (self.status & 0x0F) + 1;
        Some(Message { channel, kind })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Vec<(u8, Kind)> {
        let mut parser = Parser::default();
        let messages = bytes.iter().filter_map(|byte| parser.push(*byte));
        messages
            .map(|message| (message.channel, message.kind))
            .collect()
    }

    #[test]
    fn messages_of_all_kinds() {
        use Kind::{Control, NoteOn, Program};
        let bytes = [
            0xB0, 74, 100, 0x99, 60, 127, 0x89, 60, 0, 0x99, 60, 0, 0xCF, 5, 0xE0, 0, 64, 0xD0, 9,
            0xA0, 60, 3, 0xB1, 1, 2,
        ];
        let wanted = [
            (1, Control(74, 100)),
            (10, NoteOn(60, 127)),
            (16, Program(5)),
            (2, Control(1, 2)),
        ];
        assert_eq!(read(&bytes), wanted);
    }

    #[test]
    fn running_status_and_real_time_in_between() {
        use Kind::{Control, Program};
        let bytes = [0xF8, 0xB0, 0xFE, 7, 0xF8, 1, 7, 2, 0xFA, 8, 3, 0xC0, 1, 2];
        let wanted = [
            (1, Control(7, 1)),
            (1, Control(7, 2)),
            (1, Control(8, 3)),
            (1, Program(1)),
            (1, Program(2)),
        ];
        assert_eq!(read(&bytes), wanted);
    }

    #[test]
    fn system_messages_end_the_running_status() {
        // Exclusive, song position, and data that belongs to nothing.
        let bytes = [
            1, 2, 3, 0xB0, 7, 0xF0, 0x7E, 1, 2, 0xF7, 7, 1, 0xF2, 1, 2, 3, 0xB0, 7, 0x90, 60, 1,
        ];
        assert_eq!(read(&bytes), [(1, Kind::NoteOn(60, 1))]);
    }

    #[test]
    fn any_bytes_are_read() {
        let mut state = 1_u32;
        let mut parser = Parser::default();
        for _ in 0..1_000_000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if let Some(message) = parser.push((state >> 24) as u8) {
                assert!((1..=16).contains(&message.channel));
            }
        }
    }
}
