//! What is above 6 kHz, where a click shows.

use std::f64::consts::PI;

/// The band above 6 kHz.
pub struct HighBand {
    taps: Vec<f64>,
}

/// Where the band above 6 kHz is loudest, and how loud.
#[derive(Clone, Copy, Debug)]
pub struct Loudest {
    pub frame: usize,
    pub size: f64,
}

impl HighBand {
    /// A windowed sinc, 100 dB down below 3.5 kHz, for `rate` Hz.
    pub fn new(rate: u32) -> Self {
        let rate = f64::from(rate);
        let half = (rate * 0.0014) as i32;
        let corner = 4_750.0 / rate;
        let bessel = |x: f64| {
            let (mut sum, mut term) = (1.0, 1.0);
            for k in 1..40 {
                term *= (x / 2.0 / f64::from(k)).powi(2);
                sum += term;
            }
            sum
        };
        let tap = |n: i32| {
            let x = f64::from(n);
            let part = x / f64::from(half + 1);
            let window = bessel(10.0 * (1.0 - part * part).sqrt()) / bessel(10.0);
            let low = if n == 0 {
                2.0 * corner
            } else {
                (2.0 * PI * corner * x).sin() / (PI * x)
            };
            window * (f64::from(u8::from(n == 0)) - low)
        };
        Self {
            taps: (-half..=half).map(tap).collect(),
        }
    }

    /// Frames from a click to the filter's answer.
    pub fn delay(&self) -> usize {
        self.taps.len() / 2
    }

    /// The loudest answer while `range` passes the filter's middle; silence before the beginning.
    pub fn loudest(&self, x: &[[f64; 2]], range: std::ops::Range<usize>) -> Loudest {
        let half = self.delay();
        let mut loudest = Loudest {
            frame: 0,
            size: 0.0,
        };
        for frame in range.start..range.end.min(x.len() - half) {
            let before = half.saturating_sub(frame);
            let part = &x[frame + before - half..=frame + half];
            let mut sum = [0.0; 2];
            for (tap, x) in self.taps[before..].iter().zip(part) {
                sum[0] += tap * x[0];
                sum[1] += tap * x[1];
            }
            let size = sum[0].abs().max(sum[1].abs());
            if size > loudest.size {
                loudest = Loudest { frame, size };
            }
        }
        loudest
    }
}
