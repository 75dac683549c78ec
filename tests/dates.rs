//! Work that takes longer than a tick has a date: what it changes is heard from a fixed frame on, on every board.

mod common;

use common::{desk, scene, with};
use freshet::control::Control;
use freshet::mix::Output;
use freshet::observer::{Birth, Observer, Path};
use freshet::param;
use freshet::profile::{F407, Profile};
use freshet::{BLOCK, Frame, Synth, TICK};
use freshet_host::board::Player;

const HZ: u32 = 48_000;
/// Classes worked out in a tick.
const SLICE: usize = 1;
/// Ticks that an old bank rings out, at 48 kHz.
const RING_OUT: usize = 80;
/// A class is born in every tick, or nearly so.
const DENSE: &str = "[water]\nrate = 256000\nlaw = \"flat\"\nclasses = 64\nradius_min = 1\nradius_max = 9\npressure = 1e-4\nrise_cutoff = 1\nrise_factor = 0.1\nbeta = 4";

/// What was born in a tick: the smallest radius and, of rising bubbles, each class's rise factor.
struct Tick {
    smallest: f32,
    rise: [f32; 64],
}

impl Observer for Tick {
    fn birth(&mut self, birth: &Birth) {
        self.smallest = self.smallest.min(birth.radius);
        if birth.path == Path::Voice {
            self.rise[usize::from(birth.class)] = birth.rise_factor;
        }
    }
}

fn tick(player: &mut dyn Player) -> Tick {
    let mut seen = Tick {
        smallest: f32::INFINITY,
        rise: [f32::NAN; 64],
    };
    player.render_observed(&mut [Frame::ZERO; TICK], &mut seen);
    seen
}

fn set(player: &mut dyn Player, index: usize, value: f32) {
    let set = player.control().set(index, value, Some(0.0));
    set.expect("in the range");
}

/// Asks for smallest radii, each at its tick; the ticks from which each is heard.
fn heard(classes: usize, requests: &[(usize, f32)]) -> Vec<usize> {
    let scene = with(scene(DENSE), "water.classes", classes as f32);
    let scene = with(scene, "water.rate", 4000.0 * classes as f32);
    let mut player = desk(&scene, HZ, 3, Output::Raw);
    let mut heard = vec![usize::MAX; requests.len()];
    for now in 0..450 {
        for (_, radius) in requests.iter().filter(|(at, _)| *at == now) {
            set(&mut *player, param::RADIUS_MIN, *radius);
        }
        let smallest = tick(&mut *player).smallest * 1e3;
        for (heard, (_, radius)) in heard.iter_mut().zip(requests) {
            if (smallest - radius).abs() < 1e-4 {
                *heard = now.min(*heard);
            }
        }
    }
    heard
}

#[test]
fn other_radii_are_heard_from_the_tick_on_in_which_the_last_class_is_worked_out() {
    for classes in [1usize, 5, 64] {
        let slices = classes.div_ceil(SLICE);
        assert_eq!(heard(classes, &[(10, 2.0)]), [10 + slices], "{classes}");
    }
}

#[test]
fn radii_asked_for_too_early_wait_for_their_turn() {
    const SLICES: usize = 64;
    let first = 10 + SLICES;
    let next = first + RING_OUT + SLICES - 1;
    // While the first are worked out, just after them, and when the old bank has just rung out.
    for second in [11, 60, first, first + RING_OUT - 1] {
        let heard = heard(64, &[(10, 2.0), (second, 3.0)]);
        assert_eq!(heard, [first, next], "asked at {second}");
    }
    let late = first + RING_OUT + 7;
    assert_eq!(heard(64, &[(10, 2.0), (late, 3.0)]), [first, late + SLICES]);
    // What was asked for last is what comes; what nobody waits for any more does not.
    let never = usize::MAX;
    let heard = heard(64, &[(10, 2.0), (30, 3.0), (50, 4.0)]);
    assert_eq!(heard, [first, never, next]);
}

#[test]
fn another_rise_factor_reaches_one_class_a_tick() {
    let scene = with(scene(DENSE), "water.rise_cutoff", 0.5);
    let mut player = desk(&scene, HZ, 3, Output::Raw);
    for _ in 0..10 {
        tick(&mut *player);
    }
    set(&mut *player, param::RISE_FACTOR, 2.0);
    for now in 0..80 {
        for (class, rise) in tick(&mut *player).rise.into_iter().enumerate() {
            let wanted = if now > class / SLICE { 2.0 } else { 0.1 };
            assert!(rise.is_nan() || rise == wanted, "tick {now}, class {class}");
        }
    }
}

#[test]
fn another_scene_moves_from_the_tick_on_in_which_its_radii_are_heard() {
    let other = with(scene(DENSE), "water.radius_min", 2.0);
    let other = with(other, "water.rate", 1000.0);
    let other = with(other, "water.law", 1.0);
    for early in [false, true] {
        let mut player = desk(&scene(DENSE), HZ, 3, Output::Raw);
        if early {
            set(&mut *player, param::RADIUS_MIN, 3.0);
        }
        for _ in 0..5 {
            tick(&mut *player);
        }
        player.control().load(&other);
        let before = player.control().get(param::RATE);
        for now in 5.. {
            let seen = tick(&mut *player).smallest;
            let control = player.control();
            // What the control path is at now is heard in the next tick.
            let moved = control.get(param::RATE) != before;
            assert_eq!(moved, control.get(param::LAW) == 1.0, "tick {now}");
            if moved {
                assert_eq!(now, if early { 64 + RING_OUT + 62 } else { 5 + 63 });
                assert!((seen - 2e-3).abs() > 1e-6, "already heard");
                let seen = tick(&mut *player).smallest;
                assert!((seen - 2e-3).abs() < 1e-6, "not yet heard");
                break;
            }
        }
        for _ in 0..188 {
            tick(&mut *player);
        }
        assert_eq!(player.control().get(param::RATE), 1000.0);
    }
    // With the radii as they are, there is nothing to wait for.
    let same = with(scene(DENSE), "water.rate", 1000.0);
    let mut player = desk(&scene(DENSE), HZ, 3, Output::Raw);
    player.control().load(&same);
    tick(&mut *player);
    assert!(player.control().get(param::RATE) < 256_000.0);
}

/// As a board does it: two updates change places between the two paths. In the ticks that `late` names, control has
/// nothing ready.
fn on_a_board(text: &str, ticks: usize, late: &[usize]) -> Vec<Frame> {
    let mut control = Control::new(&scene(text), HZ, F407::LIMITS, 5);
    let mut synth = Synth::<F407>::new(5, Output::Bits24, &control, HZ);
    let (mut one, mut two) = (F407::update(), F407::update());
    let (mut live, mut next) = (&mut one, &mut two);
    control.tick(next.as_mut());
    let mut out = Vec::new();
    for tick in 0..ticks {
        if !late.contains(&tick) {
            std::mem::swap(&mut live, &mut next);
            synth.apply(live.as_ref());
            control.tick(next.as_mut());
        }
        for _ in 0..TICK / BLOCK {
            let mut block = [Frame::ZERO; BLOCK];
            synth.render(live.as_ref(), &mut block, &mut ());
            out.extend(block);
        }
    }
    out
}

#[test]
fn a_board_that_swaps_updates_sounds_like_the_desk_and_plays_on_where_one_is_late() {
    let moving = "water = { rate = 100_000, classes = 9, beta = 1, pressure = 1e-3 }\nswell = { depth = 0.8, period = 1 }\ndrops = { rate = 20 }";
    let mut player = freshet_host::board::Board::F407.player(&scene(moving), HZ, 5, Output::Bits24);
    let mut desk = vec![Frame::ZERO; 400 * TICK];
    player.render(&mut desk);
    assert!(on_a_board(moving, 400, &[]) == desk);
    // Where nothing moves, nothing is missing.
    let steady = "water = { rate = 100_000, classes = 9, beta = 1, pressure = 1e-3 }";
    let all = on_a_board(steady, 50, &[]);
    assert!(all.iter().any(|frame| frame.left != 0));
    assert!(on_a_board(steady, 50, &[7, 8, 9, 30]) == all);
}
