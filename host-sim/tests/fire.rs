//! Fire's turbulence and vortex sound against exact cases. `-- --nocapture` prints what was measured.

use std::f64::consts::{PI, TAU};

use std::sync::atomic::{AtomicBool, Ordering};

use freshet::texture::{Samples, Texture, TextureError};
use freshet_host::bake::{Request, bake};
use freshet_host::cloud::synthetic::Random;
use freshet_host::fire::baking::{Kept, loops, rows};
use freshet_host::fire::fire_file::Fire;
use freshet_host::fire::flow::{Flow, Forces};
use freshet_host::fire::grid::{Ends, Grid};
use freshet_host::fire::inflow::Inflow;
use freshet_host::fire::row::{Plan, TAPER};
use freshet_host::fire::sound::{centroid, correlation};
use freshet_host::fire::texture;
use freshet_host::fire::vortex_sound::{Band, Moments, Volume, pressure, third_derivative, toward};
use freshet_host::fire::vorticity::vorticity;

/// Root of the mean square.
fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

#[test]
fn projection_leaves_no_divergence() {
    for ends in [Ends::Open, Ends::Periodic] {
        let grid = Grid {
            cells: [12, 10, 15],
            h: 0.01,
            ends,
        };
        let mut flow = Flow::new(grid, Forces::default());
        let mut random = Random::new(7);
        for v in flow.velocity.iter_mut().flatten() {
            *v = random.between(-1.0, 1.0);
        }
        flow.start();
        let left = flow.relative_divergence();
        println!("{ends:?}: relative divergence {left:.1e}");
        assert!(left < 1e-12);
    }
}

#[test]
fn taylor_green_vortices_decay_as_theory_says() {
    // u = sin x·cos y, v = −cos x·sin y: carried nowhere, its energy decays as e^{−4νk²t} exactly.
    for plane in [[0, 1], [0, 2], [1, 2]] {
        let n = 32;
        let grid = Grid {
            cells: [n; 3],
            h: TAU / n as f64,
            ends: Ends::Periodic,
        };
        let viscosity = 0.02;
        let mut flow = Flow::new(
            grid,
            Forces {
                viscosity,
                ..Forces::default()
            },
        );
        let [a, b] = plane;
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    let at = grid.at(i, j, k);
                    let place = |c: usize| Grid::place(c, i, j, k).map(|x| x * grid.h);
                    let (p, q) = (place(a), place(b));
                    flow.velocity[a][at] = p[a].sin() * p[b].cos();
                    flow.velocity[b][at] = -q[a].cos() * q[b].sin();
                }
            }
        }
        flow.start();
        let first = flow.energy(0.0);
        let (dt, steps) = (0.4 * grid.h, 128);
        for _ in 0..steps {
            flow.step(dt, None);
        }
        let rate = -(flow.energy(0.0) / first).ln() / (f64::from(steps) * dt);
        let theory = 4.0 * viscosity;
        let off = rate / theory - 1.0;
        println!(
            "plane {plane:?}: energy decays at {rate:.5} 1/s, theory {theory:.5} ({:+.2} %), to {:.2} of it",
            100.0 * off,
            flow.energy(0.0) / first
        );
        assert!(off.abs() < 0.02);
        assert!(flow.relative_divergence() < 1e-6);
    }
}

/// A bounded sum of sines with known derivatives.
fn tones(dt: f64, count: usize, hertz: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let at = |i: usize, gain: fn(f64, f64) -> f64| {
        let t = i as f64 * dt;
        hertz.iter().map(|f| gain(TAU * f, t)).sum::<f64>()
    };
    let plain = (0..count).map(|i| at(i, |w, t| (w * t).sin() / w.powi(2)));
    let third = (0..count).map(|i| at(i, |w, t| -w * (w * t).cos()));
    (plain.collect(), third.collect())
}

#[test]
fn third_derivative_is_exact_in_its_band_and_not_drowned_by_noise() {
    let (dt, count, stride, margin) = (1.0 / 3000.0, 6000, 3, 600);
    let band = Band {
        from: 0.0,
        pass: 200.0,
        stop: 300.0,
    };
    let (clean, exact) = tones(dt, count, &[31.0, 77.0, 150.0, 190.0]);
    let inside = 2 * margin..count - 2 * margin;
    let error = |record: &[f64]| {
        let record: Vec<[f64; 4]> = record.iter().map(|x| [*x, 0.0, 0.0, 0.0]).collect();
        let found = third_derivative(&record, 0.0, dt, margin, band, stride);
        assert_eq!(found.len(), count / stride);
        let pairs = inside.clone().step_by(stride);
        let (a, b): (Vec<f64>, Vec<f64>) = pairs
            .map(|i| (found[i / stride] - exact[i], exact[i]))
            .unzip();
        rms(&a) / rms(&b)
    };
    let bare = error(&clean);
    // A grid's graininess: noise 50 dB below the record, as wide as the record is.
    let mut random = Random::new(3);
    let size = 3e-3 * rms(&clean);
    let noisy: Vec<f64> = clean
        .iter()
        .map(|x| x + size * random.between(-1.7, 1.7))
        .collect();
    let filtered = error(&noisy);
    let differences: Vec<f64> = inside
        .clone()
        .map(|i| {
            let d = noisy[i + 2] - 2.0 * noisy[i + 1] + 2.0 * noisy[i - 1] - noisy[i - 2];
            d / (2.0 * dt.powi(3)) - exact[i]
        })
        .collect();
    let plain = rms(&differences) / rms(&exact[inside.clone()]);
    println!(
        "third derivative: {bare:.1e} off, with noise at −50 dB {filtered:.3}; plain differences {plain:.1}"
    );
    assert!(bare < 1e-4);
    assert!(filtered < 0.1);
    assert!(plain > 20.0 * filtered);
}

/// Two coaxial rings that rise and play leapfrog, in closed form: radius and height of each, m.
fn leapfrog(t: f64, omega: f64) -> [[f64; 2]; 2] {
    let (sin, cos) = (omega * t).sin_cos();
    let lift = 0.01 * t * omega / TAU;
    [
        [0.05 + 0.008 * cos, 0.012 * sin + lift],
        [0.05 - 0.008 * cos, -0.012 * sin + lift],
    ]
}

/// Vorticity of the rings on a grid, each spread by a Gaussian of `core` metres; how strong it would be without a grid.
fn rings(grid: &Grid, rings: &[[f64; 2]], gamma: f64, core: f64, omega: &mut [Vec<f64>; 3]) {
    let [nx, ny, nz] = grid.cells;
    let mut at = 0;
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let middle = |i: usize, n: usize| (i as f64 + 0.5 - n as f64 / 2.0) * grid.h;
                let (x, y, z) = (middle(i, nx), middle(j, ny), middle(k, nz));
                let r = x.hypot(y);
                let mut size = 0.0;
                for [radius, height] in rings {
                    let off = (r - radius).powi(2) + (z - height).powi(2);
                    size += gamma / (TAU * core * core) * (-off / (2.0 * core * core)).exp();
                }
                omega[0][at] = -size * y / r;
                omega[1][at] = size * x / r;
                omega[2][at] = 0.0;
                at += 1;
            }
        }
    }
}

/// What is heard of the rings at `directions`, from a grid of `n` cells across, and the exact pressure.
fn ring_sound(n: usize, directions: &[f64]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let grid = Grid {
        cells: [n; 3],
        h: 0.2 / n as f64,
        ends: Ends::Open,
    };
    let volume = Volume::new(&grid, [0.1; 3]);
    let (gamma, core, omega) = (0.3, 0.005, TAU * 25.0);
    let (dt, count, margin) = (1.0 / 600.0, 240, 48);
    let band = Band {
        from: 0.0,
        pass: 180.0,
        stop: 290.0,
    };
    let mut field = [(); 3].map(|()| vec![0.0; n * n * n]);
    let start = -0.5 * dt * count as f64;
    let time = |i: usize| start + i as f64 * dt;
    let moments: Vec<Moments> = (0..count)
        .map(|i| {
            rings(&grid, &leapfrog(time(i), omega), gamma, core, &mut field);
            volume.moments(&field)
        })
        .collect();
    let inside = 2 * margin..count - 2 * margin;
    let heard = directions.iter().map(|theta| {
        let way = [theta.sin(), 0.0, theta.cos()];
        let record: Vec<[f64; 4]> = moments.iter().map(|m| toward(m, way)).collect();
        let third = third_derivative(&record, 0.0, dt, margin, band, 1);
        inside.clone().map(|i| pressure(third[i])).collect()
    });
    // p = ρ/(4c²r)·(cos²θ − 1/3)·d³/dt³ ΣΓR²Z: the sum is 4Γ·R₀·a·b·(sin 2ωt)/2 + lift·(2R₀² + 2a²cos²ωt).
    let exact = directions.iter().map(|theta| {
        let gain = 1.2 / (4.0 * 343.0_f64.powi(2)) * (theta.cos().powi(2) - 1.0 / 3.0) * gamma;
        let sum = |t: f64| -> f64 { leapfrog(t, omega).iter().map(|[r, z]| r * r * z).sum() };
        // Far finer than the motion: eighth-order differences are exact to many digits.
        let d = 2e-4;
        let third = |t: f64| {
            let w = [
                (1.0, -488.0 / 240.0),
                (2.0, 338.0 / 240.0),
                (3.0, -72.0 / 240.0),
                (4.0, 7.0 / 240.0),
            ];
            w.iter()
                .map(|(n, w)| w * (sum(t + n * d) - sum(t - n * d)))
                .sum::<f64>()
                / d.powi(3)
        };
        inside.clone().map(|i| gain * third(time(i))).collect()
    });
    (heard.collect(), exact.collect())
}

#[test]
fn vortex_rings_sound_as_in_theory() {
    let directions = [0.0, 0.4, 0.8, PI / 2.0];
    let mut last = f64::INFINITY;
    for n in [24, 28, 32, 40] {
        let (heard, exact) = ring_sound(n, &directions);
        let worst = heard.iter().zip(&exact).map(|(heard, exact)| {
            let off: Vec<f64> = heard.iter().zip(exact).map(|(a, b)| a - b).collect();
            rms(&off) / rms(exact)
        });
        let worst = worst.fold(0.0, f64::max);
        // Directivity: as cos²θ − 1/3, and nothing at the magic angle.
        let axis = rms(&heard[0]);
        let off = directions.iter().zip(&heard).map(|(theta, heard)| {
            (rms(heard) / axis - (theta.cos().powi(2) - 1.0 / 3.0).abs() * 1.5).abs()
        });
        let off = off.fold(0.0, f64::max);
        println!("{n} cells: waveform {worst:.5} off, directivity {off:.5}");
        assert!(worst < last * 1.01 || worst < 0.005);
        last = worst;
        assert!(off < 0.05);
        if n >= 32 {
            assert!(worst < 0.05);
        }
    }
    assert!(last < 0.01);
}

#[test]
fn the_source_has_no_trace() {
    // y·(y × ω) = 0: the mean over receivers all around, which VS takes, is silence whatever the flow.
    let grid = small().grid();
    let mut random = Random::new(2);
    let cells = grid.layer() * grid.cells[2];
    let omega = [(); 3].map(|()| (0..cells).map(|_| random.between(-1.0, 1.0)).collect());
    for [xx, yy, zz, ..] in Volume::new(&grid, TAPER).moments(&omega) {
        assert!((xx + yy + zz).abs() < 1e-12 * (xx.abs() + yy.abs() + zz.abs()));
    }
}

#[test]
fn a_uniform_flow_and_still_air_are_silent() {
    let grid = Grid {
        cells: [12, 12, 16],
        h: 0.01,
        ends: Ends::Open,
    };
    let volume = Volume::new(&grid, [0.25, 0.25, 0.3]);
    for speed in [0.0, 3.0] {
        let inflow = Inflow::new(grid, speed, 0.0, 0.04, 1);
        let mut flow = Flow::new(
            grid,
            Forces {
                confinement: 0.5,
                viscosity: 1e-4,
            },
        );
        inflow.fill_box(&mut flow.velocity, 0.0);
        flow.start();
        for n in 1..20 {
            flow.step(1e-3, Some((&inflow, f64::from(n) * 1e-3)));
            let moment = volume.moments(&flow.omega);
            assert!(
                moment.iter().flatten().all(|x| x.abs() < 1e-18),
                "{moment:?}"
            );
        }
    }
}

/// A fire that is baked in seconds.
const SMALL: &str = r#"
title = "small"
[turbulence]
width = 0.1
cells = [12, 12, 18]
perturbation = 0.3
eddy = 0.05
confinement = 0.1
viscosity = 1.2e-4
[texture]
speeds = [1, 2, 4]
receivers = [[0, 0, 1], [1.414, 0, 1], [0.518, 1.316, 1]]
seconds = 3
bits = 8
seed = 1
"#;

fn small() -> Fire {
    Fire::parse("small.toml", SMALL).unwrap()
}

#[test]
fn eddies_that_are_only_carried_through_are_hardly_heard() {
    // Frozen eddies have no sound. What is heard of them is the window's and the grid's.
    let fire = small();
    let (grid, speed) = (fire.grid(), 2.0);
    let plan = Plan::new(&fire, speed);
    let inflow = Inflow::new(grid, speed, fire.perturbation, fire.eddy, 1);
    let volume = Volume::new(&grid, TAPER);
    let forces = Forces {
        confinement: fire.confinement * speed,
        viscosity: fire.viscosity,
    };
    let [mut frozen, mut live] = [(); 2].map(|()| Flow::new(grid, forces));
    inflow.fill_box(&mut live.velocity, 0.0);
    live.start();
    let [mut carried, mut alive] = [vec![], vec![]];
    for n in 0..1200 {
        let t = f64::from(n) * plan.dt;
        inflow.fill_box(&mut frozen.velocity, t);
        vorticity(&grid, &frozen.velocity, &mut frozen.omega);
        carried.push(toward(&volume.moments(&frozen.omega), [1.0, 0.0, 1.0]));
        live.step(plan.dt, Some((&inflow, t + plan.dt)));
        alive.push(toward(&volume.moments(&live.omega), [1.0, 0.0, 1.0]));
    }
    // As the flow sees it, and as one would who stands beside it.
    let heard = |record: &[[f64; 4]], speed: f64| {
        let sound = third_derivative(record, speed, plan.dt, 60, plan.band, 3);
        rms(&sound[80..320])
    };
    let [carried, alive, beside] = [
        heard(&carried, speed),
        heard(&alive, speed),
        heard(&alive, 0.0),
    ];
    println!(
        "carried eddies {:.1} dB re the live flow's sound; a plain derivative {:+.1} dB",
        20.0 * (carried / alive).log10(),
        20.0 * (beside / alive).log10()
    );
    assert!(carried < 0.4 * alive);
    assert!(beside > 4.0 * alive);
}

/// Energy of what changes from one spectrum to the next, over that of both (a hop of half a window).
fn flux(sound: &[f64], at: usize, size: usize) -> f64 {
    let spectrum = |start: usize| -> Vec<f64> {
        let n = sound.len();
        let hann = |i: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / size as f64).cos();
        let window: Vec<f64> = (0..size)
            .map(|i| hann(i) * sound[(start + i) % n])
            .collect();
        let bin = |k: usize| {
            let turn = |i: usize| TAU * (k * i) as f64 / size as f64;
            let of = |f: fn(f64) -> f64| -> f64 {
                window.iter().enumerate().map(|(i, x)| x * f(turn(i))).sum()
            };
            of(f64::cos).hypot(of(f64::sin))
        };
        (0..=size / 2).map(bin).collect()
    };
    let n = sound.len();
    let (before, after) = (spectrum(at + n - size * 3 / 4), spectrum(at + n - size / 4));
    let change: f64 = before
        .iter()
        .zip(&after)
        .map(|(a, b)| (a - b) * (a - b))
        .sum();
    change / (before.iter().chain(&after).map(|x| x * x).sum::<f64>() + 1e-300)
}

#[test]
fn rows_rise_with_speed_close_without_a_click_and_go_on_when_interrupted() {
    let fire = small();
    let folder = tempfile::tempdir().unwrap();
    let keep = |name: &str| Kept::beside(&folder.path().join(name), &fire).unwrap();
    let never = AtomicBool::new(false);
    let (whole, resumed) = rows(&fire, &keep("whole"), &never).unwrap();
    assert!(!resumed);
    for (row, speed) in whole.iter().zip(&fire.speeds) {
        let (progress, plan) = (&row.progress, row.plan);
        println!(
            "{speed} m/s: {} samples, steady after {:?} flow-throughs, energy in the second half {:.3} of the first, divergence {:.1e}",
            plan.samples,
            row.settled_after(),
            row.drift(),
            progress.divergence
        );
        assert!(row.settled_after().is_some());
        assert!((row.drift() - 1.0).abs() < 0.15);
        assert!(progress.divergence < 1e-6);
    }
    let found = loops(&fire, &whole);

    // Louder and brighter with speed.
    let mut last = (0.0, 0.0);
    for row in &found {
        let rate = row.sounds[0].len() as f64 / fire.seconds;
        let level = rms(&row.sounds.concat());
        let middle = centroid(&row.sounds, rate);
        println!(
            "{} m/s: rms {level:.2e} Pa at 1 m, centroid {middle:.1} Hz",
            row.speed
        );
        assert!(level > last.0 && middle > last.1);
        last = (level, middle);
    }

    // Where the loop closes it is as anywhere else.
    for sound in found.iter().flat_map(|row| &row.sounds) {
        let n = sound.len();
        let slopes: Vec<f64> = (0..n).map(|i| sound[(i + 1) % n] - sound[i]).collect();
        let (seam, inside) = slopes.split_last().unwrap();
        let steepest = inside.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        assert!(seam.abs() <= steepest, "{} of {steepest}", seam.abs());
        let size = 24;
        let most = (0..n - size).step_by(size / 4);
        let most = most
            .map(|i| flux(sound, i + size, size))
            .fold(0.0, f64::max);
        assert!(flux(sound, 0, size) <= most);
    }

    // Variants, and one variant at other times, know nothing of each other. A correlation of noise of bandwidth B over a
    // time T has a deviation of 1/√(2BT).
    for row in &found {
        let band = Plan::new(&fire, row.speed).band;
        let sigma = (2.0 * 0.3 * band.stop * fire.seconds).sqrt().recip();
        let mut worst = 0.0_f64;
        for (a, sound) in row.sounds.iter().enumerate() {
            for other in &row.sounds[..a] {
                let together = correlation(sound, other);
                print!("{together:+.2} ");
                worst = worst.max(together.abs());
            }
            let half = sound.len() / 3;
            let later: Vec<f64> = (0..sound.len())
                .map(|i| sound[(i + half) % sound.len()])
                .collect();
            worst = worst.max(correlation(sound, &later).abs());
        }
        println!(
            "{} m/s: correlation at most {worst:.2} (one σ of noise: {sigma:.2})",
            row.speed
        );
        assert!(worst < 0.2 + 3.0 * sigma);
    }

    // Size and error.
    let bytes = texture::write(&found, fire.seconds, fire.bits).unwrap();
    let noise = texture::quantisation_db(&found, &bytes).unwrap();
    let fine = texture::write(&found, fire.seconds, 16).unwrap();
    let less = texture::quantisation_db(&found, &fine).unwrap();
    println!(
        "8 bits: {} bytes, noise {noise:.1} dB; 16 bits: {} bytes, {less:.1} dB",
        bytes.len(),
        fine.len()
    );
    assert!(noise < -33.0 && less < -81.0);

    // Stopped after a while, twice, then gone on with: the same bytes.
    let kept = keep("interrupted");
    for share in [5, 2] {
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let (stop, kept, fire) = (&stop, &kept, &fire);
            let baking = scope.spawn(move || rows(fire, kept, stop).unwrap());
            std::thread::sleep(std::time::Duration::from_millis(1500 / share));
            stop.store(true, Ordering::Relaxed);
            let (rows, _) = baking.join().unwrap();
            assert!(rows.iter().any(|row| !row.is_done()));
        });
    }
    let (again, resumed) = rows(&fire, &kept, &never).unwrap();
    assert!(resumed);
    let again = texture::write(&loops(&fire, &again), fire.seconds, fire.bits).unwrap();
    assert!(again == bytes);

    // Damaged or foreign, what is kept is left alone.
    let kept = folder.path().join("whole.rows/row-0");
    std::fs::write(kept, b"nothing").unwrap();
    let stop = AtomicBool::new(true);
    let (left, resumed) = rows(&fire, &keep("whole"), &stop).unwrap();
    assert!(resumed && !left[0].is_done() && left[2].is_done());
}

#[test]
fn the_core_reads_what_was_written_and_refuses_the_rest() {
    let mut random = Random::new(5);
    let mut noise = |n: usize| -> Vec<f64> { (0..n).map(|_| random.between(-3.0, 3.0)).collect() };
    let rows = [
        texture::Loops {
            speed: 0.5,
            sounds: vec![noise(37), noise(37)],
        },
        texture::Loops {
            speed: 2.0,
            sounds: vec![noise(101), noise(101)],
        },
        texture::Loops {
            speed: 3.0,
            sounds: vec![vec![0.0; 5], vec![0.0; 5]],
        },
    ];
    for bits in [8, 16] {
        let bytes = texture::write(&rows, 4.0, bits).unwrap();
        // More may follow, and it need not be aligned.
        let mut padded = vec![9];
        padded.extend(&bytes);
        padded.extend([1, 2, 3]);
        let texture = Texture::open(&padded[1..]).unwrap();
        assert_eq!(
            (texture.rows(), texture.variants(), texture.seconds()),
            (3, 2, 4.0)
        );
        assert!(texture.row(3).is_none());
        for (i, row) in rows.iter().enumerate() {
            let read = texture.row(i).unwrap();
            assert_eq!(f64::from(read.speed), row.speed);
            assert!(read.variant(2).is_none());
            for (variant, sound) in row.sounds.iter().enumerate() {
                let samples = read.variant(variant).unwrap();
                assert_eq!(matches!(samples, Samples::Bytes(_)), bits == 8);
                assert_eq!((samples.len(), read.len()), (sound.len(), sound.len()));
                for (at, x) in sound.iter().enumerate() {
                    let off = f64::from(samples.get(at).unwrap()) * f64::from(read.scale) - x;
                    assert!(off.abs() <= 0.5001 * f64::from(read.scale));
                }
                assert_eq!(samples.get(sound.len()), None);
            }
        }
        // Cut anywhere, or any byte changed.
        for end in 0..bytes.len() {
            assert!(Texture::open(&bytes[..end]).is_err());
        }
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 1 << (at % 8);
            assert!(Texture::open(&wrong).is_err());
        }
        // Wrong numbers under a right checksum: refused, or at least never a panic.
        for _ in 0..20_000 {
            let mut wrong = bytes.clone();
            for _ in 0..=random.bits() % 3 {
                let at = 4 + random.bits() as usize % 68;
                wrong[at] = random.bits() as u8;
            }
            let sum = freshet::bank::checksum(&wrong[..20], &wrong[24..]);
            wrong[20..24].copy_from_slice(&sum.to_le_bytes());
            if let Ok(texture) = Texture::open(&wrong) {
                for i in 0..texture.rows() {
                    let row = texture.row(i).unwrap();
                    for variant in 0..texture.variants() {
                        let samples = row.variant(variant).unwrap();
                        assert!(samples.get(row.len() - 1).is_some());
                    }
                }
            }
        }
    }
    assert_eq!(Texture::open(b"").unwrap_err(), TextureError::NoTexture);
    assert_eq!(Texture::open(b"FTEX").unwrap_err(), TextureError::NoTexture);
}

#[test]
fn what_is_wrong_in_a_fire_is_named() {
    for (from, to, words) in [
        (
            "width = 0.1",
            "width = -1",
            "small.toml:4:9: turbulence.width = -1: expected a number from 0.001 to 10 m",
        ),
        (
            "cells = [12, 12, 18]",
            "cells = [12, 4, 18]",
            "turbulence.cells = [12, 4, 18]: expected three whole numbers from 8 to 256",
        ),
        ("cells = [12, 12, 18]", "cells = [12, 12]", "small.toml:5"),
        (
            "speeds = [1, 2, 4]",
            "speeds = [1, 4, 2]",
            "each above the one before",
        ),
        ("speeds = [1, 2, 4]", "speeds = [nan]", "texture.speeds"),
        (
            "bits = 8",
            "bits = 12",
            "texture.bits = 12: expected 8 or 16",
        ),
        ("seconds = 3", "second = 3", "unknown field `second`"),
        ("seconds = 3", "", "missing field `seconds`"),
        (
            "seconds = 3",
            "seconds = inf",
            "expected a number from 0.1 to 60 s",
        ),
        (
            "[[0, 0, 1], [1.414, 0, 1], [0.518, 1.316, 1]]",
            "[[0, 0, 0]]",
            "directions",
        ),
        (
            "viscosity = 1.2e-4",
            "viscosity = 0.5",
            "by the cells and the least speed",
        ),
    ] {
        assert!(SMALL.contains(from));
        let error = Fire::parse("small.toml", &SMALL.replace(from, to)).unwrap_err();
        let error = format!("{error:#}");
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn bake_writes_a_texture_and_its_pictures_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let never = AtomicBool::new(false);
    let fire = SMALL
        .replace("[12, 12, 18]", "[8, 8, 8]")
        .replace("seconds = 3", "seconds = 0.5");
    std::fs::write(path("fire.toml"), fire).unwrap();
    let mut request = Request {
        input: path("fire.toml"),
        output: path("fire.texture"),
        slice: Some(path("slice.png")),
        energy: Some(path("energy.png")),
        spectrogram: Some(path("sound.png")),
    };
    let report = bake(&request, &never).unwrap();
    println!("{}", report.summary);
    assert!(!report.interrupted && report.summary.contains("advection"));
    let bytes = std::fs::read(&request.output).unwrap();
    assert_eq!(Texture::open(&bytes).unwrap().rows(), 3);
    for name in ["slice.png", "energy.png", "sound.png"] {
        assert!(std::fs::metadata(path(name)).unwrap().len() > 1000);
    }
    assert!(!path("fire.texture.rows").exists());

    std::fs::write(path("scene.toml"), "[water]\nrate = 3\n").unwrap();
    request.input = path("scene.toml");
    let error = format!("{:#}", bake(&request, &never).unwrap_err());
    assert!(
        error.contains("nothing to bake; expected a fire"),
        "{error}"
    );
    request.input = path("none.toml");
    let error = format!("{:#}", bake(&request, &never).unwrap_err());
    assert!(error.contains("is the path right?"), "{error}");
    request.input = path("fire.toml");
    request.output = path("no/where");
    let error = format!("{:#}", bake(&request, &never).unwrap_err());
    assert!(error.contains("does the folder exist?"), "{error}");
}
