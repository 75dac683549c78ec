//! Whatever is set, struck or loaded, at any rate and on any board: no panic, no overflow (the tests are built with the
//! checks on), no peak past full scale, and silence in the end. The cases are the same each time.

mod common;

use std::cell::RefCell;
use std::fmt;

use freshet::fixed::{PASCAL, reciprocal};
use freshet::mix::Output;
use freshet::param::{self, COUNT, Kind, TABLE};
use freshet::random::{Random, Stream};
use freshet::scene::{IntensityCurve, Scene};
use freshet::stats::Stats;
use freshet::voices::{Pitch, Strike};
use freshet::{Frame, TICK};
use freshet_host::board::{Board, Player};
use freshet_host::scene_file::put;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};

/// Where in its range a parameter stands, along its curve; the ends are likely.
fn position() -> impl Strategy<Value = f32> {
    prop_oneof![1 => Just(0.0f32), 1 => Just(1.0f32), 6 => 0.0f32..1.0]
}

/// The value of a parameter at a position.
fn value(index: usize, position: f32) -> f32 {
    let param = &TABLE[index];
    param.between(param.min, param.max, position)
}

/// A scene that shows only what is not as by default.
#[derive(Clone)]
struct Wild(Scene);

impl fmt::Debug for Wild {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, value) in &self.0.values {
            if *value != TABLE[*index].default {
                write!(f, "{}={value} ", TABLE[*index].path)?;
            }
        }
        for curve in &self.0.curves {
            write!(f, "{}={:?} ", TABLE[curve.param].path, curve.points)?;
        }
        Ok(())
    }
}

/// Most parameters at any value.
fn any_values() -> impl Strategy<Value = Scene> {
    vec(prop::option::weighted(0.9, position()), COUNT).prop_map(|positions| {
        let mut scene = Scene::default();
        for (index, position) in positions.iter().enumerate() {
            if let Some(position) = position {
                put(&mut scene, index, value(index, *position));
            }
        }
        scene
    })
}

/// The same, and up to three moved by the intensity.
fn any_scene() -> impl Strategy<Value = Wild> {
    let curve = (1..COUNT, vec((0.0f32..1.0, position()), 1..5));
    let limiter = prop::bool::weighted(0.8);
    (any_values(), vec(curve, 0..4), limiter).prop_map(|(mut scene, curves, limiter)| {
        put(&mut scene, param::LIMITER, f32::from(limiter));
        for (index, mut points) in curves {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points.dedup_by_key(|point| point.0);
            let points = points.iter().map(|(x, y)| (*x, value(index, *y)));
            let curve = IntensityCurve {
                param: index,
                points: points.collect(),
            };
            scene.curves.push(curve).expect("there is room");
        }
        Wild(scene)
    })
}

/// What a person, a file of events or a broken program does while it sounds.
#[derive(Clone, Debug)]
enum Event {
    Set(usize, f32, Option<f32>),
    Refused(usize, f32),
    Load(Box<Wild>),
    Strike {
        radius: f32,
        rise_factor: f32,
        at: f64,
        pressure: [f64; 2],
    },
}

fn any_set() -> impl Strategy<Value = Event> {
    let ramp = prop_oneof![Just(None), Just(Some(0.0f32)), (0.0f32..1.0).prop_map(Some)];
    (0..COUNT, position(), ramp)
        .prop_map(|(index, position, ramp)| Event::Set(index, value(index, position), ramp))
}

/// A bubble of any kind, in the next 0.2 s.
fn any_strike() -> impl Strategy<Value = Event> {
    let pressure = || prop_oneof![Just(8.0), Just(-8.0), -8.0..8.0f64];
    let bubble = (position(), 0.0f32..1.0, 0.0..0.2f64);
    (bubble, pressure(), pressure()).prop_map(|((size, rise, at), left, right)| Event::Strike {
        radius: value(param::RADIUS_MIN, size) * 1e-3,
        rise_factor: if rise < 0.3 {
            0.0
        } else {
            0.1 * 1000f32.powf(rise)
        },
        at,
        pressure: [left, right],
    })
}

fn any_event() -> impl Strategy<Value = Event> {
    let wrong = prop_oneof![
        Just(f32::NAN),
        Just(f32::INFINITY),
        Just(f32::NEG_INFINITY),
        Just(-0.25f32),
        Just(1.1e6f32)
    ];
    prop_oneof![
        6 => any_set(),
        1 => (0..COUNT, wrong).prop_map(|(index, wrong)| Event::Refused(index, wrong)),
        1 => any_scene().prop_map(|scene| Event::Load(Box::new(scene))),
        6 => any_strike(),
    ]
}

#[derive(Clone, Debug)]
struct Case {
    scene: Wild,
    rate: u32,
    seed: u64,
    board: Board,
    output: Output,
    /// Frames asked for at a time.
    piece: usize,
    /// By the part of the time that has passed.
    events: Vec<(f64, Event)>,
    /// Counters begin just before they wrap.
    old: bool,
}

fn any_case() -> impl Strategy<Value = Case> {
    let rate = prop::sample::select(vec![8_000, 22_050, 44_100, 48_000, 96_000, 192_000]);
    let boards = vec![Board::Desk, Board::F407, Board::F411, Board::H743];
    let outputs = vec![Output::Raw, Output::Bits16, Output::Bits24];
    let events = vec((0.0..1.0f64, any_event()), 0..12);
    let setting = (prop::sample::select(boards), prop::sample::select(outputs));
    let way = (1..TICK, any::<bool>());
    (any_scene(), rate, any::<u64>(), setting, way, events).prop_map(
        |(scene, rate, seed, (board, output), (piece, old), mut events)| {
            events.sort_by(|a, b| a.0.total_cmp(&b.0));
            Case {
                scene,
                rate,
                seed,
                board,
                output,
                piece,
                events,
                old,
            }
        },
    )
}

/// Runs `test` on `cases` values, the same ones each time.
fn check<S: Strategy>(
    cases: u32,
    strategy: S,
    test: impl Fn(S::Value) -> Result<(), TestCaseError>,
) {
    let config = Config {
        cases,
        failure_persistence: None,
        max_shrink_iters: 500,
        ..Config::default()
    };
    let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    match TestRunner::new_with_rng(config, random).run(&strategy, test) {
        Ok(()) => {}
        Err(TestError::Fail(reason, case)) => panic!("{reason}\nsmallest case: {case:?}"),
        Err(TestError::Abort(reason)) => panic!("{reason}"),
    }
}

fn act(player: &mut dyn Player, rate: u32, event: &Event) -> Result<(), TestCaseError> {
    match event {
        Event::Set(index, value, ramp) => {
            let set = player.control().set(*index, *value, *ramp);
            prop_assert!(set.is_ok(), "{} = {value}", TABLE[*index].path);
        }
        Event::Refused(index, value) => {
            let param = &TABLE[*index];
            let inside = (param.min..=param.max).contains(value);
            if !inside || (param.kind != Kind::Real && value.fract() != 0.0) {
                let before = player.control().get(*index);
                prop_assert!(player.control().set(*index, *value, None).is_err());
                prop_assert_eq!(before, player.control().get(*index));
            }
        }
        Event::Load(scene) => player.control().load(&scene.0),
        Event::Strike {
            radius,
            rise_factor,
            at,
            pressure,
        } => {
            let pitch = Pitch::new(*radius, *rise_factor, f64::from(rate));
            let gain = pressure.map(|pa| (pa * f64::from(1 << 28)) as i32);
            let strike = Strike::new(pitch, at * f64::from(rate), gain);
            player.strike(&strike, &mut ());
        }
    }
    Ok(())
}

fn loudest(frames: &[Frame]) -> u32 {
    let peak = |frame: &Frame| frame.left.unsigned_abs().max(frame.right.unsigned_abs());
    frames.iter().map(peak).max().unwrap_or(0)
}

/// The largest sample of the format.
fn top(output: Output) -> u32 {
    match output {
        Output::Raw => u32::MAX,
        Output::Bits16 => (1 << 15) - 1,
        Output::Bits24 => (1 << 23) - 1,
    }
}

/// Stops all births. What the intensity is about to move stays where it is.
fn stop(player: &mut dyn Player) {
    let control = player.control();
    let intensity = control.get(param::INTENSITY);
    for (index, value) in [
        (param::INTENSITY, intensity),
        (param::RATE, 0.0),
        (param::DROPS_RATE, 0.0),
        (param::CLOUD_RATE, 0.0),
        (param::CLOUD_PUSHES, 0.0),
    ] {
        control.set(index, value, Some(0.0)).expect("allowed");
    }
}

/// What all cases came to.
#[derive(Default, Debug)]
struct Totals {
    cases: u32,
    births: u64,
    stolen: u64,
    overloads: u64,
    limited: u64,
    /// Longest time to silence, s.
    silent_after: f64,
}

#[test]
fn anything_goes_and_nothing_breaks() {
    const SECONDS: f64 = 0.3;
    /// The slowest bubble, 150 mm, falls from 32 Pa to the last 16 bus units in 18 s.
    const RING: f64 = 19.0;
    let totals = RefCell::new(Totals::default());
    check(250, any_case(), |case| {
        let rate = f64::from(case.rate);
        let mut player = case
            .board
            .player(&case.scene.0, case.rate, case.seed, case.output);
        if case.old {
            let most = u64::MAX - 100;
            let stats = Stats {
                births: most,
                rising: most,
                events: most,
                stolen: most,
                unvoiced: most,
                dropped: most,
                too_high: most,
                late: most,
                overloads: most,
                limited: most,
                clipped: 0,
            };
            player.preset_counters(u64::MAX - 5_000, stats);
        }
        let before = player.stats();
        let frames = (SECONDS * rate) as usize;
        let mut piece = vec![Frame::ZERO; case.piece];
        let mut events = case.events.iter().peekable();
        let mut limiting = true;
        let mut done = 0;
        while done < frames {
            let passed = done as f64 / frames as f64;
            while let Some((_, event)) = events.next_if(|event| event.0 <= passed) {
                act(&mut *player, case.rate, event)?;
            }
            player.render(&mut piece);
            done += piece.len();
            limiting &= player.control().get(param::LIMITER) == 1.0;
            let peak = loudest(&piece);
            prop_assert!(peak <= top(case.output), "peak {peak} at frame {done}");
        }
        let stats = player.stats();
        if limiting {
            prop_assert_eq!(stats.clipped, 0);
        }

        stop(&mut *player);
        let mut tail = vec![Frame::ZERO; 4096];
        let mut rung = 0;
        while !player.is_silent() {
            player.render(&mut tail);
            rung += tail.len();
            prop_assert!((rung as f64) < RING * rate, "still rings after {RING} s");
            prop_assert!(loudest(&tail) <= top(case.output));
        }
        // The DC blocker forgets 24 times its constant, the dither and the limiter's delay take less than that.
        let settle = (24.0 * 4096.0 * (rate / 48_000.0).max(1.0)) as usize;
        for _ in 0..=settle / tail.len() {
            player.render(&mut tail);
        }
        player.render(&mut tail);
        prop_assert_eq!(loudest(&tail), 0, "no exact silence");

        let mut totals = totals.borrow_mut();
        totals.cases += 1;
        totals.births += stats.births.wrapping_sub(before.births);
        totals.stolen += stats.stolen.wrapping_sub(before.stolen);
        totals.overloads += stats.overloads.wrapping_sub(before.overloads);
        totals.limited += stats.limited.wrapping_sub(before.limited);
        totals.silent_after = totals.silent_after.max(rung as f64 / rate);
        Ok(())
    });
    println!("{:.2?}", totals.borrow());
}

/// As loud as it can be: bubbles of 4 mm and more with all that they do, or smaller ones of the population alone.
fn loud_case(big: bool) -> impl Strategy<Value = Case> {
    let loud = (0.5f32..1.0, 0.3f32..1.0);
    let strikes = vec((0.0..1.0f64, any_strike()), 0..40);
    let water = (any_values(), [(); 4].map(|()| position()));
    (water, loud, any::<u64>(), strikes).prop_map(
        move |((mut scene, positions), (pressure, rate), seed, mut events)| {
            let radius = |position: f32| match big {
                true => 4.0 + 146.0 * position.powi(3),
                false => 0.15 + 3.85 * position.powi(3),
            };
            for (index, value) in [
                (param::PRESSURE, value(param::PRESSURE, pressure)),
                (param::RATE, value(param::RATE, rate)),
                (param::RADIUS_MIN, radius(positions[0])),
                (param::RADIUS_MAX, radius(positions[1])),
                (param::ALPHA, 4.0 * positions[2]),
                (param::BETA, 3.0 * positions[3]),
                (param::DEPTH, 1.0),
                (param::DROPS_RADIUS, 20.0),
                (param::DROPS_SPREAD, 0.2),
                (param::EXCITATION, 0.0),
                (param::SWELL_DEPTH, 0.0),
                (param::LEVEL, 0.0),
            ] {
                put(&mut scene, index, value);
            }
            for (_, event) in &mut events {
                if let Event::Strike { radius, .. } = event {
                    *radius = radius.max(4e-3);
                }
            }
            if !big {
                put(&mut scene, param::RISE_FACTOR, 0.0);
                put(&mut scene, param::DROPS_RATE, 0.0);
                put(&mut scene, param::CLOUD_RATE, 0.0);
                put(&mut scene, param::CLOUD_PUSHES, 0.0);
                events.clear();
            }
            events.sort_by(|a, b| a.0.total_cmp(&b.0));
            Case {
                scene: Wild(scene),
                rate: 48_000,
                seed,
                board: Board::F407,
                output: Output::Raw,
                piece: 64,
                events,
                old: false,
            }
        },
    )
}

/// Plays 60 loud cases, whose peak and largest step from frame to frame, bus units, must be as `holds` says.
fn loud_water(big: bool, holds: impl Fn(u32, u32) -> bool) {
    let (most, overloads) = (RefCell::new(0), RefCell::new(0));
    check(60, loud_case(big), |case| {
        let scene = &case.scene.0;
        let mut player = case.board.player(scene, case.rate, case.seed, case.output);
        let mut last = Frame::ZERO;
        let mut piece = vec![Frame::ZERO; case.piece];
        let mut events = case.events.iter().peekable();
        let frames = 14_400;
        for done in (0..frames).step_by(case.piece) {
            let passed = done as f64 / frames as f64;
            while let Some((_, event)) = events.next_if(|event| event.0 <= passed) {
                act(&mut *player, case.rate, event)?;
            }
            player.render(&mut piece);
            let mut step = 0;
            for frame in &piece {
                step = step.max(frame.left.abs_diff(last.left));
                step = step.max(frame.right.abs_diff(last.right));
                last = *frame;
            }
            let peak = loudest(&piece);
            let pascal = [peak, step].map(|x| f64::from(x) / f64::from(PASCAL));
            prop_assert!(holds(peak, step), "peak, step {pascal:.1?} Pa at {done}");
            most.replace_with(|most| peak.max(*most));
        }
        overloads.replace_with(|sum| *sum + player.stats().overloads);
        Ok(())
    });
    let most = f64::from(*most.borrow()) / f64::from(PASCAL);
    println!("loudest {most:.1} Pa, {} overloads", overloads.borrow());
    assert!(most > 11.0, "it was not loud");
}

#[test]
fn the_loudest_big_bubbles_do_not_wrap_around() {
    // Sums in the audio path wrap in silence. Bubbles below 830 Hz that rise to 3.3 kHz at most move the bus, whose
    // ends are at ±32 Pa, by less than 32 Pa a sample; a wrap moves it by more.
    loud_water(true, |_, step| step < 1 << 31);
}

#[test]
fn the_loudest_small_bubbles_do_not_wrap_around() {
    // They may move it by any step. But a population keeps itself within 30 Pa, and what wraps is anywhere.
    loud_water(false, |peak, _| peak <= 30 * PASCAL as u32);
}

#[test]
fn a_reciprocal_is_the_quotient_of_64_bits() {
    let mut random = Random::new(1, Stream::Population);
    let ends = [1 << 31, (1 << 31) + 1, u32::MAX - 1, u32::MAX];
    let near =
        (0..=u32::from(u16::MAX)).flat_map(|n| [n << 16 | 0x8000_0000, n << 15 | 0xffff_0000]);
    let any = (0..1_000_000).map(|_| random.bits() | 1 << 31);
    for divisor in ends.into_iter().chain(near).chain(any) {
        let quotient = i64::MAX as u64 / u64::from(divisor);
        assert_eq!(u64::from(reciprocal(divisor)), quotient, "{divisor:#x}");
    }
}
