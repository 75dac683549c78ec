//! `freshet control`: the instrument on a terminal, with sliders, a histogram to draw in, meters and undo.
//!
//! ```text
//! keys, mouse ─► input ─► Action ─► Model ─► view ─► screen
//!                                   │   ▲
//!                             Order ▼   │ News
//!                                  link thread ◄─► board, or a twin here
//! ```
//!
//! The [`model`] and what is drawn of it ([`view`]) know neither terminal nor port; [`link`] has the port to itself, so
//! that the screen never waits.

pub mod action;
pub mod classes;
pub mod engine;
pub mod history;
pub mod input;
pub mod layout;
pub mod link;
pub mod model;
pub mod outbox;
pub mod save;
mod session;
pub mod slider;
pub mod sound;
pub mod terminal;
pub mod view;

pub use session::{Request, control, fit};
