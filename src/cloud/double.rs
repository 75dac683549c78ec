//! From the cloud's rate to twice as many samples: half-band, images 53 dB down below a third of the cloud's rate.

use core::hint::black_box;

use crate::fixed::mul_high_down;
use crate::frame::{BLOCK, Block};

/// Samples of the cloud in a block.
pub const STEPS: usize = BLOCK / 2;
/// Samples that the filter looks back.
const BEFORE: usize = 13;
/// Taps on each side of the middle, Q31: least squares from 0 to 3/8 of the cloud's rate.
const TAPS: [i32; 6] = [
    1_348_917_376,
    -398_033_124,
    185_352_038,
    -87_955_400,
    36_898_320,
    -11_437_386,
];
/// What a second difference lacks of an acceleration is about this part of the next one: within 0.4 dB up to 0.29 of the
/// cloud's rate. Q32.
const DROOP: i32 = 472_446_402;

/// Both ears' filter.
#[derive(Clone, Debug)]
pub struct Double {
    /// What came last, and what it was before it was brightened.
    history: [[i32; BEFORE]; 2],
    raw: [[i32; 2]; 2],
    /// Samples until all of it is zero.
    rings: usize,
}

impl Double {
    /// Silent.
    pub const fn new() -> Self {
        Self {
            history: [[0; BEFORE]; 2],
            raw: [[0; 2]; 2],
            rings: 0,
        }
    }

    /// Whether nothing is left in it.
    pub fn is_silent(&self) -> bool {
        self.rings == 0
    }

    /// Adds `samples`, Q20 of a pascal, to a block.
    #[inline(never)]
    pub fn render(&mut self, samples: &[[i32; 2]; STEPS], out: &mut Block) {
        self.rings = if samples.iter().any(|sample| *sample != [0; 2]) {
            BEFORE + 2
        } else {
            self.rings.saturating_sub(STEPS)
        };
        // A constant of 64 bits would cost ten instructions where a word from memory costs one (SMLAL).
        let (taps, droop) = (black_box(TAPS), black_box(DROOP));
        for ear in 0..2 {
            let mut x = [0; BEFORE + STEPS];
            x[..BEFORE].copy_from_slice(&self.history[ear]);
            let [mut older, mut old] = self.raw[ear];
            for (x, sample) in x[BEFORE..].iter_mut().zip(samples) {
                let new = sample[ear].clamp(-LIMIT, LIMIT) << 4;
                let bend = 2 * old - older - new;
                *x = old + mul_high_down(bend, droop);
                (older, old) = (old, new);
            }
            self.raw[ear] = [older, old];
            self.history[ear].copy_from_slice(&x[STEPS..]);
            for (n, frames) in out.chunks_exact_mut(2).enumerate() {
                let x = &x[n + 2..][..2 * TAPS.len()];
                let wide = (taps.iter().enumerate()).fold(0, |wide, (k, tap)| {
                    wide + i64::from(x[TAPS.len() - 1 - k] + x[TAPS.len() + k]) * i64::from(*tap)
                });
                let [whole, half] = [x[TAPS.len() - 1], (wide >> 31) as i32].map(|x| x << 2);
                let [first, second] = frames else { continue };
                for (frame, value) in [(first, whole), (second, half)] {
                    let place = if ear == 0 {
                        &mut frame.left
                    } else {
                        &mut frame.right
                    };
                    *place = place.saturating_add(value);
                }
            }
        }
    }
}

/// Most that one sample may be, Q20: 7 Pa, so that neither the brightened sum nor the bus runs over.
const LIMIT: i32 = 7 << 20;
