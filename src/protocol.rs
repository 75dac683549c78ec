//! The serial protocol: one stream of bytes with two doors.
//!
//! A person, Max, Pd or an Arduino writes **lines** (`set water.rate 2000`) and reads lines; a program may send
//! **frames**, COBS with a CRC-16 around postcard messages. Both doors lead to the same [`Request`]s and [`Reply`]s:
//!
//! ```text
//! bytes ─► Splitter ─► line ─► text ──┐                    ┌─► text ──► line ──┐
//!                   └► frame ─► COBS ─┴► Request ─► Shell ─► Reply ─► COBS ─► frame ─┴► Outbox ─► bytes
//! ```
//!
//! Nothing here waits: what finds no room in the [`Outbox`] is dropped whole and counted.

mod frame;
mod message;
mod outbox;
mod shell;
mod splitter;
mod text;

pub use frame::{FRAME_MAX, FrameError, PAYLOAD_MAX, decode, encode};
pub use message::{
    Boot, Choice, Hello, NAME, Name, PAIRS, Pair, Preset, Refusal, Reply, Request, Row, SLOTS,
    Slot, Status, Tag,
};
pub use outbox::Outbox;
pub use shell::{BootRecord, Device, Job, Shell};
pub use splitter::{Item, LINE_MAX, Splitter};
pub use text::{Line, parse};
