//! The coupled cloud: fixed point against f64, pitches of physics.md §3 from the sound, events, silence, stability.

mod common;

#[path = "cloud/model.rs"]
mod model;

use common::high_band::HighBand;
use common::{built_in, db, scene_names};
use freshet::cloud::{Body, Cloud, Keep, Keeper, Message, Push, Settings, Store, force};
use freshet::control::Control;
use freshet::profile::{F407, Profile};
use freshet::{BLOCK, Block, Frame, TICK, param};
use model::Model;

const RATE: f64 = 48_000.0;

type Store64 = Store<9, 11, 10>;
type Store128 = Store<17, 19, 36>;

/// A cloud with its control path, as the instrument runs it: what a tick computes is in force in the next one.
struct Live<S, const K: usize> {
    keeper: Keeper<K>,
    cloud: Cloud<S>,
    message: Message,
}

type Live64 = Live<Store64, 8>;

impl<S: freshet::cloud::Hold, const K: usize> Live<S, K> {
    fn new(store: S, seed: u64) -> Self {
        let (mut keeper, mut cloud) = (Keeper::OFF, Cloud::new(store));
        keeper.start(seed, RATE as u32);
        cloud.start(RATE);
        Self {
            keeper,
            cloud,
            message: Message::NONE,
        }
    }

    /// One tick in pascal, with what `look` does to its message before it is applied.
    fn tick(
        &mut self,
        settings: &Settings,
        mut look: impl FnMut(&mut Message, &Keeper<K>),
    ) -> Vec<[f64; 2]> {
        self.keeper.tick(settings, &mut self.message);
        look(&mut self.message, &self.keeper);
        self.cloud.apply(&self.message);
        let mut out = Vec::with_capacity(TICK);
        for _ in 0..TICK / BLOCK {
            let mut block: Block = [Frame::ZERO; BLOCK];
            self.cloud.render(&mut block);
            out.extend(
                block.map(|frame| [frame.left, frame.right].map(|x| f64::from(x) / 67_108_864.0)),
            );
        }
        out
    }
}

/// Nothing happens to it on its own.
fn still(bubbles: usize) -> Settings {
    Settings {
        bubbles,
        depth: 1e3,
        spacing: 1e6,
        ..Settings::NONE
    }
}

fn live64(seed: u64) -> Live64 {
    Live::new(Store64::REST, seed)
}

/// Bubbles of `radius` at `places`, all pushed alike: half a second of what one hears.
fn struck(bubbles: &[(f64, [f64; 3])]) -> Vec<f64> {
    let mut live = live64(1);
    let mut places = Vec::new();
    for (radius, place) in bubbles {
        let place = [place[0], place[1], place[2] + 1e3].map(|x| x as f32);
        let body = Body::new(*radius as f32, place, 0);
        places.push((live.keeper.place(body).expect("there is room"), body));
    }
    let mut clusters: Vec<u8> = places
        .iter()
        .map(|((cluster, _), _)| *cluster as u8)
        .collect();
    clusters.dedup();
    assert!(clusters.len() <= 2);
    live.keeper.work_out(&clusters);
    let settings = still(64);
    let mut out = Vec::new();
    for _ in 0..190 {
        let block = live.tick(&settings, |message, _| {
            if message.commit.is_some() {
                for (place, body) in places.drain(..) {
                    let push = Push::new(&body, 0.05, 2.0 / RATE as f32);
                    let _ = message.forces.push(force(place, &push));
                }
            }
        });
        out.extend(block.iter().map(|[left, right]| left + right));
    }
    assert_eq!(live.cloud.work().refused, 0);
    out
}

#[test]
fn a_bubble_alone_has_its_pitch_its_decay_and_its_loudness() {
    for radius in [0.5e-3, 1e-3, 3e-3, 10e-3] {
        let bubble = freshet::bubble::Bubble::new(radius);
        let sound = struck(&[(radius, [0.0; 3])]);
        let peak = sound.iter().fold(0.0f64, |peak, x| peak.max(x.abs()));
        let [(pitch, decay)] = model::modes::<1>(&sound, RATE, bubble.pitch())[..] else {
            panic!("a mode")
        };
        let cents = 1200.0 * (pitch / bubble.pitch()).log2();
        let slower = decay / bubble.beta - 1.0;
        let loud = 20.0 * (peak / (0.05 * 2f64.sqrt())).log10();
        println!(
            "{radius}: {cents:+.3} cents, decay {:+.3} %, {loud:+.2} dB",
            100.0 * slower
        );
        assert!(cents.abs() < 0.5 && slower.abs() < 0.01);
        assert!((-3.0..8.0).contains(&loud));
    }
}

#[test]
fn pairs_have_the_pitches_of_the_physics() {
    for (apart, expected) in [
        (2.0, 940.63),
        (4.0, 989.32),
        (10.0, 1044.35),
        (100.0, 1088.92),
    ] {
        let sound = struck(&[(3e-3, [0.0; 3]), (3e-3, [apart * 3e-3, 0.0, 0.0])]);
        let [(pitch, _)] = model::modes::<1>(&sound, RATE, 1e3)[..] else {
            panic!("a mode")
        };
        println!("{apart} r: {pitch:.2} Hz, {expected}");
        assert!((pitch / expected - 1.0).abs() < 0.005);
    }
    let sound = struck(&[(3e-3, [0.0; 3]), (2e-3, [12e-3, 0.0, 0.0])]);
    let modes = model::modes::<2>(&sound, RATE, 1.7e3);
    println!("3 and 2 mm: {modes:?}");
    for ((pitch, _), expected) in modes.iter().zip([1079.75, 1694.22]) {
        assert!(
            (pitch / expected - 1.0).abs() < 0.005,
            "{pitch}, {expected}"
        );
    }
}

/// A busy cloud.
fn busy(bubbles: usize) -> Settings {
    Settings {
        bubbles,
        rate: 100.0,
        split: 0.2,
        pushes: 200.0,
        radius_min: 0.7e-3,
        radius_max: 6e-3,
        gamma: 1.5,
        spacing: 4.0,
        depth: 0.05,
        coupling: 1.0,
        pressure: 0.15,
        drift: 0.05,
        width: 1.0,
    }
}

/// What a keeper is asked for.
struct Asked(Settings);

impl Keep for Asked {
    fn start(&mut self, _: u64, _: u32) {}
    fn tick(&mut self, settings: &Settings, _: &mut Message) {
        self.0 = *settings;
    }
}

/// How far down in the first second the difference to f64 is, dB of the signal, where each tick is as `settings` says.
fn residual<S: freshet::cloud::Hold, const K: usize>(
    mut live: Live<S, K>,
    mut settings: impl FnMut() -> Settings,
) -> f64 {
    let mut model = Model::new(RATE);
    let (mut signal, mut error, mut births) = (0.0, 0.0, 0);
    for _ in 0..375 {
        let mut wanted = Vec::new();
        let settings = &settings();
        let heard = live.tick(settings, |message, keeper| {
            births += usize::from(message.commit.is_some());
            wanted = model.tick(message, keeper.bodies(), settings);
        });
        for (heard, wanted) in heard.iter().zip(&wanted) {
            for ear in 0..2 {
                signal += wanted[ear] * wanted[ear];
                error += (heard[ear] - wanted[ear]).powi(2);
            }
        }
    }
    let n = 2.0 * 375.0 * TICK as f64;
    println!(
        "{:.1} dBFS rms, residual {:.1} dB down; {births} commits, {} refused",
        10.0 * (signal / n).log10(),
        10.0 * (signal / error).log10(),
        live.cloud.work().refused,
    );
    10.0 * (signal / error).log10()
}

#[test]
fn fixed_point_is_60_db_from_the_same_algorithm_in_f64() {
    assert!(residual(live64(3), || busy(64)) > 60.0);
    assert!(residual(Live::<Store128, 16>::new(Store128::REST, 4), || busy(128)) > 60.0);
}

#[test]
fn every_scene_with_a_cloud_is_60_db_from_f64() {
    let with_a_cloud = |name: &&str| built_in(name).value(param::CLOUD_RATE) > 0.0;
    let mut scenes = 0;
    for name in scene_names().filter(with_a_cloud) {
        let scene = built_in(name).scene;
        let mut control = Control::new(&scene, RATE as u32, F407::LIMITS, 1);
        let mut update = F407::update();
        let live: Live<Store128, 16> = Live::new(Store128::REST, 1);
        let residual = residual(live, || {
            let mut asked = Asked(Settings::NONE);
            control.tick(&mut update);
            control.tick_cloud(&mut asked, &mut update);
            asked.0
        });
        assert!(residual > 60.0, "{name}: {residual:.1} dB");
        scenes += 1;
    }
    assert!(scenes >= 4);
}

/// Bubbles below 1 kHz come, go, break and drift, parameters jump, and nothing pushes: what is above 6 kHz are clicks.
#[test]
fn nobody_hears_bubbles_come_and_go_or_parameters_jump() {
    // A step by -60 dB of the loudest sample shows as -67 dB.
    let bound = |jump| if jump == 0 { -66.0 } else { -52.0 };
    let high = HighBand::new(RATE as u32);
    for jump in 0..8 {
        let mut live: Live<Store128, 16> = Live::new(Store128::REST, 10 + jump);
        let pushed = Settings {
            radius_min: 5e-3,
            radius_max: 12e-3,
            pushes: 800.0,
            drift: 0.5,
            split: 0.5,
            ..busy(100)
        };
        let before = ticks(&mut live, &pushed, 400);
        let mut settings = Settings {
            pushes: 0.0,
            pressure: 0.0,
            ..pushed
        };
        let rest = ticks(&mut live, &settings, 2);
        match jump {
            1 => settings.coupling = 0.0,
            2 => settings.spacing = 2.0,
            3 => settings.depth = 0.012,
            4 => settings.bubbles = 20,
            5 => settings.width = 0.0,
            6 => settings.radius_max = 5e-3,
            7 => settings.bubbles = 0,
            _ => {}
        }
        let after = ticks(&mut live, &settings, 200);
        let loud =
            (before.iter().chain(&after).flatten()).fold(0.0f64, |loud, x| loud.max(x.abs()));
        let all: Vec<[f64; 2]> = rest.into_iter().chain(after).collect();
        let click = db(high.loudest(&all, TICK..all.len()).size / loud);
        println!("{jump}: {click:.1} dB");
        assert!(click < bound(jump), "{jump}: {click:.1} dB");
    }
}

/// Loudness, full scale 1 Pa.
fn level(sound: &[[f64; 2]]) -> f64 {
    let square: f64 = sound
        .iter()
        .map(|[left, right]| left * left + right * right)
        .sum();
    10.0 * (square / (2.0 * sound.len() as f64) + 1e-30).log10()
}

fn ticks<S: freshet::cloud::Hold, const K: usize>(
    live: &mut Live<S, K>,
    settings: &Settings,
    ticks: usize,
) -> Vec<[f64; 2]> {
    (0..ticks)
        .flat_map(|_| live.tick(settings, |_, _| {}))
        .collect()
}

#[test]
fn where_nothing_happens_any_more_it_falls_to_exact_silence() {
    let mut live = live64(5);
    ticks(&mut live, &busy(64), 375);
    assert!(!live.cloud.is_silent());
    let over = Settings {
        rate: 0.0,
        pushes: 0.0,
        ..busy(64)
    };
    let rest = ticks(&mut live, &over, 300);
    let last = rest
        .iter()
        .rposition(|frame| *frame != [0.0; 2])
        .expect("it rings on");
    println!("silent after {:.2} s", last as f64 / RATE);
    assert!(live.cloud.is_silent());
    // And in time nobody is there, and nothing is computed.
    ticks(&mut live, &over, 600);
    assert_eq!(live.keeper.bodies().count(), 0);
    assert!(live.keeper.is_at_rest() && live.cloud.is_silent());
}

#[test]
fn what_rings_fades_while_bubbles_come_go_and_move() {
    for (seed, spacing) in [(1, 2.0), (2, 3.0), (3, 6.0)] {
        let mut live: Live<Store128, 16> = Live::new(Store128::REST, seed);
        let harsh = Settings {
            radius_min: 0.5e-3,
            radius_max: 12e-3,
            spacing,
            split: 0.5,
            drift: 0.5,
            pushes: 500.0,
            ..busy(128)
        };
        let loud = level(&ticks(&mut live, &harsh, 1_500));
        // The same births, and nothing that pushes them.
        let mute = Settings {
            pressure: 0.0,
            pushes: 0.0,
            ..harsh
        };
        let fades: Vec<f64> = (0..4)
            .map(|_| level(&ticks(&mut live, &mute, 60)))
            .collect();
        println!("{loud:.1} dBFS, then every 0.16 s {fades:.1?}");
        assert!(loud < -15.0 && fades[0] < loud);
        assert!(
            fades
                .windows(2)
                .all(|pair| pair[1] < pair[0] - 6.0 || pair[1] < -100.0)
        );
    }
}

#[test]
fn too_much_is_refused_and_nothing_runs_over() {
    let mut live = live64(9);
    let loud = Settings {
        pressure: 2.0,
        pushes: 1_000.0,
        radius_min: 8e-3,
        radius_max: 12e-3,
        spacing: 2.0,
        ..busy(64)
    };
    let sound = ticks(&mut live, &loud, 1_000);
    let peak = sound
        .iter()
        .flatten()
        .fold(0.0f64, |peak, x| peak.max(x.abs()));
    println!(
        "peak {peak:.1} Pa, {} forces refused",
        live.cloud.work().refused
    );
    assert!(live.cloud.work().refused > 0 && peak < 7.0);
}

#[test]
fn coupling_brings_the_low_body_and_without_it_there_is_none() {
    let low = |coupling: f32| {
        let mut live = live64(6);
        let settings = Settings {
            coupling,
            ..busy(64)
        };
        let sound = ticks(&mut live, &settings, 1_500);
        // Two poles at 400 Hz.
        let part = 1.0 - (-2.0 * std::f64::consts::PI * 400.0 / RATE).exp();
        let (mut once, mut twice) = (0.0, 0.0);
        let lows: Vec<[f64; 2]> = (sound.iter())
            .map(|[left, right]| {
                once += part * (left + right - once);
                twice += part * (once - twice);
                [twice, twice]
            })
            .collect();
        level(&lows) - level(&sound)
    };
    let (without, with) = (low(0.0), low(1.0));
    println!("below 400 Hz: {without:.1} dB of all without, {with:.1} dB with");
    assert!(with > without + 4.0);
}

#[test]
fn a_living_cloud_in_clusters_has_nearly_the_frequencies_of_all_pairs() {
    let mut errors = Vec::new();
    for seed in 0..4 {
        let mut live = live64(20 + seed);
        let settings = Settings {
            radius_min: 0.5e-3,
            radius_max: 3e-3,
            gamma: 1.0,
            spacing: 9.0,
            depth: 1.0,
            ..busy(64)
        };
        ticks(&mut live, &settings, 800);
        while !live.keeper.is_at_rest() {
            ticks(&mut live, &settings, 1);
        }
        let (dense, clustered) = model::frequencies::<64>(live.keeper.bodies());
        errors.extend(
            dense
                .iter()
                .zip(&clustered)
                .map(|(a, b)| (b / a - 1.0).abs()),
        );
    }
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let (most, worst) = (errors[errors.len() * 95 / 100], errors[errors.len() - 1]);
    println!(
        "mean {:.2} %, 95 % {:.2} %, worst {:.2} %",
        100.0 * mean,
        100.0 * most,
        100.0 * worst
    );
    assert!(mean <= 0.01 && most <= 0.035 && worst <= 0.08);
}

/// Ticks of all births, from the first tick of a batch to its commit.
#[test]
fn a_batch_has_its_date() {
    let mut live: Live<Store128, 16> = Live::new(Store128::REST, 8);
    let (mut begun, mut longest) = (None, 0);
    for now in 0..1_500 {
        live.tick(&busy(128), |message, _| {
            if message.slice.is_some() {
                begun.get_or_insert(now);
            }
            if message.commit.is_some() {
                longest = longest.max(now - begun.take().expect("it began") + 1);
            }
        });
    }
    println!("{longest} ticks");
    assert_eq!(longest, 3);
}
