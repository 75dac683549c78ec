//! The same bubbles in f64, straight from the formulas: what the fixed-point core is measured against.

use std::f64::consts::PI;

use freshet::bubble::Bubble;
use freshet::resonator::PITCH_LIMIT;
use freshet::voices::{RISE_CAP, RISE_FADE};

use crate::births::{Sound, SoundPath};

/// Adds `sound` in pascal to both ears of `out`, whose first sample is at time 0, at `rate` Hz.
pub fn add(sound: &Sound, rate: f64, out: &mut [[f64; 2]]) {
    if matches!(sound.path, SoundPath::Dropped | SoundPath::TooHigh) {
        return;
    }
    let bubble = Bubble::new(sound.radius);
    let first = (sound.time * rate + 1e-7).floor() as usize + 1;
    // 180 dB down.
    let length = (20.7 / bubble.beta * rate) as usize;
    let end = out.len().min(first.saturating_add(length));
    if first >= end {
        return;
    }
    let age = first as f64 / rate - sound.time;
    if sound.path == SoundPath::Voice {
        for (n, frame) in out[first..end].iter_mut().enumerate() {
            let swing = voice(&bubble, sound.rise_factor, age + n as f64 / rate, rate);
            frame[0] += sound.amplitude[0] * swing;
            frame[1] += sound.amplitude[1] * swing;
        }
        return;
    }
    let omega = bubble.omega_d();
    let decay = (-bubble.beta / rate).exp();
    let (turn_im, turn_re) = (omega / rate).sin_cos();
    let ears = [0, 1].map(|ear| {
        let (im, re) = (omega * age + sound.phase[ear]).sin_cos();
        let size = sound.amplitude[ear] * (-bubble.beta * age).exp();
        [size * re, size * im]
    });
    let [mut left, mut right] = ears;
    let turn = [decay * turn_re, decay * turn_im];
    let times = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
    for frame in &mut out[first..end] {
        frame[0] += left[1];
        frame[1] += right[1];
        left = times(left, turn);
        right = times(right, turn);
    }
}

/// A bubble of amplitude 1 at age `t` seconds: soft attack HF (39), pitch `f0·(1 + ξβt)` up to the cap, and the fade at
/// the edge of the band.
pub fn voice(bubble: &Bubble, rise_factor: f64, t: f64, rate: f64) -> f64 {
    let f0 = bubble.pitch();
    let limit = (f0 * RISE_CAP).min(PITCH_LIMIT * rate);
    let slope = f0 * rise_factor * bubble.beta;
    let (turns, pitch) = if slope > 0.0 {
        let ramp = (limit - f0) / slope;
        let up = t.min(ramp);
        let turns = f0 * up + slope * up * up / 2.0 + limit * (t - up);
        (turns, f0 + slope * up)
    } else {
        (f0 * t, f0)
    };
    let e = (-bubble.beta * t).exp();
    let attack = if e >= 0.85 {
        (-(e - 0.85) * (e - 0.85) / 0.002_812_5).exp()
    } else {
        1.0
    };
    let edge = if slope > 0.0 {
        ((PITCH_LIMIT - pitch / rate) / (PITCH_LIMIT - RISE_FADE)).clamp(0.0, 1.0)
    } else {
        1.0
    };
    e * attack * edge * (2.0 * PI * turns).sin()
}

/// How far `actual` (pascal) is from the sum of `sounds` times `gain`, in dB below the latter.
pub fn residual_db(sounds: &[Sound], gain: f64, rate: u32, actual: &[[f64; 2]]) -> f64 {
    let mut wanted = vec![[0.0; 2]; actual.len()];
    for sound in sounds {
        add(sound, f64::from(rate), &mut wanted);
    }
    let (mut signal, mut error) = (0.0, 0.0);
    for (wanted, actual) in wanted.iter().zip(actual) {
        for ear in 0..2 {
            let wanted = wanted[ear] * gain;
            signal += wanted * wanted;
            error += (actual[ear] - wanted) * (actual[ear] - wanted);
        }
    }
    10.0 * (signal / error).log10()
}
