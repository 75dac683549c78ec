//! The firmware's log over SEGGER's real-time transfer: the first up-channel, drained as a probe does.

use rigless::emulator::Host;
use rigless::soc::Width;

use crate::board::Error;

/// Where the control block keeps the first up-channel, after its 16-byte mark and two counts.
const CHANNEL: u32 = 24;
/// Offsets in a channel's descriptor.
const BUFFER: u32 = 4;
const SIZE: u32 = 8;
const WRITE: u32 = 12;
const READ: u32 = 16;
/// No buffer of a microcontroller is larger.
const MOST: u32 = 1 << 20;

/// What is in the channel of the control block at `block`, taken out of it.
pub(crate) fn drain(host: &mut dyn Host, block: u32) -> Result<Vec<u8>, Error> {
    let address = block;
    let mut word = |at: u32| {
        let word = host.read(u64::from(at), Width::W32);
        word.map(|word| word as u32)
            .map_err(|_| Error::NoMemory { address })
    };
    let mark = word(block)?;
    let channel = block + CHANNEL;
    let (buffer, size) = (word(channel + BUFFER)?, word(channel + SIZE)?);
    let (write, read) = (word(channel + WRITE)?, word(channel + READ)?);
    // Before the firmware has set it up, the block is whatever RAM holds.
    let ready = mark == u32::from_le_bytes(*b"SEGG");
    if !ready || size == 0 || size > MOST || write >= size || read >= size {
        return Ok(Vec::new());
    }
    let count = (write + size - read) % size;
    let bytes = (0..count)
        .map(|nth| host.read(u64::from(buffer + (read + nth) % size), Width::W8))
        .map(|byte| byte.map(|byte| byte as u8))
        .collect::<Result<_, _>>()
        .map_err(|_| Error::NoMemory { address })?;
    host.write(u64::from(channel + READ), Width::W32, u64::from(write))
        .map_err(|_| Error::NoMemory { address })?;
    Ok(bytes)
}
