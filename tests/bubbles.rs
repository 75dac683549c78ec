//! One bubble: pitch and decay, measured from the sound, against physics §1; the table of the paper's figures.

mod common;

use common::desk;
use freshet::bubble::Bubble;
use freshet::fixed::PASCAL;
use freshet::mix::Output;
use freshet::param;
use freshet::resonator::{Form, Impulse, PITCH_LIMIT, State, Tuning};
use freshet::scene::Scene;
use freshet::voices::{Pitch, Strike};
use freshet::{BLOCK, Frame};
use freshet_host::scene_file::put;

const RATES: [u32; 4] = [32_000, 44_100, 48_000, 96_000];
const RADII_MM: [f64; 14] = [
    0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 150.0,
];

/// Pitch in Hz and decay in 1/s of a lone damped sine: linear prediction over a sixth of a period, least squares.
fn measure(sound: &[f64], rate: f64, about: f64) -> (f64, f64) {
    let stride = ((rate / about / 6.0).round() as usize).max(1);
    let (mut aa, mut ab, mut bb, mut ay, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for n in 2 * stride..sound.len() {
        let (y, a, b) = (sound[n], sound[n - stride], sound[n - 2 * stride]);
        aa += a * a;
        ab += a * b;
        bb += b * b;
        ay += a * y;
        by += b * y;
    }
    let det = aa * bb - ab * ab;
    let (p, q) = ((ay * bb - by * ab) / det, (by * aa - ay * ab) / det);
    let radius = (-q).sqrt();
    let angle = (p / (2.0 * radius)).acos();
    let step = stride as f64 / rate;
    (
        angle / step / (2.0 * std::f64::consts::PI),
        -radius.ln() / step,
    )
}

/// Largest errors of pitch (percent) and decay (percent), inside and outside 0.2 to 50 mm.
#[derive(Default)]
struct Worst {
    inner: [f64; 2],
    outer: [f64; 2],
}

impl Worst {
    fn add(&mut self, radius_mm: f64, bubble: &Bubble, (pitch, decay): (f64, f64)) {
        let errors = [pitch / bubble.pitch() - 1.0, decay / bubble.beta - 1.0];
        let inner = (0.2..=50.0).contains(&radius_mm);
        let worst = if inner {
            &mut self.inner
        } else {
            &mut self.outer
        };
        for (worst, error) in worst.iter_mut().zip(errors) {
            *worst = worst.max(error.abs() * 100.0);
        }
    }

    fn check(&self, what: &str) {
        let Self { inner, outer } = self;
        println!(
            "{what}: 0.2 to 50 mm pitch {:.5} %, decay {:.4} %",
            inner[0], inner[1]
        );
        println!(
            "{what}: outside that  pitch {:.5} %, decay {:.4} %",
            outer[0], outer[1]
        );
        assert!(inner[0] < 0.05 && inner[1] < 1.0, "{what}: {inner:?} %");
        assert!(outer[0] < 0.5 && outer[1] < 3.0, "{what}: {outer:?} %");
    }
}

#[test]
fn pitch_and_decay_of_physics_1_match_its_table() {
    let table = [
        (0.3, 10937.9, 2087.6),
        (1.0, 3282.7, 414.2),
        (3.0, 1094.4, 100.4),
        (10.0, 328.3, 23.0),
    ];
    for (mm, f0, beta) in table {
        let bubble = Bubble::new(mm * 1e-3);
        let got = bubble.omega0 / (2.0 * std::f64::consts::PI);
        assert!(
            (got / f0 - 1.0).abs() < 1e-4,
            "{mm} mm: f0 {got:.2} Hz, expected {f0}"
        );
        // The table rounds a factor to 1.6e6; the formula gives 1.596e6.
        let off = bubble.beta / beta - 1.0;
        assert!(
            off.abs() < 1e-3,
            "{mm} mm: {:.2} 1/s, expected {beta}",
            bubble.beta
        );
    }
}

#[test]
fn a_voice_has_the_pitch_and_decay_of_physics_1_at_every_rate() {
    let mut silent = Scene::default();
    put(&mut silent, param::RATE, 0.0);
    let mut worst = Worst::default();
    for rate in RATES {
        for mm in RADII_MM {
            let bubble = Bubble::new(mm * 1e-3);
            let mut player = desk(&silent, rate, 1, Output::Raw);
            let pitch = Pitch::new(mm as f32 * 1e-3, 0.0, f64::from(rate));
            player.strike(&Strike::new(pitch, 10.3, [1 << 28; 2]), &mut ());
            let rate_hz = f64::from(rate);
            if bubble.pitch() > PITCH_LIMIT * rate_hz {
                assert_eq!(player.stats().too_high, 1, "{mm} mm at {rate} Hz");
                continue;
            }
            // From after the soft attack, over four time constants.
            let skip = (0.2 / bubble.beta * rate_hz) as usize + 12;
            let mut frames = vec![Frame::ZERO; skip + (4.0 / bubble.beta * rate_hz) as usize + 16];
            player.render(&mut frames);
            assert!(frames.iter().all(|frame| frame.left == frame.right));
            let sound: Vec<f64> = frames[skip..]
                .iter()
                .map(|frame| f64::from(frame.left))
                .collect();
            worst.add(mm, &bubble, measure(&sound, rate_hz, bubble.pitch()));
        }
    }
    worst.check("voice");
}

#[test]
fn a_class_has_the_pitch_and_decay_of_physics_1_at_every_rate() {
    let mut worst = Worst::default();
    for rate in RATES {
        for mm in RADII_MM {
            let bubble = Bubble::new(mm * 1e-3);
            let rate_hz = f64::from(rate);
            let tuning = Tuning::new(mm as f32 * 1e-3, rate_hz);
            if tuning.form == Form::Silent {
                assert!(
                    bubble.pitch() > PITCH_LIMIT * rate_hz,
                    "{mm} mm at {rate} Hz"
                );
                continue;
            }
            let mut state = State::SILENT;
            let (first, second) = tuning.words((0, 1 << 30));
            let impulse = Impulse {
                left: 1 << 28,
                right: 1 << 27,
                first,
                second,
            };
            state.strike(tuning.form.strike(impulse));
            let length = (4.0 / bubble.beta * rate_hz) as usize / BLOCK * BLOCK + BLOCK;
            let mut frames = vec![Frame::ZERO; length];
            state.run(&tuning, &mut frames);
            let sound: Vec<f64> = frames.iter().map(|frame| f64::from(frame.left)).collect();
            worst.add(mm, &bubble, measure(&sound, rate_hz, bubble.pitch()));
            let peak = sound.iter().fold(0.0f64, |peak, x| peak.max(x.abs())) / f64::from(PASCAL);
            assert!(peak < 1.001, "{mm} mm at {rate} Hz: peak {peak} Pa of 1 Pa");
        }
    }
    worst.check("class");
}

#[test]
fn a_rising_bubble_follows_f0_times_1_plus_sigma_t_up_to_its_cap() {
    // Pitch from the phase between zero crossings, against the mean of the law between them.
    let (mm, rise_factor, rate) = (5.0, 0.5, 48_000.0);
    let bubble = Bubble::new(mm * 1e-3);
    let mut silent = Scene::default();
    put(&mut silent, param::RATE, 0.0);
    let mut player = desk(&silent, 48_000, 1, Output::Raw);
    let pitch = Pitch::new(mm as f32 * 1e-3, rise_factor, rate);
    player.strike(&Strike::new(pitch, 0.0, [1 << 28; 2]), &mut ());
    let mut frames = vec![Frame::ZERO; 9_600];
    player.render(&mut frames);
    let mut crossings = Vec::new();
    for n in 1..frames.len() {
        let (a, b) = (f64::from(frames[n - 1].left), f64::from(frames[n].left));
        if a < 0.0 && b >= 0.0 {
            crossings.push((n as f64 - 1.0 + a / (a - b)) / rate);
        }
    }
    let law = |t: f64| {
        let up = bubble.pitch() * (1.0 + f64::from(rise_factor) * bubble.beta * t);
        up.min(4.0 * bubble.pitch())
    };
    let mut worst = 0.0f64;
    for pair in crossings
        .windows(2)
        .take_while(|pair| pair[0] * bubble.beta < 8.0)
    {
        let measured = 1.0 / (pair[1] - pair[0]);
        let expected = law((pair[0] + pair[1]) / 2.0);
        worst = worst.max((1200.0 * (measured / expected).log2()).abs());
    }
    println!(
        "rising pitch: {} periods, worst {worst:.2} cents",
        crossings.len()
    );
    assert!(crossings.len() > 50);
    assert!(worst < 5.0, "{worst} cents");
}
