//! What the control path hands to the audio path at a tick.
//!
//! There are two of these. One is in force: the audio path reads it at every block. The other is being filled by the
//! control path, for the next tick. At a tick's first block they change places; nothing is copied and nothing locked.

use heapless::Vec;

use crate::cloud::Message;
use crate::drops::STRIKES;
use crate::mix;
use crate::population::{self, Crowd, Slice};
use crate::voices::Strike;

/// All that the audio path needs for a tick. `C` is where crowds live, see [`population::Settings`]; an
/// `Update<[Crowd; N]>` is used as an `Update`.
#[derive(Clone, Debug)]
pub struct Update<C: ?Sized = [Crowd]> {
    /// Classes that are tuned otherwise from this tick on.
    pub(crate) slice: Option<Slice>,
    /// The mix's settings, where they change.
    pub(crate) mix: Option<mix::Settings>,
    /// Single bubbles, none of which is due before the next tick.
    pub(crate) strikes: Vec<Strike, STRIKES>,
    /// What the cloud is to take.
    pub(crate) cloud: Message,
    /// Which [`Drive`](population::Drive) `water` is made of; 0: none yet.
    pub(crate) version: u32,
    /// The population's settings, which hold for as long as this update does.
    pub(crate) water: population::Settings<C>,
}

impl<const N: usize> Update<[Crowd; N]> {
    /// Nothing at all, to be filled by [`Control::tick`](crate::control::Control::tick).
    pub const fn new() -> Self {
        Self {
            slice: None,
            mix: None,
            strikes: Vec::new(),
            cloud: Message::NONE,
            version: 0,
            water: population::Settings::new(),
        }
    }
}

impl<const N: usize> Default for Update<[Crowd; N]> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> AsRef<Update> for Update<[Crowd; N]> {
    fn as_ref(&self) -> &Update {
        self
    }
}

impl<const N: usize> AsMut<Update> for Update<[Crowd; N]> {
    fn as_mut(&mut self) -> &mut Update {
        self
    }
}
