//! Fire's turbulence and vortex sound against exact cases. `-- --nocapture` prints what was measured.

use std::f64::consts::{PI, TAU};

use std::sync::atomic::{AtomicBool, Ordering};

use freshet::texture::{Samples, Texture, TextureError};
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
    for n in [24, 32, 40, 48, 64] {
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
        if n >= 40 {
            assert!(worst < 0.05);
        }
    }
    assert!(last < 0.01);
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
receivers = [[1, 0, 1], [-1, 0, 1], [0, 1, 1], [1, 1, 0]]
seconds = 1.5
bits = 8
seed = 1
"#;

fn small() -> Fire {
    Fire::parse("small.toml", SMALL).unwrap()
}

#[test]
fn eddies_that_are_only_carried_through_are_hardly_heard() {
    // Frozen eddies have no sound: their moments grow as t² at most. What is heard of them is the window's.
    let fire = small();
    let (grid, speed) = (fire.grid(), 2.0);
    let plan = Plan::new(&fire, speed);
    for taper in [[0.25, 0.25, 0.5], TAPER] {
        let inflow = Inflow::new(grid, speed, fire.perturbation, fire.eddy, 1);
        let volume = Volume::new(&grid, taper);
        let mut flow = Flow::new(grid, Forces::default());
        let mut heard = [vec![], vec![]];
        let mut live = Flow::new(
            grid,
            Forces {
                confinement: 0.1 * speed,
                viscosity: 1.2e-4,
            },
        );
        inflow.fill_box(&mut live.velocity, 0.0);
        live.start();
        let mut omega = live.omega.clone();
        for n in 0..1200 {
            let t = f64::from(n) * plan.dt;
            inflow.fill_box(&mut flow.velocity, t);
            vorticity(&grid, &flow.velocity, &mut omega);
            heard[0].push(toward(&volume.moments(&omega), [1.0, 0.0, 1.0]));
            live.step(plan.dt, Some((&inflow, t + plan.dt)));
            heard[1].push(toward(&volume.moments(&live.omega), [1.0, 0.0, 1.0]));
        }
        let [frozen, live] = heard.map(|record| {
            let p = third_derivative(&record, speed, plan.dt, 60, plan.band, 3);
            let p = p[80..320].to_vec();
            (rms(&p), centroid(&[p], 1.0 / (3.0 * plan.dt)))
        });
        println!(
            "taper {taper:?}: frozen {frozen:?}, live {live:?}, stop {}",
            plan.band.stop
        );
    }
}
