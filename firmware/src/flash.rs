//! The scenes in flash.

use freshet::bank::Bank;
use freshet::scene::Scene;

use crate::log;

/// The bank that is built in, in its own region; a bank flashed over it takes its place.
#[unsafe(link_section = ".bank")]
#[unsafe(no_mangle)]
static BANK: [u8; include_bytes!(concat!(env!("OUT_DIR"), "/scenes.bank")).len()] =
    *include_bytes!(concat!(env!("OUT_DIR"), "/scenes.bank"));

unsafe extern "C" {
    static _bank_start: u8;
    /// Its address is the region's length.
    static _bank_length: u8;
}

/// The scenes to play: those of the bank, or where it is damaged the core's own default scene alone.
pub struct Scenes(Option<Bank<'static>>);

impl Scenes {
    /// Checks the bank in flash.
    pub fn open() -> Self {
        core::hint::black_box(&BANK);
        // SAFETY: the region is flash, as long as the memory map says, and is not written while this runs.
        let bytes = unsafe {
            core::slice::from_raw_parts(&raw const _bank_start, &raw const _bank_length as usize)
        };
        match Bank::open(bytes) {
            Ok(bank) => Self(Some(bank)),
            Err(error) => {
                log::error!("playing the built-in scene: {}", log::Display(&error));
                Self(None)
            }
        }
    }

    /// Whether the bank is damaged.
    pub fn damaged(&self) -> bool {
        self.0.is_none()
    }

    /// How many scenes there are.
    pub fn count(&self) -> u16 {
        self.0.map_or(1, |bank| bank.scenes())
    }

    /// The scene to start with.
    pub fn first(&self) -> u16 {
        self.0.map_or(0, |bank| bank.boot().scene)
    }

    /// The number of the scene of that name.
    pub fn number_of(&self, name: &str) -> Option<u16> {
        (0..self.count()).find(|number| self.scene(*number).0 == name)
    }

    /// The seed of the sound: the bank's, or else the chip's own number.
    pub fn seed(&self) -> u64 {
        self.0
            .and_then(|bank| bank.boot().seed)
            .unwrap_or_else(|| own_seed(embassy_stm32::uid::uid()))
    }

    /// Name and scene of number `index`.
    pub fn scene(&self, index: u16) -> (&'static str, Scene) {
        self.0
            .and_then(|bank| bank.scene(index))
            .unwrap_or(("built-in", Scene::default()))
    }
}

/// The seed of a box from its chip's number (FNV-1a).
fn own_seed(uid: [u8; 12]) -> u64 {
    uid.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}
