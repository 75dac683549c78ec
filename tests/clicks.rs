//! No click on births, steals, parameter jumps and changes of scene.
//!
//! How a click is told from a birth. A bubble begins at rest and within one sample: its slope jumps, and that is a
//! broadband sound. But its waveform is known. So every birth that the core reports is rendered in f64 and subtracted,
//! together with the level's line. What remains is what the core did beside births: rounding, stolen
//! voices that fade, old resonators that ring out faster. All bubbles here are of 4 mm and more, below 830 Hz, and rise
//! to 3.3 kHz at most; so the remainder has no business above 6 kHz. The figure is the loudest sample of the remainder's
//! band above 6 kHz, in dB of the loudest sample of the sound. A jump by -60 dB of that loudest sample shows as -67 dB
//! there; such jumps are planted at random into the same remainders and must be found, at their places.
//!
//! Where the sound is filtered after the bus (tone), nothing can be subtracted; there births stop before the change,
//! and the band above 6 kHz of the ringing itself is watched.

mod common;

use std::collections::HashMap;

use common::high_band::HighBand;
use common::{db, pascal, scene, with};
use freshet::bubble::Bubble;
use freshet::control::Control;
use freshet::mix::{GLIDE, Output};
use freshet::param::{self, TABLE};
use freshet::random::{Random, Stream};
use freshet::scene::Scene;
use freshet::stats::Stats;
use freshet::{Frame, TICK};
use freshet_host::births::{Births, Sound, SoundPath};
use freshet_host::board::Board;
use freshet_host::reference;

/// Sound in two ears, Pa.
type Stereo = Vec<[f64; 2]>;

/// No click: nothing above 6 kHz that is louder than this, dB of the loudest sample.
const CLICK_DB: f64 = -80.0;
/// A jump that must be found, dB of the loudest sample.
const PLANTED_DB: f64 = -60.0;

fn peak(x: &[[f64; 2]]) -> f64 {
    x.iter().flatten().fold(0.0, |max, x| x.abs().max(max))
}

/// What was heard, and what should have been.
struct Take {
    rate: u32,
    sound: Stereo,
    wanted: Stereo,
    stats: Stats,
}

/// Something done at a tick.
type Move<'a> = (usize, Box<dyn Fn(&mut Control) + 'a>);

fn at<'a>(tick: usize, act: impl Fn(&mut Control) + 'a) -> Move<'a> {
    (tick, Box::new(act))
}

impl Take {
    /// Plays `ticks` of `scene` and does the `moves`.
    fn new(board: Board, scene: &Scene, rate: u32, ticks: usize, moves: &[Move<'_>]) -> Self {
        let mut player = board.player(scene, rate, 11, Output::Raw);
        let mut births = Births::new(rate);
        let mut frames = vec![Frame::ZERO; ticks * TICK];
        let mut gains = Vec::with_capacity(frames.len());
        // What a tick computes acts in the next one; from there the level moves along a line.
        let level = |control: &Control| 10f64.powf(f64::from(control.get(param::LEVEL)) / 20.0);
        let mut gain = level(player.control());
        let (mut target, mut step, mut left) = (gain, 0.0, 0);
        for (tick, stretch) in frames.chunks_mut(TICK).enumerate() {
            let to = level(player.control());
            for (_, act) in moves.iter().filter(|(at, _)| *at == tick) {
                act(player.control());
            }
            player.render_observed(stretch, &mut births);
            if to != target {
                (target, step, left) = (to, (to - gain) / GLIDE as f64, GLIDE);
            }
            gains.extend((0..TICK).map(|_| {
                if left > 0 {
                    left -= 1;
                    gain = if left == 0 { target } else { gain + step };
                }
                gain
            }));
        }
        let mut wanted = rendered(&births.sounds, rate, frames.len());
        for (frame, gain) in wanted.iter_mut().zip(gains) {
            *frame = frame.map(|x| gain * x);
        }
        let stats = player.stats();
        assert_eq!(stats.overloads, 0, "too loud for a reference");
        Self {
            rate,
            sound: pascal(&frames),
            wanted,
            stats,
        }
    }

    fn remainder(&self) -> Stereo {
        let pairs = self.sound.iter().zip(&self.wanted);
        pairs
            .map(|(sound, wanted)| [sound[0] - wanted[0], sound[1] - wanted[1]])
            .collect()
    }

    /// The figure: the loudest sample above 6 kHz beside births, dB of the loudest sample of all.
    fn click_db(&self) -> f64 {
        let remainder = self.remainder();
        let loudest = HighBand::new(self.rate).loudest(&remainder, 0..remainder.len());
        db(loudest.size / peak(&self.sound))
    }

    /// The same; where it is below `limit`, jumps of `planted` dB at random places are found there.
    fn checked_click_db(&self, planted: f64, limit: f64) -> f64 {
        let figure = self.click_db();
        if figure < limit {
            let weakest = find_planted(&self.remainder(), peak(&self.sound), self.rate, planted);
            assert!(weakest > limit + 6.0, "the test is deaf: {weakest:.1} dB");
        }
        figure
    }
}

/// Plants jumps of `planted` dB of `peak` into `remainder`, one at a time; the figure of the weakest.
fn find_planted(remainder: &[[f64; 2]], peak: f64, rate: u32, planted: f64) -> f64 {
    let band = HighBand::new(rate);
    let mut random = Random::new(5, Stream::Population);
    let reach = 2 * band.delay();
    let mut weakest = f64::INFINITY;
    for _ in 0..100 {
        let room = (remainder.len() - 4 * reach) as f64;
        let place = 2 * reach + (f64::from(random.uniform()) * room) as usize;
        let ear = usize::from(random.uniform() < 0.5);
        let jump = peak * 10f64.powf(planted / 20.0);
        let mut part = remainder[place - 2 * reach..place + 2 * reach].to_vec();
        for frame in &mut part[2 * reach..] {
            frame[ear] += jump;
        }
        let found = band.loudest(&part, reach..3 * reach);
        assert!(
            found.frame.abs_diff(2 * reach) <= 4,
            "found at {} instead of {}",
            found.frame,
            2 * reach
        );
        weakest = weakest.min(db(found.size / peak));
    }
    weakest
}

/// All `sounds` in f64. A class's bubbles are the impulse responses of one rotation, so they are summed as such.
fn rendered(sounds: &[Sound], rate: u32, frames: usize) -> Stereo {
    let hertz = f64::from(rate);
    let mut out = vec![[0.0; 2]; frames];
    let mut classes: HashMap<u64, Vec<&Sound>> = HashMap::new();
    for sound in sounds {
        match sound.path {
            SoundPath::Class | SoundPath::Crowd => {
                let class = classes.entry(sound.radius.to_bits());
                class.or_default().push(sound);
            }
            _ => reference::add(sound, hertz, &mut out),
        }
    }
    for mut class in classes.into_values() {
        class.sort_by(|a, b| a.time.total_cmp(&b.time));
        let bubble = Bubble::new(class[0].radius);
        let (omega, beta) = (bubble.omega_d(), bubble.beta);
        let turn = polar((-beta / hertz).exp(), omega / hertz);
        let mut ears = [[0.0f64; 2]; 2];
        let mut births = class.into_iter().peekable();
        for (n, frame) in out.iter_mut().enumerate() {
            ears = ears.map(|[re, im]| [re * turn[0] - im * turn[1], re * turn[1] + im * turn[0]]);
            let now = n as f64 / hertz;
            while let Some(birth) = births.next_if(|birth| birth.time + 2e-12 < now) {
                let age = now - birth.time;
                for (ear, state) in ears.iter_mut().enumerate() {
                    let size = birth.amplitude[ear] * (-beta * age).exp();
                    let [re, im] = polar(size, omega * age + birth.phase[ear]);
                    *state = [state[0] + re, state[1] + im];
                }
            }
            frame[0] += ears[0][1];
            frame[1] += ears[1][1];
        }
    }
    out
}

fn polar(size: f64, angle: f64) -> [f64; 2] {
    [size * angle.cos(), size * angle.sin()]
}

/// Big bubbles that do all that bubbles can do.
const BASE: &str = r#"
[water]
rate = 300
radius_min = 4
radius_max = 20
classes = 12
alpha = 0.5
beta = 4
rise_cutoff = 0.5
rise_factor = 0.3
pressure = 0.02
[drops]
rate = 8
radius = 6
spread = 0.05
bubbles = 1.5
pressure = 0.1
"#;

#[test]
fn births_of_every_kind() {
    // Few and many, gathered or not, with voices or without, in crowds.
    for (rate, pressure, classes, cutoff) in [
        (30.0, 0.1, 12.0, 0.5),
        (3e3, 0.02, 12.0, 0.5),
        (3e3, 0.02, 2.0, 1.0),
        (1e5, 2e-3, 12.0, 0.99),
        (1e6, 2e-4, 2.0, 0.9999),
        (1e6, 2e-4, 12.0, 1.0),
    ] {
        let scene = with(scene(BASE), "water.rate", rate);
        let scene = with(scene, "water.pressure", pressure);
        let scene = with(scene, "water.classes", classes);
        let scene = with(scene, "water.rise_cutoff", cutoff);
        let take = Take::new(Board::Desk, &scene, 48_000, 94, &[]);
        let figure = take.checked_click_db(PLANTED_DB, CLICK_DB);
        let Stats { births, rising, .. } = take.stats;
        println!("{births:>8} births, {rising:>6} of them rising: {figure:.1} dB");
        assert!(figure < CLICK_DB, "{figure:.1} dB");
    }
}

#[test]
fn steals() {
    // A board of few voices, and more rising bubbles than it has room for.
    for (rate, beta) in [(400.0, 1.0), (1500.0, 3.0)] {
        let scene = with(scene(BASE), "water.rate", rate);
        let scene = with(scene, "water.rise_cutoff", 0.0);
        let scene = with(scene, "water.beta", beta);
        let take = Take::new(Board::F411, &scene, 48_000, 94, &[]);
        let figure = take.checked_click_db(PLANTED_DB, CLICK_DB);
        let remainder = peak(&take.remainder());
        let missing = db(remainder / peak(&take.sound));
        let Stats {
            stolen, unvoiced, ..
        } = take.stats;
        println!(
            "{stolen} stolen, {unvoiced} refused: {figure:.1} dB; what was stolen is {missing:.1} dB"
        );
        assert!(stolen > 50 && missing > -40.0);
        assert!(figure < CLICK_DB, "{figure:.1} dB");
    }
}

/// What a jump of this parameter wants around it, so that it matters and stays within what the bus takes.
fn surroundings(path: &str) -> &'static [(&'static str, f32)] {
    match path {
        "water.rate" => &[("water.pressure", 1e-4), ("water.rise_cutoff", 0.9999)],
        "water.pressure" => &[("water.rate", 10.0)],
        "water.gamma" => &[("water.law", 1.0)],
        "water.beta" | "water.depth" | "water.alpha" => &[("water.rate", 100.0)],
        "drops.rate" | "drops.bubbles" => &[("drops.pressure", 0.02)],
        "mix.level" => &[("water.pressure", 2e-3), ("drops.pressure", 1e-2)],
        _ if path.starts_with("swell") => &[("swell.depth", 0.8), ("swell.period", 0.3)],
        _ if path.starts_with("water.weight") => &[("water.law", 2.0)],
        _ => &[],
    }
}

/// From one end of the range of `params` to the other and back, in the table's time and at once.
fn jumps(params: &[usize], ends: [f32; 2]) -> Take {
    let first = &TABLE[params[0]];
    let mut scene = scene(BASE);
    for (path, value) in surroundings(first.path) {
        scene = with(scene, path, *value);
    }
    for index in params {
        scene = with(scene, TABLE[*index].path, ends[0]);
    }
    let rest = 12;
    let ramp = (first.ramp * 48_000.0 / TICK as f32) as usize;
    let set = |value: f32, ramp: Option<f32>| {
        move |control: &mut Control| {
            for index in params {
                control.set(*index, value, ramp).expect("in the range");
            }
        }
    };
    let moves = [
        at(rest, set(ends[1], None)),
        at(2 * rest + ramp, set(ends[0], None)),
        at(3 * rest + 2 * ramp, set(ends[1], Some(0.0))),
        at(4 * rest + 2 * ramp, set(ends[0], Some(0.0))),
    ];
    Take::new(Board::Desk, &scene, 48_000, 6 * rest + 2 * ramp, &moves)
}

#[test]
fn jumps_of_every_parameter() {
    let bank = [param::RADIUS_MIN, param::RADIUS_MAX, param::CLASSES];
    let mut worst = f64::NEG_INFINITY;
    for (index, param) in TABLE.iter().enumerate().take(param::WEIGHT) {
        // A bank of other radii, tone and limiter are below; the cloud is in tests/cloud.rs. the cloud
        let elsewhere = [param::TONE, param::LIMITER].contains(&index);
        if bank.contains(&index) || elsewhere || param.path.starts_with("cloud") {
            continue;
        }
        let take = jumps(&[index], [param.min, param.max]);
        let figure = take.checked_click_db(PLANTED_DB, CLICK_DB);
        println!(
            "{:20} {figure:.1} dB, {} births",
            param.path, take.stats.births
        );
        worst = worst.max(figure);
    }
    let weights: Vec<usize> = (param::WEIGHT..param::COUNT).step_by(2).collect();
    let figure = jumps(&weights, [0.0, 1.0]).checked_click_db(PLANTED_DB, CLICK_DB);
    println!("{:20} {figure:.1} dB", "every other weight");
    worst = worst.max(figure);
    assert!(worst < CLICK_DB, "{worst:.1} dB");
}

/// From one population to another and, after `gap` ticks, to a third. Figure, and how loud what rang out too fast is.
fn retuned(rate: u32, gap: usize, change: impl Fn(&mut Control, usize)) -> [f64; 2] {
    let scene = with(scene(BASE), "water.rise_factor", 0.0);
    let moves = [
        at(30, |control: &mut Control| change(control, 0)),
        at(30 + gap, |control: &mut Control| change(control, 1)),
    ];
    let ticks = 60 + gap + (rate / 2) as usize / TICK;
    let take = Take::new(Board::Desk, &scene, rate, ticks, &moves);
    let figure = take.checked_click_db(PLANTED_DB, CLICK_DB);
    [figure, db(peak(&take.remainder()) / peak(&take.sound))]
}

#[test]
fn other_radii_at_every_sample_rate() {
    let mut worst = f64::NEG_INFINITY;
    for rate in [48_000, 96_000, 192_000] {
        for (index, values) in [
            (param::RADIUS_MIN, [8.0, 5.0]),
            (param::RADIUS_MAX, [100.0, 10.0]),
            (param::CLASSES, [64.0, 1.0]),
        ] {
            for gap in [5, 60] {
                let change = |control: &mut Control, n: usize| {
                    control.set(index, values[n], None).expect("in the range");
                };
                let [figure, early] = retuned(rate, gap, change);
                println!(
                    "{rate:>6} Hz, {:16} twice in {gap:>2} ticks: {figure:.1} dB; what rings out early is {early:.1} dB",
                    TABLE[index].path
                );
                worst = worst.max(figure);
            }
        }
    }
    assert!(worst < CLICK_DB, "{worst:.1} dB");
}

#[test]
fn other_scenes() {
    let near = "[water]\nrate = 40\nradius_min = 5\nradius_max = 150\nalpha = 0\npressure = 0.1\nrise_factor = 1\n[mix]\nlevel = -12";
    let far = "[water]\nrate = 5000\nradius_min = 4\nradius_max = 9\nclasses = 64\nlaw = \"flat\"\nbeta = 2\npressure = 1e-3\n[swell]\ndepth = 1\nperiod = 1\n[drops]\nrate = 5\nradius = 10\n[mix]\nlevel = 12\nwidth = 0.2";
    let all = [scene(near), scene(far), scene(BASE)];
    let mut worst = f64::NEG_INFINITY;
    for rate in [48_000, 96_000] {
        // Some come while the one before is still on its way.
        for gaps in [[60, 60, 60, 60], [10, 60, 1, 5]] {
            let mut tick = 40;
            let mut moves = Vec::new();
            for (n, gap) in gaps.into_iter().enumerate() {
                let scene = &all[n % 3];
                moves.push(at(tick, move |control: &mut Control| control.load(scene)));
                tick += gap;
            }
            let take = Take::new(Board::Desk, &all[2], rate, tick + 180, &moves);
            let figure = take.checked_click_db(PLANTED_DB, CLICK_DB);
            println!("{rate:>6} Hz, {gaps:?} ticks apart: {figure:.1} dB");
            worst = worst.max(figure);
        }
    }
    assert!(worst < CLICK_DB, "{worst:.1} dB");
}

/// Big bubbles ring and none is born: `change` acts on the ringing. The output in parts of full scale, from a few
/// ticks before the change.
fn ringing(output: Output, before: Option<(usize, f32)>, change: impl Fn(&mut Control)) -> Stereo {
    let mut scene = with(scene(BASE), "water.radius_min", 15.0);
    scene = with(scene, "water.radius_max", 60.0);
    scene = with(scene, "water.pressure", 2e-3);
    scene = with(scene, "drops.pressure", 1e-2);
    if let Some((index, value)) = before {
        scene = with(scene, TABLE[index].path, value);
    }
    let mut player = Board::Desk.player(&scene, 48_000, 11, output);
    let mut frames = vec![Frame::ZERO; 360 * TICK];
    let unit = match output {
        Output::Raw => 67_108_864.0,
        Output::Bits16 => 32_768.0,
        Output::Bits24 => 8_388_608.0,
    };
    for (tick, stretch) in frames.chunks_mut(TICK).enumerate() {
        match tick {
            120 => {
                for index in [param::RATE, param::DROPS_RATE] {
                    let set = player.control().set(index, 0.0, Some(0.0));
                    set.expect("in the range");
                }
            }
            200 => change(player.control()),
            _ => {}
        }
        player.render(stretch);
    }
    assert_eq!(player.stats().limited, 0, "the limiter must not act");
    // A drop's last bubble comes up to 0.3 s after it.
    frames[180 * TICK..]
        .iter()
        .map(|frame| [frame.left, frame.right].map(|x| f64::from(x) / unit))
        .collect()
}

#[test]
fn tone_and_level_while_bubbles_ring() {
    // A gain that moves along a line over 1 024 frames has two corners. For a signal of size 1 and a change by 1 the slope
    // jumps by 1/1024, of which 0.3 is above 6 kHz: -71 dB; of a bubble that swings half as fast again. A jump by -45 dB shows as -52 dB.
    const LINE_DB: f64 = -64.0;
    let band = HighBand::new(48_000);
    let mut worst = f64::NEG_INFINITY;
    for (index, ends) in [
        (param::TONE, [-24.0, 24.0]),
        (param::TONE, [24.0, -24.0]),
        (param::LEVEL, [-80.0, 12.0]),
        (param::LEVEL, [12.0, -80.0]),
    ] {
        for ramp in [None, Some(0.0)] {
            let sound = ringing(Output::Bits24, Some((index, ends[0])), |control| {
                control.set(index, ends[1], ramp).expect("in the range");
            });
            let peak = peak(&sound);
            // This stretch begins in the middle of the sound.
            let loudest = band.loudest(&sound, band.delay()..sound.len());
            let figure = db(loudest.size / peak);
            println!(
                "{} from {} to {} dB, ramp {ramp:?}: {figure:.1} dB",
                TABLE[index].path, ends[0], ends[1]
            );
            if figure < LINE_DB {
                let planted = find_planted(&sound, peak, 48_000, -45.0);
                assert!(planted > LINE_DB + 6.0, "the test is deaf: {planted:.1} dB");
            }
            worst = worst.max(figure);
        }
    }
    assert!(worst < LINE_DB, "{worst:.1} dB");
}

#[test]
fn a_limiter_with_nothing_to_do_is_switched_in_silence() {
    let on = ringing(Output::Bits24, None, |_| {});
    let off = ringing(Output::Bits24, None, |control| {
        control.set(param::LIMITER, 0.0, None).expect("a choice");
    });
    assert!(on == off);
}
