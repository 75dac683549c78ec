//! The coupled cloud against the figures of physics §3, and against itself. `-- --nocapture` prints what was measured.

use std::f64::consts::PI;

use faer::linalg::solvers::{Solve, SolveLstsq};
use faer::{Mat, Side};
use freshet_host::cloud::coupling::{Coupling, Kernel, Place};
use freshet_host::cloud::ensemble::{Ensemble, Event};
use freshet_host::cloud::forcing::{Cause, Pulse};
use freshet_host::cloud::modes::{checked_matrix, frequencies, least_eigenvalue, modes};
use freshet_host::cloud::reduced::Reduced;
use freshet_host::cloud::solver::{Choice, Method};
use freshet_host::cloud::step::Tone;
use freshet_host::cloud::synthetic::{Random, ball};

const RATE: f64 = 48_000.0;

fn method(choice: Option<Choice>, rate: f64) -> Method {
    Method {
        coupling: Coupling::default(),
        choice,
        rate,
    }
}

fn place(at: [f64; 3], radius: f64) -> Place {
    Place {
        at,
        radius,
        depth: 1.0,
    }
}

fn tones(places: &[Place]) -> Vec<Tone> {
    places.iter().map(|p| Tone::of_radius(p.radius)).collect()
}

/// Pitch in Hz and decay in 1/s of the `count` damped sines in a sound, by linear prediction over every `stride`th sample.
fn partials(sound: &[f64], rate: f64, count: usize, stride: usize) -> Vec<(f64, f64)> {
    let samples: Vec<f64> = sound.iter().copied().step_by(stride).collect();
    let order = 2 * count;
    let rows = samples.len() - order;
    let past = Mat::from_fn(rows, order, |i, j| samples[i + order - 1 - j]);
    let next = Mat::from_fn(rows, 1, |i, _| samples[i + order]);
    let weights = past.col_piv_qr().solve_lstsq(&next);
    let companion = Mat::from_fn(order, order, |i, j| match i {
        0 => weights[(j, 0)],
        _ if i == j + 1 => 1.0,
        _ => 0.0,
    });
    let step = stride as f64 / rate;
    let mut found: Vec<(f64, f64)> = companion
        .eigenvalues()
        .unwrap()
        .iter()
        .filter(|z| z.im > 0.0)
        .map(|z| (z.im.atan2(z.re) / step / (2.0 * PI), -z.norm().ln() / step))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// What is heard when the first of `bubbles` is struck, from when the pulse is over.
fn struck(method: Method, bubbles: &[(Place, Tone)], seconds: f64) -> Vec<f64> {
    let mut ensemble = Ensemble::new(method, false);
    let mut events: Vec<Event> = bubbles
        .iter()
        .enumerate()
        .map(|(key, &(place, tone))| Event::Birth { key, place, tone })
        .collect();
    events.push(Event::Strike {
        key: 0,
        time: 0.0,
        pulse: Pulse::new(Cause::Entrained, bubbles[0].0.radius, 0.6),
    });
    let mut sound = Vec::new();
    while (sound.len() as f64) < seconds * method.rate {
        ensemble.play(&events, &mut sound).unwrap();
        events.clear();
    }
    sound.split_off((0.002 * method.rate) as usize)
}

fn within(got: f64, wanted: f64, part: f64) {
    assert!((got / wanted - 1.0).abs() <= part, "{got} for {wanted}");
}

#[test]
fn pairs_sound_as_computed_by_hand() {
    for (what, frequency, wanted) in [
        ("Minnaert", None, [940.63, 989.32, 1044.35, 1088.92]),
        (
            "3.26/r",
            Some(3.26 / 3e-3),
            [933.95, 982.28, 1036.91, 1081.16],
        ),
    ] {
        for (apart, wanted) in [2.0, 4.0, 10.0, 100.0].into_iter().zip(wanted) {
            let tone = frequency.map_or(Tone::of_radius(3e-3), |f| Tone::of_frequency(3e-3, f));
            let pair = [0.0, apart * 3e-3].map(|x| (place([x, 0.0, 0.0], 3e-3), tone));
            for choice in [Choice::Dense, Choice::Reduced] {
                // What is out of phase cancels in the sound.
                let found = partials(&struck(method(Some(choice), RATE), &pair, 0.04), RATE, 1, 8);
                println!(
                    "3 + 3 mm at {apart} r, {what}, {choice:?}: {:.2} Hz for {wanted}",
                    found[0].0
                );
                within(found[0].0, wanted, 1e-3);
            }
        }
    }
    let pair = [(0.0, 3e-3), (12e-3, 2e-3)]
        .map(|(x, radius)| (place([x, 0.0, 0.0], radius), Tone::of_radius(radius)));
    for kernel in [Kernel::Cb, Kernel::Definite] {
        let mut method = method(None, RATE);
        method.coupling.kernel = kernel;
        let found = partials(&struck(method, &pair, 0.04), RATE, 2, 6);
        println!(
            "3 + 2 mm at 12 mm, {kernel:?}: {:.2} and {:.2} Hz",
            found[0].0, found[1].0
        );
        within(found[0].0, 1079.75, 1e-3);
        within(found[1].0, 1694.22, 1e-3);
    }
}

/// Equal bubbles on a cubic grid, those nearest to its middle.
fn grid(count: usize, spacing: f64, radius: f64) -> Vec<Place> {
    let mut points: Vec<[f64; 3]> = Vec::new();
    for x in -8..=8 {
        for y in -8..=8 {
            for z in -8..=8 {
                points.push([
                    f64::from(x) + 0.01,
                    f64::from(y) + 0.02,
                    f64::from(z) + 0.03,
                ]);
            }
        }
    }
    let square = |p: &[f64; 3]| p.iter().map(|x| x * x).sum::<f64>();
    points.sort_by(|a, b| square(a).total_cmp(&square(b)));
    points[..count]
        .iter()
        .map(|p| place(p.map(|x| x * spacing), radius))
        .collect()
}

#[test]
fn the_lowest_mode_falls_as_the_cloud_grows() {
    let counts = [10, 20, 50, 100, 200, 500, 1000];
    for (spacing, wanted) in [(3.0, -0.33), (10.0, -0.27), (20.0, -0.23)] {
        let mut points = Vec::new();
        for count in counts {
            let places = grid(count, spacing * 1e-3, 1e-3);
            let mass = Coupling::default().matrix(&places);
            let lowest = frequencies(&mass, &tones(&places)).unwrap()[0];
            points.push(((count as f64).ln(), lowest.ln()));
        }
        let slope = slope(&points);
        println!("lowest mode of 10 to 1000 bubbles at {spacing} r: N^{slope:.3}");
        assert!((slope - wanted).abs() <= 0.02, "{slope} for {wanted}");
    }
}

fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let xy: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let xx: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    xy / xx
}

/// A cloud of any kind: apart, overlapping or in one point, 0.15 to 10 mm.
fn any_cloud(random: &mut Random) -> Vec<Place> {
    let count = 2 + (random.bits() % 31) as usize;
    let size = [0.0, 1e-6, 1e-3, 10e-3, 100e-3][(random.bits() % 5) as usize];
    (0..count)
        .map(|_| {
            let at = random.in_ball().map(|x| x * size);
            place(at, 0.15e-3 * (10e-3f64 / 0.15e-3).powf(random.unit()))
        })
        .collect()
}

#[test]
fn ten_thousand_clouds_are_definite_and_none_gains_energy() {
    let mut random = Random::new(1);
    let mut closest = f64::INFINITY;
    let mut growth = f64::NEG_INFINITY;
    for cloud in 0..10_000 {
        let places = any_cloud(&mut random);
        let epsilon = [1.001, 1.1, 1.5, 2.0, 2.0 * 2f64.sqrt(), 10.0][cloud % 6];
        let coupling = Coupling {
            epsilon,
            ..Coupling::default()
        };
        let mass = coupling.matrix(&places);
        let over = least_eigenvalue(&mass) - (1.0 - 1.0 / epsilon);
        closest = closest.min(over);
        assert!(over > -1e-12, "cloud {cloud}: {over}");
        let rate = [8_000.0, 48_000.0, 192_000.0][cloud / 12 % 3];
        // What is too high for the rate takes no part.
        let audible = |place: &Place| Tone::of_radius(place.radius).omega0 < 0.45 * 2.0 * PI * rate;
        let places: Vec<Place> = places.into_iter().filter(audible).collect();
        if places.is_empty() {
            continue;
        }
        let choice = [Choice::Dense, Choice::Reduced][cloud / 6 % 2];
        let mass = match choice {
            Choice::Reduced => Reduced::matrix(&coupling, &places).unwrap(),
            Choice::Dense => coupling.matrix(&places),
        };
        let method = Method {
            coupling,
            choice: Some(choice),
            rate,
        };
        let mut ensemble = Ensemble::new(method, false).with_span(8);
        let events: Vec<Event> = places
            .iter()
            .enumerate()
            .map(|(key, &place)| Event::Birth {
                key,
                place,
                tone: Tone::of_radius(place.radius),
            })
            .collect();
        let mut sound = Vec::new();
        ensemble.play(&events, &mut sound).unwrap();
        for key in 0..places.len() {
            ensemble.displace(key, random.between(-1.0, 1.0));
        }
        ensemble.play(&[], &mut sound).unwrap();
        let energy = |ensemble: &Ensemble| ensemble.energy(|i, j| mass[(i, j)]);
        let mut before = energy(&ensemble);
        assert!(before >= 0.0);
        for _ in 0..12 {
            ensemble.play(&[], &mut sound).unwrap();
            let now = energy(&ensemble);
            if before > 1e-12 {
                growth = growth.max(now / before - 1.0);
                assert!(
                    now <= before * (1.0 + 1e-9),
                    "cloud {cloud}: {before} to {now}"
                );
            }
            before = now;
        }
    }
    println!(
        "10 000 clouds: least eigenvalue over 1 − 1/ε by at least {closest:.1e}; energy grew by at most {growth:.1e}"
    );
}

#[test]
fn an_indefinite_matrix_is_refused_with_a_reason() {
    let coupling = Coupling {
        kernel: Kernel::Cb,
        ..Coupling::default()
    };
    let mut random = Random::new(1);
    let (mut refused, mut least) = (0, f64::INFINITY);
    for _ in 0..300 {
        // Anywhere, also inside each other, as in physics §3: kept apart, only a third is indefinite.
        let places: Vec<Place> = (0..64)
            .map(|_| {
                let at = random.in_ball().map(|x| x * 10e-3);
                place(at, 0.2e-3 * 50f64.powf(random.unit()))
            })
            .collect();
        least = least.min(least_eigenvalue(&Coupling::default().matrix(&places)));
        match checked_matrix(&coupling, &places) {
            Ok(_) => {}
            Err(error) => {
                let text = error.to_string();
                assert!(
                    text.contains("not positive definite") && text.contains("--kernel definite")
                );
                refused += 1;
                if refused < 4 {
                    let mut ensemble = Ensemble::new(
                        Method {
                            coupling,
                            choice: None,
                            rate: RATE,
                        },
                        false,
                    );
                    let events: Vec<Event> = (0..64)
                        .map(|key| Event::Birth {
                            key,
                            place: places[key],
                            tone: Tone::of_radius(places[key].radius),
                        })
                        .collect();
                    let error = ensemble.play(&events, &mut Vec::new()).unwrap_err();
                    assert!(error.to_string().contains("--kernel definite"), "{error}");
                }
            }
        }
    }
    println!(
        "64 bubbles of 0.2 to 10 mm in 10 mm: CB's kernel refused for {refused} of 300 clouds, least eigenvalue of the \
         definite one {least:.3}"
    );
    assert!(refused > 250 && least >= 0.5 - 1e-12);
}

#[test]
fn reduced_pitches_are_near_the_dense_ones() {
    let coupling = Coupling::default();
    let mut all = Vec::new();
    for count in [64, 128, 256, 512] {
        let mut errors = Vec::new();
        for size in [0.03, 0.04, 0.055, 0.08] {
            // 512 bubbles up to 3 mm find no room apart in 30 mm.
            if count == 512 && size < 0.04 {
                continue;
            }
            for seed in 0..3 {
                let places = ball(count, size, 0.5e-3, 3e-3, 100 * seed + count as u64);
                let tones = tones(&places);
                let dense = frequencies(&coupling.matrix(&places), &tones).unwrap();
                let reduced = Reduced::matrix(&coupling, &places).unwrap();
                assert!(least_eigenvalue(&reduced) > 0.5);
                let reduced = frequencies(&reduced, &tones).unwrap();
                errors.extend(dense.iter().zip(&reduced).map(|(a, b)| (b / a - 1.0).abs()));
            }
        }
        report(&format!("{count} bubbles"), &mut errors);
        all.extend(errors);
    }
    let (mean, most, worst) = report("all", &mut all);
    assert!(mean <= 0.003 && most <= 0.0125 && worst <= 0.04);
}

fn report(what: &str, errors: &mut [f64]) -> (f64, f64, f64) {
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let most = errors[errors.len() * 95 / 100];
    let worst = errors[errors.len() - 1];
    println!(
        "reduced against dense, {what}: mean {:.3} %, 95 % within {:.3} %, worst {:.3} %",
        100.0 * mean,
        100.0 * most,
        100.0 * worst
    );
    (mean, most, worst)
}

#[test]
fn a_step_has_the_pitch_and_decay_of_the_continuous_cloud() {
    for rate in [44_100.0, 48_000.0, 96_000.0] {
        let method = method(None, rate);
        let (mut pitch, mut decay) = (Vec::new(), Vec::new());
        for seed in 0..6 {
            let places = ball(32, 0.03, 0.5e-3, 3e-3, seed);
            let tones = tones(&places);
            let n = places.len();
            let mass = method.coupling.matrix(&places);
            let steps: Vec<_> = tones.iter().map(|tone| method.step(tone)).collect();
            let block = |inverse: &Mat<f64>,
                         c: &dyn Fn(usize) -> f64,
                         k: &dyn Fn(usize) -> f64,
                         discrete: f64| {
                // (y, v) after a step, or their derivatives.
                Mat::from_fn(2 * n, 2 * n, |i, j| {
                    let (row, column) = (i % n, j % n);
                    let weight = if j < n { k(column) } else { c(column) };
                    let force = -inverse[(row, column)] * weight;
                    let one = if row == column { 1.0 } else { 0.0 };
                    match (i < n, j < n) {
                        (true, true) => discrete * (one + force),
                        (true, false) => one + discrete * force,
                        (false, true) => force,
                        (false, false) => force + discrete * one,
                    }
                })
            };
            let invert = |m: &Mat<f64>| {
                m.llt(Side::Lower)
                    .unwrap()
                    .solve(Mat::<f64>::identity(n, n))
            };
            let continuous = block(
                &invert(&mass),
                &|i| 2.0 * tones[i].beta,
                &|i| tones[i].omega0.powi(2),
                0.0,
            );
            let whole = Mat::from_fn(n, n, |i, j| {
                mass[(i, j)] + if i == j { steps[i].extra } else { 0.0 }
            });
            let stepped = block(&invert(&whole), &|i| steps[i].c, &|i| steps[i].k, 1.0);
            let mut wanted: Vec<(f64, f64)> = continuous
                .eigenvalues()
                .unwrap()
                .iter()
                .filter(|s| s.im > 0.0)
                .map(|s| (s.im, -s.re))
                .collect();
            let mut got: Vec<(f64, f64)> = stepped
                .eigenvalues()
                .unwrap()
                .iter()
                .filter(|z| z.im > 0.0)
                .map(|z| (z.im.atan2(z.re) * rate, -z.norm().ln() * rate))
                .collect();
            wanted.sort_by(|a, b| a.0.total_cmp(&b.0));
            got.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(wanted.len(), got.len());
            for (wanted, got) in wanted.iter().zip(&got) {
                pitch.push((got.0 / wanted.0 - 1.0).abs());
                decay.push((got.1 / wanted.1 - 1.0).abs());
            }
        }
        let mean = |x: &[f64]| 100.0 * x.iter().sum::<f64>() / x.len() as f64;
        let most = |x: &[f64]| 100.0 * x.iter().copied().fold(0.0, f64::max);
        println!(
            "32 coupled bubbles at {rate} Hz: pitch off by {:.4} % (worst {:.4} %), decay by {:.3} % (worst {:.3} %)",
            mean(&pitch),
            most(&pitch),
            mean(&decay),
            most(&decay)
        );
        assert!(most(&pitch) < 0.1);
    }
}

#[test]
fn modes_of_a_pair_have_its_pitches_decays_and_signs() {
    let places = [0.0, 6e-3].map(|x| place([x, 0.0, 0.0], 3e-3));
    let found = modes(
        &Coupling::default().matrix(&places),
        &[3e-3; 2],
        &tones(&places),
    )
    .unwrap();
    within(found[0].hertz, 940.63, 1e-4);
    assert!((found[0].pulsation[0] - found[0].pulsation[1]).abs() < 1e-9);
    assert!((found[1].pulsation[0] + found[1].pulsation[1]).abs() < 1e-9);
    within(
        found[1].hertz / found[0].hertz,
        ((1.0 + 8f64.sqrt().recip()) / (1.0 - 8f64.sqrt().recip())).sqrt(),
        1e-3,
    );
}
