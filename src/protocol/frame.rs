//! Frames: COBS and a CRC-16 around a postcard message.
//!
//! On the line: `00`, the COBS code of a payload, `00`. The payload: two zeros, the message, its CRC-16 (IBM 3740, over
//! the message alone, low byte first).

use crc::{CRC_16_IBM_3740, Crc, Table};
use serde::{Deserialize, Serialize};

/// Longest payload, bytes.
pub const PAYLOAD_MAX: usize = 320;
/// Longest frame on the line, without its delimiters, bytes.
pub const FRAME_MAX: usize = PAYLOAD_MAX + PAYLOAD_MAX / 254 + 1;

/// COBS codes these two as the mark by which a frame is told from a line.
const HEAD: [u8; 2] = [0, 0];
const CHECK: usize = 2;

static CRC: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);

/// Why bytes are not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// Not COBS, or not headed as a frame, or too short or too long.
    Frame,
    /// The checksum is wrong.
    Checksum,
    /// Not a message that this version knows.
    Message,
}

/// Writes `message` with both delimiters into `out`; returns how long it is. Fails where it does not fit.
pub fn encode(message: &impl Serialize, out: &mut [u8]) -> Result<usize, FrameError> {
    let mut payload = [0; PAYLOAD_MAX];
    let room = PAYLOAD_MAX - CHECK;
    let length = postcard::to_slice(message, &mut payload[HEAD.len()..room])
        .map_err(|_| FrameError::Frame)?
        .len();
    let end = HEAD.len() + length;
    let check = CRC.checksum(&payload[HEAD.len()..end]).to_le_bytes();
    payload[end..end + CHECK].copy_from_slice(&check);
    let payload = &payload[..end + CHECK];
    let least = cobs::max_encoding_length(payload.len()) + 2;
    if out.len() < least {
        return Err(FrameError::Frame);
    }
    out[0] = 0;
    let length = 1 + cobs::encode(payload, &mut out[1..]);
    out[length] = 0;
    Ok(length + 1)
}

/// The message in a frame without its delimiters; `payload` is where it is unpacked.
pub fn decode<'a, M: Deserialize<'a>>(
    frame: &[u8],
    payload: &'a mut [u8; PAYLOAD_MAX],
) -> Result<M, FrameError> {
    if frame.len() > FRAME_MAX {
        return Err(FrameError::Frame);
    }
    let length = cobs::decode(frame, payload)
        .map_err(|_| FrameError::Frame)?
        .frame_size();
    let payload: &'a [u8] = payload;
    let body = payload[..length]
        .strip_prefix(&HEAD)
        .ok_or(FrameError::Frame)?;
    let (message, check) = body.split_last_chunk::<CHECK>().ok_or(FrameError::Frame)?;
    if CRC.checksum(message) != u16::from_le_bytes(*check) {
        return Err(FrameError::Checksum);
    }
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::Message),
    }
}
