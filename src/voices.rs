//! Bubbles with a pitch of their own: rising ones and single events, as exact damped rotations.
//!
//! The phase is the integral of `f0·(1 + σt)` (vdD §4), kept to 2^-59 turn from block to block; the envelope is
//! re-anchored every block; so pitch and decay do not drift however long a bubble rings. In a calm block, as nearly all
//! are, a voice is a `kernel::voice::Tone` and nothing else.

mod pitch;
mod voice;

pub use pitch::{Pitch, RISE_CAP, Strike};
pub use voice::{RISE_FADE, Voice};

use crate::kernel::voice::{Ears, play};

/// Voices that may be stolen in one block.
pub const STEALS: usize = 8;

/// Sum of all voices' amplitudes the bus takes, Q59 of a pascal: 16 Pa.
const LOUDNESS_MAX: u64 = 16 << 59;

/// What became of a bubble that asked for a voice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// It sounds.
    Sounds,
    /// It sounds, in the place of the least audible voice.
    Stole,
    /// Every voice is louder, or there were too many thefts in this block.
    Refused,
}

/// The least audible voices, softest first: levels and slots.
#[derive(Clone, Copy, Debug, Default)]
struct Weakest {
    found: [(u32, u32); STEALS],
    count: usize,
    /// How many of them are stolen.
    stolen: usize,
}

impl Weakest {
    /// Among those that sound at the end of a block and fade not yet.
    fn new(voices: &[Voice]) -> Self {
        let mut weakest = Self::default();
        for (slot, voice) in voices.iter().enumerate() {
            if voice.may_be_stolen() {
                weakest.offer((voice.tone.level() >> 32) as u32, slot as u32);
            }
        }
        weakest
    }

    /// Keeps the voice in `slot` if it is among the softest.
    fn offer(&mut self, level: u32, slot: u32) {
        if self.count == STEALS && level >= self.found[STEALS - 1].0 {
            return;
        }
        if self.count < STEALS {
            self.count += 1;
        }
        let mut i = self.count - 1;
        while i > 0 && self.found[i - 1].0 > level {
            self.found[i] = self.found[i - 1];
            i -= 1;
        }
        self.found[i] = (level, slot);
    }

    /// The slot of the softest that is left, if it is below `level`.
    fn take(&mut self, level: u32) -> Option<usize> {
        let (weak, slot) = *self.found[..self.count].get(self.stolen)?;
        (weak < level).then(|| {
            self.stolen += 1;
            slot as usize
        })
    }
}

/// All voices. `S` holds the slots; three quarters of them sound, the rest are for stolen voices that fade.
#[derive(Clone, Debug)]
pub struct Voices<S> {
    slots: S,
    /// Slots in use; they come first.
    count: usize,
    /// Of these, how many fade.
    fading: usize,
    /// Sought at the first theft in a block.
    weakest: Option<Weakest>,
    /// Sum of the amplitudes, Q59 of a pascal.
    loudness: u64,
}

impl<S> Voices<S> {
    /// No voice sounding.
    pub const fn new(slots: S) -> Self {
        Self {
            slots,
            count: 0,
            fading: 0,
            weakest: None,
            loudness: 0,
        }
    }

    /// Silences all at once; `make_room` may change the slots.
    pub fn restart(&mut self, make_room: impl FnOnce(&mut S)) {
        make_room(&mut self.slots);
        self.count = 0;
        self.fading = 0;
        self.weakest = None;
        self.loudness = 0;
    }
}

impl<S: AsRef<[Voice]> + AsMut<[Voice]>> Voices<S> {
    /// Voices that may sound at once, stolen ones apart.
    pub fn capacity(&self) -> usize {
        let slots = self.slots.as_ref().len();
        slots - slots / 4
    }

    /// Voices sounding now, stolen ones included.
    pub fn sounding(&self) -> usize {
        self.count
    }

    /// Takes in a bubble of `pitch`, if need be in the place of the least audible one. It was born `age` (Q27) of a sample
    /// before its first sample, which is due in `delay` frames, 1 at least; `gain` is its pressure in the two ears, Q28 of a
    /// pascal.
    #[inline(always)]
    pub fn start(&mut self, pitch: &Pitch, delay: u32, age: u32, gain: [i32; 2]) -> Start {
        let loudest = gain[0].unsigned_abs().max(gain[1].unsigned_abs());
        let level = u64::from(loudest) << 31;
        if self.loudness + level > LOUDNESS_MAX {
            return Start::Refused;
        }
        let full = self.count - self.fading >= self.capacity();
        if full && !self.steal(loudest >> 1) {
            return Start::Refused;
        }
        self.loudness += level;
        pitch.start(
            &mut self.slots.as_mut()[self.count],
            delay,
            age,
            gain,
            loudest,
        );
        self.count += 1;
        if full { Start::Stole } else { Start::Sounds }
    }

    /// Lets the least audible voice fade, if it is softer than `level`, Q27 of a pascal.
    #[inline(never)]
    fn steal(&mut self, level: u32) -> bool {
        let slots = self.slots.as_mut();
        if self.count >= slots.len() {
            return false;
        }
        let sounding = &slots[..self.count];
        let weakest = self.weakest.get_or_insert_with(|| Weakest::new(sounding));
        let slot = weakest.take(level);
        if let Some(slot) = slot {
            slots[slot].steal();
            self.fading += 1;
        }
        slot.is_some()
    }

    /// Adds one block of every voice.
    #[inline(never)]
    pub fn render(&mut self, out: &mut Ears) {
        let slots = self.slots.as_mut();
        self.loudness = 0;
        self.weakest = None;
        let mut i = 0;
        while i < self.count {
            i += play(&mut slots[i..self.count], out, &mut self.loudness);
            let Some(voice) = slots[..self.count].get_mut(i) else {
                break;
            };
            let (over, stolen) = (voice.tone.is_over(), voice.is_stolen());
            let goes_on = !over
                && if stolen {
                    voice.fade(out)
                } else {
                    voice.render(out)
                };
            if goes_on {
                self.loudness += voice.tone.level();
                i += 1;
            } else {
                self.fading -= usize::from(stolen);
                self.count -= 1;
                slots[i] = slots[self.count];
            }
        }
    }
}
