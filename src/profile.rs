//! What a board can hold: a set of compile-time capacities.

use crate::cloud::{Hold, Keep, Keeper, Store};
use crate::population::Crowd;
use crate::update::Update;
use crate::voices::Voice;

/// A board's capacities. The same profile, seed, scene and events give the same samples on every machine.
pub trait Profile: Clone + Send + core::fmt::Debug {
    /// The name on the command line.
    const NAME: &'static str;
    /// Slots for voices; three quarters of them may sound at once, the rest are for stolen ones that fade.
    const VOICES: usize;
    /// Most births a second.
    const MAX_RATE: f32;
    /// Most births in a block: far beyond what chance makes of `MAX_RATE`.
    const BIRTHS_PER_BLOCK: u32;
    /// Where voices live.
    type Voices: AsRef<[Voice]> + AsMut<[Voice]> + Clone + Send + core::fmt::Debug;
    /// `VOICES` idle slots.
    fn voices() -> Self::Voices;
    /// What goes between control and audio path, with room for `MAX_RATE` over the sample rate crowds.
    type Update: AsRef<Update> + AsMut<Update> + Clone + Send + core::fmt::Debug;
    /// An empty one.
    fn update() -> Self::Update;
    /// Where the cloud lives.
    type Cloud: Hold + Clone + Send + core::fmt::Debug;
    /// At rest.
    fn cloud() -> Self::Cloud;
    /// Where its control path lives.
    type Keeper: Keep + Clone + Send + core::fmt::Debug;
    /// With nobody in it.
    fn keeper(seed: u64, sample_rate: u32) -> Self::Keeper;
}

macro_rules! board {
    ($(#[$doc:meta])* $type:ident, $name:literal, $voices:literal, $rate:literal, $births:literal,
     $crowds:literal, $clusters:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $type;

        impl Profile for $type {
            const NAME: &'static str = $name;
            const VOICES: usize = $voices;
            const MAX_RATE: f32 = $rate;
            const BIRTHS_PER_BLOCK: u32 = $births;
            type Voices = [Voice; $voices];
            fn voices() -> Self::Voices {
                [Voice::default(); $voices]
            }
            type Update = Update<[Crowd; $crowds]>;
            fn update() -> Self::Update {
                Update::new()
            }
            // One cluster more for what rings out; a row of the core for each cluster and ear, by groups of eight.
            type Cloud = Store<{ $clusters + 1 }, { $clusters + 3 }, { $clusters / 8 * ($clusters + 2) }>;
            fn cloud() -> Self::Cloud {
                Store::new()
            }
            type Keeper = Keeper<$clusters>;
            fn keeper(seed: u64, sample_rate: u32) -> Self::Keeper {
                Keeper::new(seed, f64::from(sample_rate))
            }
        }
    };
}

board!(
    /// STM32F411, 100 MHz.
    F411, "f411", 32, 100_000.0, 160, 2, 8
);
board!(
    /// STM32F407, 168 MHz.
    F407, "f407", 64, 200_000.0, 280, 4, 16
);
board!(
    /// STM32H743, 480 MHz.
    H743, "h743", 256, 500_000.0, 600, 10, 32
);
