//! What is heard, in numbers: levels and a spectrum.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use freshet::Frame;
use realfft::{RealFftPlanner, RealToComplex};

/// Frames of a transform.
const WINDOW: usize = 4096;
/// Bands of the spectrum, evenly spaced by ratio.
pub const BANDS: usize = 60;
/// Ends of the spectrum, Hz: ten octaves.
pub const LOWEST: f32 = 20.0;
/// See [`LOWEST`].
pub const HIGHEST: f32 = 20_480.0;
/// What silence reads, dB.
pub const SILENCE: f32 = -120.0;
/// Full scale of 24 bits.
const FULL: f32 = 8_388_608.0;

/// Levels and a spectrum, in dB below full scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Sound {
    /// Left and right, the mean of the last moment.
    pub level: [f32; 2],
    /// Highest of the last seconds.
    pub peak: [f32; 2],
    /// The loudest part in each band from [`LOWEST`] to [`HIGHEST`].
    pub bands: Vec<f32>,
}

impl Default for Sound {
    fn default() -> Self {
        Self {
            level: [SILENCE; 2],
            peak: [SILENCE; 2],
            bands: vec![SILENCE; BANDS],
        }
    }
}

/// Where the sound passes by.
#[derive(Clone, Debug, Default)]
pub struct Tap(Arc<Mutex<Passing>>);

#[derive(Debug, Default)]
struct Passing {
    mid: VecDeque<f32>,
    squares: [f64; 2],
    peak: [f32; 2],
    frames: u32,
}

impl Tap {
    /// Takes note of what is heard.
    pub fn pass(&self, frames: &[Frame]) {
        let mut passing = self.lock();
        for frame in frames {
            let ears = [frame.left as f32 / FULL, frame.right as f32 / FULL];
            for (ear, value) in ears.into_iter().enumerate() {
                passing.squares[ear] += f64::from(value * value);
                passing.peak[ear] = passing.peak[ear].max(value.abs());
            }
            if passing.mid.len() == WINDOW {
                passing.mid.pop_front();
            }
            passing.mid.push_back((ears[0] + ears[1]) / 2.0);
        }
        passing.frames += frames.len() as u32;
    }

    fn lock(&self) -> MutexGuard<'_, Passing> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Measures what passes a tap, time and again.
pub struct Meter {
    tap: Tap,
    rate: f32,
    fft: Arc<dyn RealToComplex<f32>>,
    window: Vec<f32>,
}

impl Meter {
    /// Of a sound at `rate` Hz.
    pub fn new(tap: Tap, rate: f32) -> Self {
        let turn = std::f32::consts::TAU / WINDOW as f32;
        Self {
            tap,
            rate,
            fft: RealFftPlanner::new().plan_fft_forward(WINDOW),
            // Hann, such that a sine at full scale reads 1.
            window: (0..WINDOW)
                .map(|n| (1.0 - (n as f32 * turn).cos()) * 2.0 / WINDOW as f32)
                .collect(),
        }
    }

    /// Goes on from the last measure, `seconds` ago: meters fall slowly.
    pub fn measure(&self, sound: &mut Sound, seconds: f32) {
        let mut passing = self.tap.lock();
        let frames = std::mem::take(&mut passing.frames);
        let squares = std::mem::take(&mut passing.squares);
        let peaks = std::mem::take(&mut passing.peak);
        let mid: Vec<f32> = passing.mid.iter().copied().collect();
        drop(passing);
        for ear in 0..2 {
            if frames > 0 {
                let mean = (squares[ear] / f64::from(frames)) as f32;
                fall(&mut sound.level[ear], decibels(mean), 40.0 * seconds);
            }
            fall(
                &mut sound.peak[ear],
                decibels(peaks[ear].powi(2)),
                12.0 * seconds,
            );
        }
        if mid.len() < WINDOW {
            return;
        }
        let mut input: Vec<f32> = mid.iter().zip(&self.window).map(|(x, w)| x * w).collect();
        let mut output = self.fft.make_output_vec();
        if self.fft.process(&mut input, &mut output).is_err() {
            return;
        }
        let ratio = (HIGHEST / LOWEST).powf(1.0 / BANDS as f32);
        let bin = self.rate / WINDOW as f32;
        for (band, level) in sound.bands.iter_mut().enumerate() {
            let low = LOWEST * ratio.powi(band as i32);
            let first = ((low / bin).round() as usize).min(output.len() - 1);
            let last = ((low * ratio / bin).round() as usize).clamp(first + 1, output.len());
            let powers = output.get(first..last.max(first + 1)).unwrap_or_default();
            let power = powers.iter().map(|x| x.norm_sqr()).fold(0.0, f32::max);
            fall(level, decibels(power), 40.0 * seconds);
        }
    }
}

/// Up at once, down slowly.
fn fall(level: &mut f32, to: f32, by: f32) {
    *level = to.max(*level - by).max(SILENCE);
}

fn decibels(power: f32) -> f32 {
    (10.0 * power.max(1e-30).log10()).max(SILENCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_reads_its_level_where_it_is() {
        let tap = Tap::default();
        let meter = Meter::new(tap.clone(), 48_000.0);
        let mut sound = Sound::default();
        let sine = (0..9600).map(|n| {
            let x = (n as f32 * std::f32::consts::TAU * 1000.0 / 48_000.0).sin();
            Frame {
                left: (x * 0.5 * FULL) as i32,
                right: (x * 0.5 * FULL) as i32,
            }
        });
        tap.pass(&sine.collect::<Vec<_>>());
        meter.measure(&mut sound, 0.05);
        assert!((sound.peak[0] + 6.0).abs() < 0.1, "{:?}", sound.peak);
        assert!((sound.level[1] + 9.0).abs() < 0.1, "{:?}", sound.level);
        let loudest = (0..BANDS).max_by(|a, b| sound.bands[*a].total_cmp(&sound.bands[*b]));
        let expected = (1000.0 / LOWEST).log2() / 10.0 * BANDS as f32;
        assert_eq!(loudest, Some(expected as usize));
        assert!((sound.bands[expected as usize] + 6.0).abs() < 2.0);
        for _ in 0..400 {
            tap.pass(&[Frame::ZERO; 1024]);
            meter.measure(&mut sound, 0.05);
        }
        assert_eq!(sound, Sound::default());
    }
}
