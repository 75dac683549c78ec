//! From the bus to the converter: limiter, DC blocker, tone, level and dither, driven with made-up signals.

mod common;

use std::f64::consts::PI;

use common::{db, rms};
use freshet::fixed::FULL_SCALE;
use freshet::limiter::{LOOK_AHEAD, Limiter};
use freshet::mix::{CEILING, GLIDE, Mix, Output, Settings};
use freshet::random::{Random, Stream};
use freshet::stats::Stats;
use freshet::{BLOCK, Frame};
use realfft::RealFftPlanner;

const RATE: f64 = 48_000.0;
const FULL: f64 = FULL_SCALE as f64;

/// Bus units of a level in dB below full scale.
fn dbfs(level: f64) -> f64 {
    FULL * 10f64.powf(level / 20.0)
}

fn stereo(frames: usize, ears: impl Fn(usize) -> [f64; 2]) -> Vec<Frame> {
    let frame = |n| {
        let [left, right] = ears(n).map(|x| x.round() as i32);
        Frame { left, right }
    };
    (0..frames).map(frame).collect()
}

/// The same in both ears.
fn mono(frames: usize, ear: impl Fn(usize) -> f64) -> Vec<Frame> {
    stereo(frames, |n| [ear(n); 2])
}

fn sine(amplitude: f64, hertz: f64, rate: f64) -> impl Fn(usize) -> f64 {
    move |n| amplitude * (2.0 * PI * hertz * n as f64 / rate).sin()
}

/// `frames` through `render`, block by block.
fn through(frames: &[Frame], mut render: impl FnMut(&mut [Frame; BLOCK])) -> Vec<Frame> {
    let mut out = frames.to_vec();
    out.resize(frames.len().next_multiple_of(BLOCK), Frame::ZERO);
    for block in out.chunks_mut(BLOCK) {
        render(block.try_into().expect("whole blocks"));
    }
    out
}

/// `frames` through a limiter at rest.
fn limited(frames: &[Frame], on: bool, rate: f64) -> (Vec<Frame>, Stats) {
    let (mut limiter, mut stats) = (Limiter::new(rate), Stats::default());
    let out = through(frames, |block| limiter.render(block, on, &mut stats));
    (out, stats)
}

/// `frames` through a mix at rest, at level 0 dB.
fn mixed(frames: &[Frame], output: Output, tone: f64, rate: f64) -> Vec<Frame> {
    let settings = Settings::new(0.0, tone, true);
    let mut mix = Mix::new(output, 7, &settings, rate);
    through(frames, |block| mix.render(block, &mut Stats::default()))
}

fn left(frames: &[Frame]) -> impl Iterator<Item = f64> {
    frames.iter().map(|frame| f64::from(frame.left))
}

fn loudest(frames: &[Frame]) -> u32 {
    let peak = |frame: &Frame| frame.left.unsigned_abs().max(frame.right.unsigned_abs());
    frames.iter().map(peak).max().unwrap_or(0)
}

/// Amplitude of the sine of `hertz` in `x`, under a Hann window.
fn line(x: impl ExactSizeIterator<Item = f64>, hertz: f64, rate: f64) -> f64 {
    let count = x.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (n, x) in x.enumerate() {
        let window = 1.0 - (2.0 * PI * n as f64 / count).cos();
        let (s, c) = (2.0 * PI * hertz * n as f64 / rate).sin_cos();
        re += x * window * c;
        im += x * window * s;
    }
    2.0 * f64::hypot(re, im) / count
}

#[test]
fn no_peak_passes_full_scale_up_to_30_db_over_it() {
    let mut random = Random::new(1, Stream::Population);
    let mut draw = move || f64::from(random.uniform());
    let (mut most, mut held) = (0, 0);
    for rate in [8_000.0, 48_000.0, 192_000.0] {
        for over in [0.01, 1.0, 6.0, 12.0, 20.0, 30.0] {
            for kind in ["impulses", "square bursts", "sine bursts", "noise bursts"] {
                // Bursts of 1 to 3000 frames that begin anywhere, some while the gain still comes back.
                let mut signal = vec![Frame::ZERO; 40_000];
                let mut at = 0;
                while at < signal.len() {
                    let size = dbfs(over * draw());
                    let length = 3000f64.powf(draw()) as usize;
                    let hertz = rate * 0.49 * 1000f64.powf(-draw());
                    let end = signal.len().min(at + length);
                    for (n, frame) in signal[at..end].iter_mut().enumerate() {
                        let wave = (2.0 * PI * hertz * n as f64 / rate + 0.1).sin();
                        let x = match kind {
                            "impulses" if n > 0 => 0.0,
                            "impulses" => 1.0,
                            "square bursts" => wave.signum(),
                            "sine bursts" => wave,
                            _ => 2.0 * draw() - 1.0,
                        };
                        frame.left = (size * x) as i32;
                        frame.right = (-0.7 * size * x) as i32;
                    }
                    at += (6000f64.powf(draw())) as usize;
                }
                let (out, stats) = limited(&signal, true, rate);
                most = most.max(loudest(&out));
                held += stats.limited;
                let name = format!("{kind}, {over} dB over, {rate} Hz");
                assert_eq!(stats.clipped, 0, "{name}");
                assert!(loudest(&out) <= CEILING as u32, "{name}");
            }
        }
    }
    println!(
        "loudest {:.5} dBFS, ceiling {:.5} dBFS, {held} frames held",
        db(f64::from(most) / FULL),
        db(f64::from(CEILING) / FULL)
    );
    // Not by throwing level away: the worst peak is used to the full.
    assert!(db(f64::from(most) / f64::from(CEILING)) > -0.01);
}

#[test]
fn what_stays_below_the_ceiling_is_only_delayed_by_64_frames() {
    let mut random = Random::new(2, Stream::Population);
    let signal: Vec<Frame> = (0..96_000)
        .map(|_| {
            let mut word = || match random.bits() {
                bits if bits % 16 == 0 => CEILING,
                bits if bits % 16 == 1 => -CEILING,
                bits => (bits as i32) % (CEILING + 1),
            };
            Frame {
                left: word(),
                right: word(),
            }
        })
        .collect();
    for on in [true, false] {
        let (out, stats) = limited(&signal, on, RATE);
        assert!(out[..LOOK_AHEAD].iter().all(|frame| *frame == Frame::ZERO));
        assert_eq!(LOOK_AHEAD, 64);
        assert!(out[LOOK_AHEAD..] == signal[..signal.len() - LOOK_AHEAD]);
        assert_eq!((stats.limited, stats.clipped), (0, 0));
    }
}

/// How far a bed of −30 dBFS in the left ear is held down, dB by frame, while `loud` (full scale: 1) sounds in the
/// right one. Frames at which the bed is near a zero have none.
fn held_down(frames: usize, loud: impl Fn(usize) -> f64) -> Vec<Option<f64>> {
    let bed = dbfs(-30.0);
    let wave = sine(bed, 997.0, RATE);
    let signal = stereo(frames, |n| [wave(n), f64::from(CEILING) * loud(n)]);
    let (out, stats) = limited(&signal, true, RATE);
    assert_eq!(stats.clipped, 0);
    let gain = |(i, o): (f64, f64)| (i.abs() > 0.3 * bed).then(|| -db(o / i));
    left(&signal)
        .zip(left(&out[LOOK_AHEAD..]))
        .map(gain)
        .collect()
}

fn worst(down: &[Option<f64>]) -> f64 {
    down.iter().flatten().copied().fold(0.0, f64::max)
}

#[test]
fn a_drip_does_not_pump_the_bed_and_a_roar_lets_go_slowly() {
    let ms = |t: f64| (t * RATE / 1e3) as usize;
    // A bubble of 3 mm, 12 dB over the ceiling; it is below it after ln(4)/β.
    let (beta, pitch) = (100.4, 1094.4);
    let drip = |n: usize| {
        let t = n as f64 / RATE;
        4.0 * (-beta * t).exp() * (2.0 * PI * pitch * t).sin()
    };
    let below = (4f64.ln() / beta * RATE) as usize;
    let start = ms(200.0);
    let lone = held_down(ms(600.0), |n| n.checked_sub(start).map_or(0.0, drip));
    let figures = [0.0, 10.0, 20.0, 50.0, 100.0].map(|t| {
        let at = start + below + ms(t);
        worst(&lone[at..at + ms(1.0)])
    });
    println!("bed down 0, 10, 20, 50, 100 ms after a drip: {figures:.2?} dB");
    assert!((11.0..13.0).contains(&worst(&lone)), "it was no test");
    assert!(figures[3] < 1.0, "{:.2} dB at 50 ms", figures[3]);
    assert_eq!(worst(&lone[..start - LOOK_AHEAD]), 0.0);

    // Four drips a second hold it down no further.
    let every = ms(250.0);
    let train = held_down(ms(5000.0), |n| drip(n % every));
    let at = 19 * every + below + ms(50.0);
    let after = worst(&train[at..at + ms(1.0)]);
    println!("the same 50 ms after the 20th of four drips a second: {after:.2} dB");
    assert!(after < 1.0);

    // Three seconds of noise whose peaks are 12 dB over.
    let mut random = Random::new(3, Stream::Population);
    let noise: Vec<f64> = (0..ms(3000.0))
        .map(|_| 8.0 * f64::from(random.uniform()) - 4.0)
        .collect();
    let roar = held_down(ms(8000.0), |n| noise.get(n).copied().unwrap_or(0.0));
    let end = ms(3000.0);
    let at = |t: f64| worst(&roar[end + ms(t)..end + ms(t + 1.0)]);
    let figures = [0.0, 50.0, 200.0, 500.0, 1000.0, 2000.0].map(at);
    println!("bed down 0, 50, 200, 500, 1000, 2000 ms after a roar: {figures:.2?} dB");
    assert!(figures[1] > 4.0 && figures[1] > 5.0 * lone_at_50(&lone, start + below + ms(50.0)));
    assert!(figures.windows(2).all(|pair| pair[1] <= pair[0]));
    assert!(figures[4] < 1.0, "{:.2} dB after a second", figures[4]);
    // And then it is open again, to the bit.
    let open = roar.iter().rposition(|down| down.is_some_and(|d| d != 0.0));
    let open = (open.unwrap_or(0) - end) as f64 / RATE;
    println!("open again {open:.2} s after a roar");
    assert!(open < 4.5);
}

fn lone_at_50(lone: &[Option<f64>], at: usize) -> f64 {
    worst(&lone[at..at + (RATE / 1e3) as usize])
}

#[test]
fn an_offset_is_removed_and_a_low_tone_is_not() {
    let (mut most, mut lost) = (0.0f64, 0.0f64);
    for rate in [8_000.0, 48_000.0, 96_000.0, 192_000.0] {
        let seconds = |s: f64| (s * rate) as usize;
        let offset = mixed(
            &mono(seconds(3.5), |_| FULL / 2.0),
            Output::Bits24,
            0.0,
            rate,
        );
        let residual = rms(left(&offset[seconds(3.0)..])) / f64::from(1 << 23);
        let input = mono(seconds(6.0), sine(FULL / 4.0, 22.0, rate));
        let out = mixed(&input, Output::Bits24, 0.0, rate);
        // The last second holds 22 whole periods.
        let last = |frames: &[Frame]| {
            let part = &frames[seconds(5.0)..seconds(6.0)];
            line(left(part).collect::<Vec<_>>().into_iter(), 22.0, rate)
        };
        let loss = -db(last(&out) * 8.0 / last(&input));
        println!(
            "{rate:>6} Hz: an offset of -6 dBFS leaves {:.1} dBFS after 3 s; 22 Hz loses {loss:.3} dB",
            db(residual)
        );
        (most, lost) = (most.max(residual), lost.max(loss));
    }
    assert!(db(most) < -90.0, "{:.1} dBFS", db(most));
    assert!(lost < 0.2, "{lost:.3} dB");
}

/// Gain of the mix at `hertz`, dB.
fn gain(tone: f64, hertz: f64) -> f64 {
    let input = mono(96_000, sine(dbfs(-20.0), hertz, RATE));
    let out = mixed(&input, Output::Bits24, tone, RATE);
    let last = |frames: &[Frame]| {
        let part: Vec<f64> = left(&frames[48_000..96_000]).collect();
        line(part.into_iter(), hertz, RATE)
    };
    db(last(&out) * 8.0 / last(&input))
}

#[test]
fn the_tone_tilts_by_what_it_says() {
    let mut off = 0.0f64;
    for tone in [12.0, -12.0, 24.0, -24.0, 6.0] {
        let gains =
            [30.0, 100.0, 300.0, 1_000.0, 3_000.0, 10_000.0, 20_000.0].map(|f| gain(tone, f));
        let tilt = gains[5] - gains[1];
        println!(
            "tone {tone:+}: {gains:+.2?} dB at 30 Hz to 20 kHz, tilt from 100 Hz to 10 kHz {tilt:+.2} dB"
        );
        if tone.abs() <= 12.0 {
            off = off.max((tilt - tone).abs());
        }
    }
    assert!(off < 1.0, "{off:.3} dB");
}

/// What the DC blocker makes of `x`: it takes off the running mean of 4096 frames.
fn blocked(x: impl Iterator<Item = f64>) -> Vec<i64> {
    let mut sum = 0i64;
    let take_off = |x: f64| {
        let x = x as i64 - (sum >> 12);
        sum += x;
        x
    };
    x.map(take_off).collect()
}

/// The left ear's error at `output` for the signal `frames`, in last bits, with the exact value in bus units.
fn errors(frames: &[Frame], output: Output, tone: f64) -> Vec<(f64, i64)> {
    let bit = last_bit(output);
    let out = mixed(frames, output, tone, RATE);
    blocked(left(frames))
        .into_iter()
        .zip(left(&out[LOOK_AHEAD..]))
        .map(|(exact, out)| (out - exact as f64 / bit, exact))
        .collect()
}

/// Bus units of the last bit.
fn last_bit(output: Output) -> f64 {
    match output {
        Output::Raw => 1.0,
        Output::Bits16 => FULL / 32_768.0,
        Output::Bits24 => FULL / 8_388_608.0,
    }
}

#[test]
fn no_tone_is_transparent_to_the_bit() {
    // The dither may move a word by less than 1.5 bits and hides what is smaller; so the mean is taken too.
    let mut random = Random::new(4, Stream::Population);
    let noise: Vec<f64> = (0..1 << 19)
        .map(|_| dbfs(-6.0) * (f64::from(random.uniform()) - 0.5))
        .collect();
    let signal = mono(noise.len(), |n| noise[n]);
    let errors = errors(&signal, Output::Bits24, 0.0);
    let most = errors.iter().map(|e| e.0.abs()).fold(0.0, f64::max);
    println!("largest error {most:.3} bits of 24");
    assert!(most < 1.5);

    // One mix comes from a tone of 12 dB, the other was never anywhere but at 0: the same words.
    let run = |before: f64| {
        let settings = |tone| Settings::new(0.0, tone, true);
        let mut mix = Mix::new(Output::Bits24, 7, &settings(before), RATE);
        let mut blocks = 0;
        through(&signal, |block| {
            if blocks == 100 {
                mix.apply(&settings(0.0));
            }
            blocks += 1;
            mix.render(block, &mut Stats::default());
        })
    };
    let (one, other) = (run(12.0), run(0.0));
    let settled = 100 * BLOCK + GLIDE + LOOK_AHEAD;
    assert!(one[..settled] != other[..settled]);
    assert!(one[settled..] == other[settled..]);
}

#[test]
fn a_level_moves_along_a_line_over_1024_frames() {
    let settings = |level| Settings::new(level, 0.0, true);
    let steady = 1 << 24;
    let want = |level: f64| (f64::from(steady) * 10f64.powf(level / 20.0)).round();
    let mut mix = Mix::new(Output::Raw, 7, &settings(0.0), RATE);
    let mut last = f64::from(steady);
    let mut worst = 0.0f64;
    for level in [-80.0, 24.0, -80.0, 0.0, -6.0, -6.01, 12.0] {
        mix.apply(&settings(level));
        let signal = vec![
            Frame {
                left: steady,
                right: -steady
            };
            GLIDE
        ];
        let out = through(&signal, |block| mix.render(block, &mut Stats::default()));
        let change = want(level) - last;
        for (n, frame) in out.iter().enumerate() {
            let line = last + change * (n + 1) as f64 / GLIDE as f64;
            let off = f64::from(frame.left) - line;
            worst = worst.max(off.abs());
            // The right ear is rounded the same way: up, not away from zero.
            assert!((frame.left + frame.right).abs() <= 1);
        }
        assert!((f64::from(out[GLIDE - 1].left) - want(level)).abs() <= 1.0);
        last = f64::from(out[GLIDE - 1].left);
    }
    // Gains are whole 2^-24ths, and a step is at most 2^-16 of one off in 1024.
    println!("furthest from the line {worst:.2} bus units, the signal is {steady}");
    assert!(worst <= 2.5);
}

#[test]
fn the_dither_is_triangular_white_and_blind_to_the_signal() {
    const FRAMES: usize = 1 << 20;
    for output in [Output::Bits16, Output::Bits24] {
        let bit = last_bit(output);
        // A slow ramp up and down over 200 last bits, 20 times a second: above the DC blocker's corner.
        let ramp = |n: usize| {
            let turn = (n as f64 * 20.0 / RATE).fract();
            100.0 * bit * (4.0 * (turn - 0.5).abs() - 1.0)
        };
        let signal = stereo(FRAMES + LOOK_AHEAD, |n| [ramp(n), -0.3 * ramp(n)]);
        let all = errors(&signal, output, 0.0);
        let settled = &all[..FRAMES];
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let error: Vec<f64> = settled.iter().map(|e| e.0).collect();
        let (average, size) = (mean(&error), rms(error.iter().copied()));
        println!(
            "{output:?}: mean error {average:+.5} bits, rms {size:.5} bits (wanted 0 and 0.5)"
        );
        // Rounding on the bus's own grid leaves half a bus unit; the rest is 5 deviations of the estimate.
        let by_chance = 5.0 * 0.5 / (FRAMES as f64).sqrt();
        assert!(average.abs() < 0.5 / bit + by_chance);
        assert!((size / 0.25f64.sqrt() - 1.0).abs() < 0.02);

        // Wherever between two words the exact value lies, the error has the same moments.
        let parts = bit.min(16.0) as usize;
        let mut by_part = vec![Vec::new(); parts];
        for (error, exact) in settled {
            let part = (*exact as f64).rem_euclid(bit) / bit;
            by_part[(part * parts as f64) as usize].push(*error);
        }
        let moments: Vec<[f64; 2]> = by_part
            .iter()
            .map(|part| [mean(part), rms(part.iter().copied())])
            .collect();
        let spread = |i: usize| {
            let of = moments.iter().map(|m| m[i]);
            of.clone().fold(f64::MIN, f64::max) - of.fold(f64::MAX, f64::min)
        };
        let fewest = by_part.iter().map(Vec::len).min().unwrap_or(0) as f64;
        println!(
            "{output:?}: over {parts} parts of a bit the mean moves by {:.5} bits, the rms by {:.5} bits",
            spread(0),
            spread(1)
        );
        assert!(spread(0) < 10.0 * 0.5 / fewest.sqrt());
        assert!(spread(1) < 0.5 * 0.02);

        // White: every octave has the same density.
        const SEGMENT: usize = 1 << 14;
        let fft = RealFftPlanner::<f64>::new().plan_fft_forward(SEGMENT);
        let mut power = vec![0.0; SEGMENT / 2 + 1];
        let mut spectrum = fft.make_output_vec();
        for segment in error.chunks(SEGMENT) {
            fft.process(&mut segment.to_vec(), &mut spectrum)
                .expect("lengths fit");
            for (power, bin) in power.iter_mut().zip(&spectrum) {
                *power += bin.norm_sqr() / (FRAMES * SEGMENT) as f64;
            }
        }
        let octaves: Vec<f64> = (3..13)
            .map(|octave| mean(&power[1 << octave..2 << octave]))
            .map(|density| 10.0 * (density * SEGMENT as f64 / 0.25).log10())
            .collect();
        println!("{output:?}: octaves from 23 Hz to 24 kHz {octaves:+.2?} dB");
        assert!(octaves.iter().all(|db| db.abs() < 1.0));

        // The ears' errors have nothing to do with each other.
        let out = mixed(&signal, output, 0.0, RATE);
        let right = blocked(signal.iter().map(|frame| f64::from(frame.right)));
        let product: f64 = (0..FRAMES)
            .map(|n| error[n] * (f64::from(out[n + LOOK_AHEAD].right) - right[n] as f64 / bit))
            .sum();
        let correlation = (product / FRAMES as f64 - average * average) / 0.25;
        println!("{output:?}: correlation between the ears {correlation:+.5}");
        assert!(correlation.abs() < 0.01);
    }
}

#[test]
fn the_dither_stops_on_silence() {
    for output in [Output::Bits16, Output::Bits24] {
        let out = mixed(&[Frame::ZERO; 48_000], output, 0.0, RATE);
        assert_eq!(loudest(&out), 0, "from the first frame on");
        // A loud second that leaves an offset behind, then nothing.
        let signal = mono(5 * 48_000, |n| {
            if n < 48_000 {
                sine(FULL, 0.7, RATE)(n)
            } else {
                0.0
            }
        });
        let out = mixed(&signal, output, 0.0, RATE);
        let last = out
            .iter()
            .rposition(|frame| *frame != Frame::ZERO)
            .expect("there was a sound");
        let seconds = last as f64 / RATE - 1.0;
        println!("{output:?}: exact zero {seconds:.2} s after the sound");
        assert!(seconds < 2.0);
    }
}

#[test]
fn a_sine_of_minus_100_dbfs_survives_16_bits() {
    const FRAMES: usize = 1 << 16;
    const BIN: usize = 1365;
    let amplitude = dbfs(-100.0);
    let hertz = BIN as f64 * RATE / FRAMES as f64;
    let signal = mono(2 * FRAMES, sine(amplitude, hertz, RATE));
    let out = mixed(&signal, Output::Bits16, 0.0, RATE);
    let mut part: Vec<f64> = left(&out[FRAMES..2 * FRAMES]).collect();
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(FRAMES);
    let mut spectrum = fft.make_output_vec();
    fft.process(&mut part, &mut spectrum).expect("lengths fit");
    let size = |bin: usize| spectrum[bin].norm() * 2.0 / FRAMES as f64 / 32_768.0;
    let (line, first) = (db(size(BIN)), 10);
    let next = (first..FRAMES / 2).filter(|bin| *bin != BIN).map(size);
    let next = db(next.fold(0.0, f64::max));
    println!("the line at {hertz:.1} Hz is {line:.2} dBFS, the next one {next:.2} dBFS");
    assert!((line + 100.0).abs() < 1.0);
    assert!(next < -115.0);
}
