//! What an input wants of the board, whichever input it is.

use std::net::SocketAddr;

use freshet::param::{Param, TABLE};

/// A parameter to be moved. Its value and its ramp are known to be good.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// See [`Param::id`].
    pub id: u16,
    /// Where to.
    pub value: f32,
    /// In so many seconds; none: as the table says.
    pub ramp: Option<f32>,
}

/// A scene by its place or its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// From 0.
    Number(u16),
    /// As the board calls it.
    Name(String),
}

/// What is done one by one, in order.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Plays a scene.
    Scene(SceneChoice),
    /// Sounds a bubble: radius in mm, pressure in Pa, rise factor.
    Trigger([Option<f32>; 3]),
    /// Silence, and back.
    Mute(bool),
    /// Goes back to settings that were kept.
    Recall(u8),
    /// Asks for values by their ids; none named: all.
    Get(Vec<u16>),
    /// Reports every so many ticks; 0: no more.
    Subscribe(u16),
    /// Asks who is there.
    Hello,
    /// Asks for the scenes.
    Scenes,
}

/// Either of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    /// Only the last one of a parameter counts.
    Move(Move),
    /// Each one counts.
    Command(Command),
}

/// Who wants it, and hears the answer; none: a MIDI device, which hears nothing.
pub type Origin = Option<SocketAddr>;

/// The value of `param` at `x` of its whole range, along its curve.
pub fn along(param: &Param, x: f32) -> f32 {
    param.between(param.min, param.max, x)
}

/// A move of the parameter at `index` of the table, in the time the table says.
pub fn to(index: usize, value: f32) -> Wish {
    Wish::Move(Move {
        id: TABLE[index].id,
        value,
        ramp: None,
    })
}
