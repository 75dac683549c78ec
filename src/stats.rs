//! What is counted while sound is made. Counters wrap; nothing depends on them.

/// Counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Bubbles born, all kinds.
    pub births: u64,
    /// Of these, rising ones that asked for a voice.
    pub rising: u64,
    /// Single events: drops, and bubbles from a file.
    pub events: u64,
    /// Voices that faded early to make room for a louder one.
    pub stolen: u64,
    /// Rising bubbles that found no voice and went to their class.
    pub unvoiced: u64,
    /// Single events that found no voice and were not sounded.
    pub dropped: u64,
    /// Bubbles above the pitch limit, not sounded.
    pub too_high: u64,
    /// Blocks with more births than the board's bound; the rest were born a block later.
    pub late: u64,
    /// Births whose resonator was at its limit.
    pub overloads: u64,
    /// Frames on which the limiter held the sound down.
    pub limited: u64,
    /// Frames that the limiter had to clip; stays 0.
    pub clipped: u64,
}

impl Stats {
    /// Nothing yet.
    pub const NONE: Self = Self {
        births: 0,
        rising: 0,
        events: 0,
        stolen: 0,
        unvoiced: 0,
        dropped: 0,
        too_high: 0,
        late: 0,
        overloads: 0,
        limited: 0,
        clipped: 0,
    };
}
