//! When bubbles are born, of which class, how strong and where: the laws of physics.md §2, on what the core reports.
//!
//! Every figure comes with the deviation that chance allows it. Seeds are fixed, so a test that passes stays so until
//! the core draws otherwise.

mod common;

use std::sync::LazyLock;

use common::{desk, scene, with};
use freshet::mix::Output;
use freshet::observer::{Birth, Crowd, Observer};
use freshet::param;
use freshet::population;
use freshet::profile::{F411, Limits, Profile, limits};
use freshet::scene::Scene;
use freshet::stats::Stats;
use freshet::voices::Voice;
use freshet::{BLOCK, Frame, Instrument, TICK, Update};
use freshet_host::births::{Births, Sound, SoundPath};
use freshet_host::board::{Board, Player};
use statrs::distribution::{ChiSquared, ContinuousCDF};

const HZ: u32 = 48_000;
/// Neighbours, the ends of the range, and one of no pattern.
const SEEDS: [u64; 5] = [0, 1, 2, 0x5eed_f1e5, u64::MAX];
/// What chance undercuts once in ten thousand.
const P: f64 = 1e-4;

/// Plays `frames` and hands on every birth, tick by tick.
fn watch(player: &mut dyn Player, frames: usize, mut see: impl FnMut(&Sound)) {
    let mut births = Births::new(HZ);
    let mut out = [Frame::ZERO; TICK];
    let mut left = frames;
    while left > 0 {
        let n = left.min(TICK);
        player.render_observed(&mut out[..n], &mut births);
        births.sounds.drain(..).for_each(|sound| see(&sound));
        left -= n;
    }
}

/// Only counts: tells `see` of times in seconds and births.
struct Tally<F>(F);

impl<F: FnMut(f64, u64)> Observer for Tally<F> {
    fn birth(&mut self, birth: &Birth) {
        let fraction = f64::from(birth.fraction) / f64::from(1 << 27);
        (self.0)((birth.frame as f64 + fraction) / f64::from(HZ), 1);
    }
    fn crowd(&mut self, crowd: &Crowd) {
        (self.0)(crowd.frame as f64 / f64::from(HZ), crowd.births);
    }
}

/// Plays `frames` and tells `see` when how many are born: [`watch`] without the physics of each.
fn tally(player: &mut dyn Player, frames: usize, see: impl FnMut(f64, u64)) {
    let mut observer = Tally(see);
    let mut out = [Frame::ZERO; TICK];
    let mut left = frames;
    while left > 0 {
        let n = left.min(TICK);
        player.render_observed(&mut out[..n], &mut observer);
        left -= n;
    }
}

/// All births of `seconds` of `scene`, and the core's counters.
fn born(scene: &Scene, seed: u64, seconds: f64) -> (Vec<Sound>, Stats) {
    let mut player = desk(scene, HZ, seed, Output::Raw);
    let mut sounds = Vec::new();
    watch(&mut *player, frames(seconds), |sound| sounds.push(*sound));
    (sounds, player.stats())
}

fn frames(seconds: f64) -> usize {
    (seconds * f64::from(HZ)).round() as usize
}

/// How many deviations a Poisson count is off.
fn sigmas(count: f64, expected: f64) -> f64 {
    (count - expected) / expected.sqrt()
}

/// Kolmogorov–Smirnov: the probability that `u` would lie as unevenly in (0, 1) by chance (Stephens' approximation).
fn evenness(mut u: Vec<f64>) -> f64 {
    u.sort_by(f64::total_cmp);
    let n = u.len() as f64;
    let distance = u.iter().enumerate().fold(0.0, |far: f64, (i, u)| {
        far.max(u - i as f64 / n).max((i as f64 + 1.0) / n - u)
    });
    let x = (n.sqrt() + 0.12 + 0.11 / n.sqrt()) * distance;
    let term = |j: i32| {
        let sign = if j % 2 == 1 { 2.0 } else { -2.0 };
        sign * (-2.0 * f64::from(j * j) * x * x).exp()
    };
    // Below 0.2 it is 1 to twelve digits, and the series is slow.
    if x < 0.2 {
        1.0
    } else {
        (1..50).map(term).sum()
    }
}

/// The same for gaps between `times`, against the exponential law of `rate` a second. As many gaps as are there by all
/// but certainty: stopping the clock instead would favour the short ones. None where these are too few to judge.
fn exponential(times: &[f64], rate: f64, seconds: f64) -> Option<f64> {
    let expected = rate * seconds;
    let sure = (expected - 5.0 * expected.sqrt()).max(0.0) as usize;
    assert!(
        times.len() >= sure,
        "{} births of {expected}: far too few",
        times.len()
    );
    let gaps = times[..sure].iter().scan(0.0, |before, time| {
        let gap = time - *before;
        *before = *time;
        Some(-(-rate * gap).exp_m1())
    });
    (sure >= 20).then(|| evenness(gaps.collect()))
}

/// Probability of a larger chi-square, and how many cells it has. The smallest cells are pooled until each expects 5.
fn chi_square(counts: &[f64], expected: &[f64]) -> (f64, usize) {
    let mut sorted: Vec<(f64, f64)> = counts
        .iter()
        .copied()
        .zip(expected.iter().copied())
        .collect();
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut cells: Vec<(f64, f64)> = vec![(0.0, 0.0)];
    for (count, expected) in sorted {
        match cells.last_mut() {
            Some(cell) if cell.1 < 5.0 => *cell = (cell.0 + count, cell.1 + expected),
            _ => cells.push((count, expected)),
        }
    }
    let x: f64 = cells
        .iter()
        .map(|(count, expected)| (count - expected) * (count - expected) / expected)
        .sum();
    let freedom = (cells.len() - 1) as f64;
    let p = ChiSquared::new(freedom).expect("two cells or more").sf(x);
    (p, cells.len())
}

/// Variance of counts over their mean, and how likely a Poisson process is to be as far from 1 (both sides).
fn dispersion(counts: &[f64]) -> (f64, f64) {
    let n = counts.len() as f64;
    let mean = counts.iter().sum::<f64>() / n;
    let square: f64 = counts.iter().map(|count| (count - mean).powi(2)).sum();
    let law = ChiSquared::new(n - 1.0).expect("bins");
    let (below, above) = (law.cdf(square / mean), law.sf(square / mean));
    (square / mean / (n - 1.0), 2.0 * below.min(above))
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let product = |x: &[f64], mx: f64, y: &[f64], my: f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum()
    };
    product(a, ma, b, mb) / (product(a, ma, a, ma) * product(b, mb, b, mb)).sqrt()
}

/// One of the ways to spread births over 64 classes.
struct Law {
    name: &'static str,
    toml: String,
    /// Each class's part of the births.
    share: Vec<f64>,
}

/// Radii of the 64 classes, mm: physics.md §2.
fn radii() -> impl Iterator<Item = f64> {
    (0..64).map(|k| 0.2 * 100f64.powf(f64::from(k) / 63.0))
}

fn laws() -> Vec<Law> {
    let custom: Vec<f64> = (0..64u32).map(|k| f64::from(k * 37 % 64) / 64.0).collect();
    let law = |name, toml: String, weight: Vec<f64>| {
        let total: f64 = weight.iter().sum();
        Law {
            name,
            toml: format!("classes = 64\nradius_min = 0.2\nradius_max = 20\n{toml}"),
            share: weight.iter().map(|w| w / total).collect(),
        }
    };
    let power = |gamma: f64| radii().map(|r| r.powf(-gamma)).collect();
    vec![
        law("flat", "law = \"flat\"".into(), vec![1.0; 64]),
        law("gamma 2", "gamma = 2".into(), power(2.0)),
        law("gamma 6", "gamma = 6".into(), power(6.0)),
        law(
            "custom",
            format!("law = \"custom\"\nweight = {custom:?}"),
            custom,
        ),
    ]
}

/// One rendering's births, in order of time.
struct Run {
    law: &'static str,
    share: Vec<f64>,
    rate: f64,
    seed: u64,
    seconds: f64,
    rows: Vec<Row>,
    stats: Stats,
}

#[derive(Clone, Copy)]
struct Row {
    time: f64,
    births: u16,
    class: u8,
    crowd: bool,
}

/// Births a second, and the seconds to listen.
const RATES: [(f64, f64); 4] = [(3.0, 60.0), (300.0, 10.0), (30_000.0, 1.0), (1e6, 0.1)];

/// Every law at every rate by every seed. Soft bubbles, so that none is refused.
static RUNS: LazyLock<Vec<Run>> = LazyLock::new(|| {
    let mut runs = Vec::new();
    for law in laws() {
        for (rate, seconds) in RATES {
            let scene = scene(&format!(
                "[water]\nrate = {rate}\npressure = 0.001\nalpha = 0\n{}",
                law.toml
            ));
            for seed in SEEDS {
                let mut player = desk(&scene, HZ, seed, Output::Raw);
                let mut rows = Vec::new();
                watch(&mut *player, frames(seconds), |sound| {
                    rows.push(Row {
                        time: sound.time,
                        births: sound.births as u16,
                        class: sound.class.expect("of the population") - 1,
                        crowd: sound.path == SoundPath::Crowd,
                    });
                });
                rows.sort_by(|a, b| a.time.total_cmp(&b.time));
                runs.push(Run {
                    law: law.name,
                    share: law.share.clone(),
                    rate,
                    seed,
                    seconds,
                    rows,
                    stats: player.stats(),
                });
            }
        }
    }
    runs
});

impl Run {
    fn name(&self) -> String {
        format!("{:7} {:>7}/s seed {:#x}", self.law, self.rate, self.seed)
    }

    fn counts(&self) -> Vec<f64> {
        let mut counts = vec![0.0; 64];
        for row in &self.rows {
            counts[usize::from(row.class)] += f64::from(row.births);
        }
        counts
    }

    /// Which classes are no crowd.
    fn singles(&self) -> Vec<bool> {
        let mut single = vec![true; 64];
        for row in self.rows.iter().filter(|row| row.crowd) {
            single[usize::from(row.class)] = false;
        }
        single
    }

    /// Births of the classes that are `wanted`: their times, and how many a second they should be.
    fn times(&self, wanted: impl Fn(usize) -> bool) -> (Vec<f64>, f64) {
        let classes = self.share.iter().enumerate().filter(|(k, _)| wanted(*k));
        let rate = self.rate * classes.map(|(_, share)| share).sum::<f64>();
        let rows = self
            .rows
            .iter()
            .filter(|row| wanted(usize::from(row.class)));
        (rows.map(|row| row.time).collect(), rate)
    }
}

#[test]
fn as_many_bubbles_are_born_as_a_poisson_process_has() {
    for run in RUNS.iter() {
        let births: f64 = run.counts().iter().sum();
        let off = sigmas(births, run.rate * run.seconds);
        println!("{}: {births} births, {off:+.2} sigma", run.name());
        assert!(off.abs() < 4.0, "{}: {off:+.2} sigma", run.name());
        assert_eq!(births as u64, run.stats.births, "counted otherwise");
        assert_eq!(run.stats.late + run.stats.overloads, 0);
    }
}

#[test]
fn classes_have_the_births_of_their_law() {
    for run in RUNS.iter() {
        let counts = run.counts();
        let births: f64 = counts.iter().sum();
        let expected: Vec<f64> = run.share.iter().map(|share| share * births).collect();
        let (p, cells) = chi_square(&counts, &expected);
        println!("{}: p = {p:.4} over {cells} cells", run.name());
        assert!(p > P, "{}: p = {p:.2e}", run.name());
        for (k, share) in run.share.iter().enumerate() {
            assert!(
                *share > 0.0 || counts[k] == 0.0,
                "class {} has no births",
                k + 1
            );
        }
    }
}

#[test]
fn gaps_between_births_are_exponential_and_no_place_in_a_sample_is_better() {
    let mut all = Vec::new();
    for run in RUNS.iter() {
        let single = run.singles();
        let busiest = (0..64)
            .filter(|k| single[*k])
            .max_by(|a, b| run.share[*a].total_cmp(&run.share[*b]))
            .expect("not all are crowds");
        let (times, rate) = run.times(|k| single[k]);
        let (own, own_rate) = run.times(|k| k == busiest);
        let inside = times.iter().map(|time| (time * f64::from(HZ)).fract());
        let p = [
            exponential(&times, rate, run.seconds),
            exponential(&own, own_rate, run.seconds),
            Some(evenness(inside.collect())),
        ];
        let [p0, p1, p2] = p.map(|p| p.map_or("      ".into(), |p| format!("{p:.4}")));
        println!(
            "{}: p = {p0} of {} births, {p1} of {} of class {}, {p2} within the sample",
            run.name(),
            times.len(),
            own.len(),
            busiest + 1,
        );
        for p in p.iter().flatten() {
            assert!(*p > P, "{}: p = {p:.2e}", run.name());
        }
        all.push(p);
    }
    // Of a right law the probabilities themselves are even.
    for (i, what) in ["all births", "one class", "place in the sample"]
        .iter()
        .enumerate()
    {
        let these: Vec<f64> = all.iter().filter_map(|p| p[i]).collect();
        let n = these.len();
        let p = evenness(these);
        println!("{what}: the {n} probabilities are even: p = {p:.4}");
        assert!(p > P, "{what}: p = {p:.2e}");
    }
}

#[test]
fn births_of_two_seeds_know_nothing_of_each_other() {
    const SECONDS: usize = 10;
    const BINS: usize = 100 * SECONDS;
    for (rate, gamma) in [(300.0, 2.0), (10_000.0, 2.0), (1e6, 6.0)] {
        let text = format!("[water]\nrate = {rate}\ngamma = {gamma}\npressure = 0.001\nalpha = 0");
        let scene = scene(&text);
        let runs = SEEDS.map(|seed| {
            let mut player = desk(&scene, HZ, seed, Output::Raw);
            let mut bins = vec![0.0; BINS];
            let mut times = Vec::new();
            tally(&mut *player, SECONDS * HZ as usize, |time, births| {
                let bin = (time * 100.0) as usize;
                bins[bin.min(BINS - 1)] += births as f64;
                if rate < 1e5 {
                    times.push(time);
                }
            });
            (bins, times)
        });
        let (mut most, mut least, mut least_gaps) = (0.0f64, 1.0f64, 1.0f64);
        for (i, (one, one_times)) in runs.iter().enumerate() {
            let (index, p) = dispersion(one);
            println!("{rate:>7}/s seed {i}: dispersion {index:.4}, p = {p:.4}");
            assert!(p > P, "{rate}/s, seed {i} alone: dispersion {index:.4}");
            for (j, (two, two_times)) in runs.iter().enumerate().skip(i + 1) {
                let r = correlation(one, two);
                most = most.max(r.abs());
                assert!(
                    r.abs() < 4.0 / (BINS as f64).sqrt(),
                    "{rate}/s, {i} and {j}: {r:.4}"
                );
                let both: Vec<f64> = one.iter().zip(two).map(|(a, b)| a + b).collect();
                let (index, p) = dispersion(&both);
                least = least.min(p);
                assert!(p > P, "{rate}/s, {i} with {j}: dispersion {index:.4}");
                if !one_times.is_empty() {
                    let mut merged = [&one_times[..], &two_times[..]].concat();
                    merged.sort_by(f64::total_cmp);
                    let p =
                        exponential(&merged, 2.0 * rate, SECONDS as f64).expect("enough births");
                    least_gaps = least_gaps.min(p);
                    assert!(p > P, "{rate}/s, gaps of {i} with {j}: p = {p:.2e}");
                }
            }
        }
        println!(
            "{rate:>7}/s: of 10 pairs the largest correlation is {most:.3}; two merged are Poisson, least p = {least:.4}, of their gaps {least_gaps:.4}"
        );
    }
}

/// Pressure at 1 m of an entrained bubble of depth factor 1, `2σ/R`, Pa: physics.md §1.
const ENTRAINED: f64 = 0.1452;

#[test]
fn a_depth_factor_is_a_random_number_to_the_power_beta() {
    // Softer bubbles than this are too few units of the core's words.
    const LEAST: f64 = 2e-6;
    for seed in SEEDS {
        for (beta, depth, rest) in [
            (1.0, 1.0, "rise_factor = 0"),
            (2.0, 1.0, "rise_factor = 0"),
            (10.0, 1.0, "rise_factor = 0"),
            (10.0, 1.0, "rise_cutoff = 0.3"),
            (30.0, 0.5, "rise_cutoff = 0.3"),
        ] {
            let text = format!(
                "[water]\nrate = 10000\nradius_min = 2\nradius_max = 2\nclasses = 1\nexcitation = \"entrainment\"\nbeta = {beta}\ndepth = {depth}\n{rest}\n[mix]\nwidth = 0"
            );
            let (sounds, stats) = born(&scene(&text), seed, 2.0);
            assert_eq!(stats.overloads + stats.unvoiced, 0, "{text}");
            let random = sounds.iter().map(|sound| {
                let [left, right] = sound.amplitude;
                assert_eq!(left, right, "it is not in the middle");
                (left / (ENTRAINED * depth)).powf(1.0 / beta)
            });
            let least = (LEAST / depth).powf(1.0 / beta);
            let heard: Vec<f64> = random
                .filter(|x| *x > least)
                .map(|x| (x - least) / (1.0 - least))
                .collect();
            let part = heard.len() as f64 / sounds.len() as f64;
            let p = evenness(heard);
            println!(
                "beta {beta}, depth {depth}, {rest}, seed {seed:#x}: p = {p:.4} of {} births ({part:.3} loud enough)",
                sounds.len()
            );
            assert!(p > P, "{text}\nseed {seed:#x}: p = {p:.2e}");
            let off = (part - (1.0 - least)) * (sounds.len() as f64 / least / (1.0 - least)).sqrt();
            assert!(
                off.abs() < 4.0,
                "{text}\n{off:+.2} sigma are too soft to tell"
            );
        }
    }
}

#[test]
fn an_impact_grows_with_the_radius_to_the_power_alpha() {
    for alpha in [0.0, 1.5, 3.0] {
        let text = format!(
            "[water]\nrate = 20000\nradius_min = 0.5\nradius_max = 8\nlaw = \"flat\"\nclasses = 9\nbeta = 2\npressure = 0.0005\nalpha = {alpha}\n[mix]\nwidth = 0"
        );
        let (sounds, stats) = born(&scene(&text), 1, 4.0);
        assert_eq!(stats.overloads + stats.unvoiced, 0, "{text}");
        for class in 1..=9u8 {
            let radius = 0.5 * 16f64.powf(f64::from(class - 1) / 8.0);
            let full = 0.0005 * radius.powf(alpha);
            let random: Vec<f64> = (sounds.iter().filter(|sound| sound.class == Some(class)))
                .map(|sound| (sound.amplitude[0] / full).sqrt())
                .collect();
            let loudest = random.iter().copied().fold(0.0, f64::max);
            // Below, a unit of the words is more than a fifth of a percent of the random number.
            let least = (3e-6 / full).sqrt();
            let heard: Vec<f64> = (random.iter().filter(|x| **x > least))
                .map(|x| (x - least) / (1.0 - least))
                .collect();
            let n = heard.len();
            let p = evenness(heard);
            println!(
                "alpha {alpha}, {radius:.3} mm: loudest {loudest:.5} of {full:.6} Pa, p = {p:.4} of {n}"
            );
            assert!(p > P, "alpha {alpha}, class {class}: p = {p:.2e}");
            assert!((0.995..1.001).contains(&loudest), "{loudest}");
        }
    }
}

#[test]
fn bubbles_are_spread_evenly_over_the_width_and_are_as_loud_everywhere() {
    for width in [1.0, 0.5, 0.125] {
        for rest in ["rise_factor = 0", "rise_cutoff = 0"] {
            let text = format!(
                "[water]\nrate = 10000\npressure = 0.001\nalpha = 0\nbeta = 0.5\n{rest}\nlaw = \"flat\"\nradius_min = 1\n[mix]\nwidth = {width}"
            );
            let (sounds, _) = born(&scene(&text), 3, 2.0);
            // 256 places from left to right.
            let mut counts = vec![0.0; 257];
            let (mut places, mut strengths) = (Vec::new(), Vec::new());
            for sound in &sounds {
                let [left, right] = sound.amplitude;
                let power = (left * left + right * right) / 2.0;
                if power.sqrt() < 1e-4 {
                    continue;
                }
                let place = right.atan2(left) / std::f64::consts::FRAC_PI_2 * 256.0;
                assert!((place - place.round()).abs() < 0.02, "between: {place}");
                counts[place.round() as usize] += 1.0;
                places.push(place);
                strengths.push(power.sqrt());
            }
            let used = (256.0 * width) as usize;
            let first = 128 - used / 2;
            let n = places.len() as f64;
            let (inside, outside): (Vec<_>, Vec<_>) = counts
                .iter()
                .enumerate()
                .partition(|(place, _)| (first..first + used).contains(place));
            let lost: f64 = outside.iter().map(|(_, count)| **count).sum();
            let inside: Vec<f64> = inside.iter().map(|(_, count)| **count).collect();
            let (p, cells) = chi_square(&inside, &vec![n / used as f64; used]);
            let r = correlation(&places, &strengths);
            println!(
                "width {width}, {rest}: p = {p:.4} over {cells} places, {lost} of {n} beyond, correlation with strength {r:+.4}"
            );
            assert!(p > P, "{text}\np = {p:.2e}");
            assert_eq!(lost, 0.0, "{text}");
            assert!(r.abs() < 4.0 / n.sqrt(), "{text}\n{r:+.4}");
            // Both ears together are as loud in the middle as at the sides.
            let aside: Vec<f64> = places.iter().map(|place| (place - 128.0).abs()).collect();
            let r = correlation(&aside, &strengths);
            assert!(r.abs() < 4.0 / n.sqrt(), "{text}\n{r:+.4}");
            let loudest = strengths.iter().copied().fold(0.0, f64::max);
            assert!((0.99..1.001).contains(&(loudest / 0.001)), "{loudest} Pa");
        }
    }
}

fn set(player: &mut dyn Player, path: &str, value: f32, ramp: Option<f32>) {
    let index = param::index_of(path).expect("in the table");
    let control = player.control();
    control.set(index, value, ramp).expect("allowed");
}

#[test]
fn another_rate_acts_one_whole_tick_later_and_not_before() {
    for (before, after) in [(300.0, 30_000.0), (30_000.0, 300.0), (3.0, 1e6), (1e6, 0.0)] {
        for seed in SEEDS {
            let scene = with(
                scene("[water]\npressure = 0.0005\nalpha = 0"),
                "water.rate",
                before,
            );
            let mut player = desk(&scene, HZ, seed, Output::Raw);
            let ticks = 100;
            let mut counts = [0.0; 2];
            // Set after `ticks`, computed while the next one sounds, in force from the one after it.
            let turn = ((ticks + 1) * TICK) as f64 / f64::from(HZ);
            let mut see = |time, births| counts[usize::from(time >= turn)] += births as f64;
            tally(&mut *player, ticks * TICK, &mut see);
            set(&mut *player, "water.rate", after, Some(0.0));
            tally(&mut *player, (ticks + 1) * TICK, &mut see);
            let seconds = [turn, (ticks * TICK) as f64 / f64::from(HZ)];
            for (i, rate) in [before, after].iter().enumerate() {
                let expected = f64::from(*rate) * seconds[i];
                if expected == 0.0 {
                    assert_eq!(counts[i], 0.0, "births at no rate");
                    continue;
                }
                let off = sigmas(counts[i], expected);
                println!(
                    "{before} to {after}/s, seed {seed:#x}: {} births {}, {off:+.2} sigma",
                    counts[i],
                    ["before", "after"][i]
                );
                assert!(
                    off.abs() < 4.0,
                    "{before} to {after}/s, seed {seed:#x}, part {i}: {off:+.2} sigma"
                );
            }
        }
    }
}

#[test]
fn on_a_ramp_the_rate_is_what_the_control_says() {
    for seed in SEEDS {
        let mut player = desk(
            &scene("[water]\nrate = 1000\npressure = 0.0005\nalpha = 0"),
            HZ,
            seed,
            Output::Raw,
        );
        let mut births = 0.0;
        let mut expected = 0.0;
        let mut last = 1000.0;
        for part in [40_000.0, 0.0, 200.0, 700_000.0, 5.0] {
            set(&mut *player, "water.rate", part, Some(0.5));
            for _ in 0..400 {
                // What the control reached in a tick sounds in the next.
                expected += last * TICK as f64 / f64::from(HZ);
                tally(&mut *player, TICK, |_, n| births += n as f64);
                last = f64::from(player.control().get(param::RATE));
            }
            assert_eq!(last, f64::from(part));
        }
        let off = sigmas(births, expected);
        println!("seed {seed:#x}: {births} births of {expected:.0}, {off:+.2} sigma");
        assert!(off.abs() < 4.0, "seed {seed:#x}: {off:+.2} sigma");
    }
}

#[test]
fn at_a_rate_of_0_nothing_is_ever_born() {
    for text in [
        "rate = 0",
        "rate = 1000\nlaw = \"custom\"\nweight = [0]\nclasses = 1",
    ] {
        for seed in SEEDS {
            let mut player = desk(&scene(&format!("[water]\n{text}")), HZ, seed, Output::Raw);
            tally(&mut *player, 60 * HZ as usize, |time, _| {
                panic!("a birth at {time} s")
            });
            assert_eq!(player.stats(), Stats::default());
            assert!(player.is_silent());
        }
    }
    // After a life, too; and what was stopped begins again, with no birth stored up.
    for (rate, ramp) in [(1e6, Some(0.0)), (1e6, None), (3.0, None)] {
        let text = format!("[water]\nrate = {rate}\npressure = 0.0005\nalpha = 0");
        let mut player = desk(&scene(&text), HZ, 7, Output::Raw);
        tally(&mut *player, HZ as usize, |_, _| {});
        set(&mut *player, "water.rate", 0.0, ramp);
        tally(&mut *player, HZ as usize / 2, |_, _| {});
        let stats = player.stats();
        tally(&mut *player, 30 * HZ as usize, |time, _| {
            panic!("a birth at {time} s")
        });
        assert_eq!(player.stats().births, stats.births);
        set(&mut *player, "water.rate", 30_000.0, Some(0.0));
        let mut births = 0.0;
        tally(&mut *player, HZ as usize + TICK, |_, n| births += n as f64);
        let off = sigmas(births, 30_000.0);
        println!("{rate}/s, none, then 30 000/s: {births} births, {off:+.2} sigma");
        assert!(off.abs() < 4.0, "{off:+.2} sigma");
    }
}

#[test]
fn bubbles_above_the_cutoff_rise_in_crowds_too() {
    for (rate, gamma, seconds) in [(30_000.0, 2.0, 4.0), (1e6, 6.0, 0.5)] {
        for (cutoff, beta, depth) in [
            (0.9, 10.0, 1.0),
            (0.3, 2.0, 1.0),
            (0.3, 10.0, 0.5),
            (0.9, 30.0, 1.0),
        ] {
            for seed in SEEDS {
                let text = format!(
                    "[water]\nrate = {rate}\ngamma = {gamma}\nradius_min = 0.2\nradius_max = 20\npressure = 0.0001\nalpha = 0\nrise_cutoff = {cutoff}\nbeta = {beta}\ndepth = {depth}"
                );
                let mut player = desk(&scene(&text), HZ, seed, Output::Raw);
                // The smallest class, and all others: births, rising ones.
                let mut counts = [[0.0; 2]; 2];
                let (mut crowds, mut rising, mut random) = (0, Vec::new(), Vec::new());
                watch(&mut *player, frames(seconds), |sound| {
                    let count = &mut counts[usize::from(sound.class != Some(1))];
                    count[0] += sound.births as f64;
                    count[1] += f64::from(u8::from(sound.path == SoundPath::Voice));
                    crowds += u64::from(sound.path == SoundPath::Crowd);
                    if sound.class == Some(1) && sound.path == SoundPath::Voice {
                        rising.push(sound.time);
                        let factor = sound.mean_amplitude() / 0.0001;
                        random.push((factor / depth).powf(1.0 / beta));
                    }
                });
                let still = (cutoff / depth).powf(1.0 / beta);
                let stats = player.stats();
                assert_eq!(stats.unvoiced + stats.stolen + stats.overloads, 0, "{text}");
                assert_eq!(stats.rising, (counts[0][1] + counts[1][1]) as u64);
                assert_eq!(crowds > 0, rate > 1e5, "{text}\nit is the wrong kind");
                for (class, [births, rising]) in ["class 1", "others"].iter().zip(counts) {
                    let expected = (1.0 - still) * births;
                    let off = (rising - expected) / (expected * still).sqrt();
                    println!(
                        "{rate:>7}/s, cutoff {cutoff}, beta {beta}, depth {depth}, seed {seed:#x}, {class}: {:.5} of {births} rise, {:.5} wanted, {off:+.2} sigma",
                        rising / births,
                        1.0 - still
                    );
                    assert!(off.abs() < 4.0, "{text}\n{class}: {off:+.2} sigma");
                }
                // Their own times and strengths are those of chance as well.
                let share: f64 = {
                    let weights = (0..50).map(|k| 100f64.powf(-gamma * f64::from(k) / 49.0));
                    1.0 / weights.sum::<f64>()
                };
                rising.sort_by(f64::total_cmp);
                let gaps = exponential(&rising, rate * share * (1.0 - still), seconds)
                    .expect("enough births");
                let strengths: Vec<f64> = (random.iter())
                    .map(|x| (x - still) / (1.0 - still))
                    .collect();
                assert!(strengths.iter().all(|x| (-0.001..1.001).contains(x)));
                let strength = evenness(strengths);
                println!("    their gaps p = {gaps:.4}, strengths p = {strength:.4}");
                assert!(gaps > P && strength > P, "{text}\nseed {seed:#x}");
            }
        }
    }
}

#[test]
fn all_rise_or_none_at_the_ends_of_the_cutoff() {
    for (rest, all) in [
        ("rise_cutoff = 0", true),
        ("rise_cutoff = 0.5\nbeta = 0", true),
        ("rise_cutoff = 1", false),
        ("rise_cutoff = 1\nbeta = 0", false),
        ("rise_cutoff = 0\nrise_factor = 0", false),
        ("rise_cutoff = 0.5\ndepth = 0.5", false),
        ("rise_cutoff = 0.5\ndepth = 0.3", false),
    ] {
        for rate in [3_000, 1_000_000] {
            let text = format!(
                "[water]\nrate = {rate}\ngamma = 6\nradius_min = 0.3\npressure = 0.0001\nalpha = 0\n{rest}"
            );
            let (sounds, stats) = born(&scene(&text), 5, 0.2);
            let voices = sounds.iter().filter(|sound| sound.path == SoundPath::Voice);
            let voices = voices.count() as u64;
            println!("{rate}/s, {rest:?}: {voices} of {} rise", stats.births);
            assert_eq!(voices, if all { stats.births } else { 0 }, "{text}");
            assert_eq!(stats.rising, voices);
        }
    }
}

#[test]
fn strength_place_and_time_of_a_birth_know_nothing_of_each_other() {
    let text = "[water]\nrate = 20000\nradius_min = 2\nradius_max = 2\nclasses = 1\npressure = 0.001\nalpha = 0\nbeta = 1\nrise_factor = 0";
    let names = [
        "gap before",
        "strength",
        "place",
        "gap after",
        "next strength",
        "next place",
    ];
    for seed in SEEDS {
        let (sounds, _) = born(&scene(text), seed, 2.0);
        let figures: Vec<[f64; 3]> = sounds
            .windows(2)
            .map(|pair| {
                let [left, right] = pair[1].amplitude;
                let gap = 20_000.0 * (pair[1].time - pair[0].time);
                // Gaps by their random number, so that every figure is even in its range.
                [(-gap).exp(), left.hypot(right), right.atan2(left)]
            })
            .collect();
        let columns: Vec<Vec<f64>> = (0..6)
            .map(|i| figures.windows(2).map(|pair| pair[i / 3][i % 3]).collect())
            .collect();
        let mut most = (0.0f64, "", "");
        for i in 0..3 {
            for j in i + 1..6 {
                let r = correlation(&columns[i], &columns[j]);
                if r.abs() > most.0.abs() {
                    most = (r, names[i], names[j]);
                }
            }
        }
        let sigma = (columns[0].len() as f64).sqrt();
        println!(
            "seed {seed:#x}: the largest correlation of 12 is {:+.4} ({:+.2} sigma), {} with {}",
            most.0,
            most.0 * sigma,
            most.1,
            most.2
        );
        assert!((most.0 * sigma).abs() < 4.0, "seed {seed:#x}: {most:?}");
    }
}

#[test]
fn the_observer_is_told_of_every_birth_that_is_counted() {
    let mut missed = Vec::new();
    for (what, text) in [
        (
            "soft",
            "rate = 1e6\ngamma = 6\nradius_min = 0.3\npressure = 0.001",
        ),
        (
            "too high",
            "rate = 3000\ngamma = 6\nradius_min = 0.15\npressure = 0.001",
        ),
        (
            "too high, crowds",
            "rate = 1e6\ngamma = 6\nradius_min = 0.15\npressure = 0.001",
        ),
        (
            "too loud",
            "rate = 30000\nradius_min = 3\npressure = 8\nbeta = 0.1\nrise_factor = 0",
        ),
        (
            "too loud, crowds",
            "rate = 1e6\nlaw = \"flat\"\nradius_min = 3\nradius_max = 20\nclasses = 10\npressure = 8\nbeta = 0.1\nrise_factor = 0",
        ),
    ] {
        let mut player = desk(
            &scene(&format!("water = {{ {} }}", text.replace('\n', ", "))),
            HZ,
            1,
            Output::Raw,
        );
        let (mut births, mut too_high) = (0, 0);
        watch(&mut *player, HZ as usize / 4, |sound| {
            births += sound.births;
            too_high += sound.births * u64::from(sound.path == SoundPath::TooHigh);
        });
        let stats = player.stats();
        println!(
            "{what}: {births} births seen, {} counted; too high {too_high} and {}; {} overloads",
            stats.births, stats.too_high, stats.overloads
        );
        if (births, too_high) != (stats.births, stats.too_high) {
            missed.push(what);
        }
    }
    assert!(missed.is_empty(), "not all are told: {missed:?}");
}

/// A board with room for few births.
#[derive(Clone, Copy, Debug)]
struct Small;

impl Profile for Small {
    const NAME: &'static str = "small";
    const VOICES: usize = 32;
    const LIMITS: Limits = limits([3e4; 2], [64; 2], 64);
    const BIRTHS_PER_BLOCK: u32 = 25;
    type Voices = [Voice; 32];
    const IDLE: Self::Voices = [Voice::IDLE; 32];
    type Update = Update<[population::Crowd; 1]>;
    fn update() -> Self::Update {
        Update::new()
    }
    type Cloud = <F411 as Profile>::Cloud;
    const CLOUD: Self::Cloud = F411::CLOUD;
    type Keeper = <F411 as Profile>::Keeper;
    const KEEPER: Self::Keeper = F411::KEEPER;
}

#[test]
fn no_block_has_more_births_than_its_bound_and_the_rest_is_late_but_born() {
    // 20 a block on average: one in ten blocks has more than 25.
    let text = "[water]\nrate = 30000\nlaw = \"flat\"\npressure = 0.0005\nalpha = 0";
    let mut player = Instrument::<Small>::new(&scene(text), HZ, 1, Output::Raw);
    let blocks = 10 * HZ as usize / BLOCK;
    let mut counts = vec![0; blocks];
    let block = BLOCK as f64 / f64::from(HZ);
    tally(&mut player, blocks * BLOCK, |time, _| {
        counts[(time / block + 1e-6) as usize] += 1;
    });
    let most = counts.iter().max().expect("blocks");
    let full = counts.iter().filter(|count| *count == most).count();
    let births: u64 = counts.iter().sum();
    let part = births as f64 / (30_000.0 * 10.0);
    let late = Player::stats(&player).late;
    println!(
        "up to {most} births a block ({full} of {blocks} are full), {part:.4} of the wanted rate, {late} late"
    );
    assert_eq!(*most, 25);
    assert!(late > 0);
    // A late birth waits, and its class with it: little is lost.
    assert!((0.98..1.0).contains(&part), "{part}");
}

#[test]
fn a_board_has_its_most_births_and_no_more_and_is_never_late() {
    for board in [Board::F411, Board::F407, Board::H743, Board::Desk] {
        // No class a crowd: every birth counts against the bound of a block.
        let text = "[water]\nrate = 1000000\nlaw = \"flat\"\nclasses = 64\nradius_min = 0.2\npressure = 0.0005\nalpha = 0";
        let mut player = board.player(&scene(text), HZ, 1, Output::Raw);
        let mut out = [Frame::ZERO; TICK];
        // The desk's minute would take longer than all others together.
        let seconds = if board == Board::Desk { 2 } else { 60 };
        let ticks = seconds * HZ as usize / TICK;
        for _ in 0..ticks {
            player.render(&mut out);
        }
        let stats = player.stats();
        let seconds = (ticks * TICK) as f64 / f64::from(HZ);
        let off = sigmas(
            stats.births as f64,
            f64::from(board.limits().alone.rate) * seconds,
        );
        println!(
            "{}: {} births in {seconds} s ({off:+.2} sigma), {} late, {} overloads",
            board.name(),
            stats.births,
            stats.late,
            stats.overloads
        );
        assert!(off.abs() < 4.0, "{}: {off:+.2} sigma", board.name());
        assert_eq!((stats.late, stats.overloads), (0, 0), "{}", board.name());
    }
}
