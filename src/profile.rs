//! What a board can hold: a set of compile-time capacities.

use crate::cloud::{Hold, Keep, Keeper, Store};
use crate::kernel::cloud::MEMBERS;
use crate::population::Crowd;
use crate::update::Update;
use crate::voices::Voice;

/// What a board takes of the population's parameters, however far they are turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Most {
    /// Births a second.
    pub rate: f32,
    /// Radius classes; more are as many over the same radii.
    pub classes: usize,
}

/// What a board has time for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Without a cloud.
    pub alone: Most,
    /// Beside a cloud.
    pub beside_cloud: Most,
    /// Bubbles of a cloud.
    pub bubbles: usize,
}

/// A board's capacities. The same profile, seed, scene and events give the same samples on every machine.
pub trait Profile: Clone + Send + core::fmt::Debug {
    /// The name on the command line.
    const NAME: &'static str;
    /// Slots for voices; three quarters of them may sound at once, the rest are for stolen ones that fade.
    const VOICES: usize;
    /// What its control path takes.
    const LIMITS: Limits;
    /// Most births in a block: far beyond what chance makes of the most a second.
    const BIRTHS_PER_BLOCK: u32;
    /// Where voices live.
    type Voices: AsRef<[Voice]> + AsMut<[Voice]> + Clone + Send + core::fmt::Debug;
    /// The slots before the start, idle; none yet where they are allocated.
    const IDLE: Self::Voices;
    /// Allocates the slots, at the start.
    fn make_room(_voices: &mut Self::Voices) {}
    /// What goes between control and audio path, with room for the most births a second over the sample rate
    /// crowds.
    type Update: AsRef<Update> + AsMut<Update> + Clone + Send + core::fmt::Debug;
    /// An empty one.
    fn update() -> Self::Update;
    /// Where the cloud lives.
    type Cloud: Hold + Clone + Send + core::fmt::Debug;
    /// At rest.
    const CLOUD: Self::Cloud;
    /// Where its control path lives.
    type Keeper: Keep + Clone + Send + core::fmt::Debug;
    /// Before it starts, with nobody in it.
    const KEEPER: Self::Keeper;
}

/// Births a second and classes, without a cloud and beside one; bubbles of a cloud.
pub const fn limits([alone, beside]: [f32; 2], classes: [usize; 2], bubbles: usize) -> Limits {
    Limits {
        alone: Most {
            rate: alone,
            classes: classes[0],
        },
        beside_cloud: Most {
            rate: beside,
            classes: classes[1],
        },
        bubbles,
    }
}

macro_rules! board {
    ($(#[$doc:meta])* $type:ident, $name:literal, $voices:literal, $limits:expr, $births:literal, $crowds:literal,
     $clusters:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $type;

        impl Profile for $type {
            const NAME: &'static str = $name;
            const VOICES: usize = $voices;
            const LIMITS: Limits = {
                assert!($limits.bubbles == $clusters * MEMBERS);
                $limits
            };
            const BIRTHS_PER_BLOCK: u32 = $births;
            type Voices = [Voice; $voices];
            const IDLE: Self::Voices = [Voice::IDLE; $voices];
            type Update = Update<[Crowd; $crowds]>;
            fn update() -> Self::Update {
                Update::new()
            }
            // One cluster more for what rings out; a row of the core for each cluster and ear, by groups of eight.
            type Cloud = Store<{ $clusters + 1 }, { $clusters + 3 }, { $clusters / 8 * ($clusters + 2) }>;
            const CLOUD: Self::Cloud = Store::REST;
            type Keeper = Keeper<$clusters>;
            const KEEPER: Self::Keeper = Keeper::OFF;
        }
    };
}

board!(
    /// STM32F411, 100 MHz.
    F411, "f411", 12, limits([80e3, 15e3], [22, 8], 64), 130, 2, 8
);
board!(
    /// STM32F407, 168 MHz.
    F407, "f407", 48, limits([200e3, 70e3], [64, 28], 128), 280, 4, 16
);
board!(
    /// STM32H743, 480 MHz.
    H743, "h743", 256, limits([500e3; 2], [64; 2], 256), 600, 10, 32
);
