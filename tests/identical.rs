//! The same samples, whoever asks, how often, in what stretches, on what board and after how long.
//!
//! This file is run under three profiles: optimised with checks, optimised without, and not optimised at all.

mod common;

use common::{hash, play, scene};
use freshet::bubble::Bubble;
use freshet::mix::Output;
use freshet::observer::{Birth, Crowd, Observer};
use freshet::param;
use freshet::population;
use freshet::profile::{F411, Limits, Profile, limits};
use freshet::stats::Stats;
use freshet::voices::{Pitch, Strike, Voice};
use freshet::{Frame, Instrument, TICK, Update};
use freshet_host::births::Births;
use freshet_host::board::{Board, Player};

const HZ: u32 = 48_000;
const BOARDS: [Board; 4] = [Board::Desk, Board::F407, Board::F411, Board::H743];

/// A crowd, dense classes, sparse ones, rising bubbles, waves, drops and a cloud.
const EVERYTHING: &str = r#"
[water]
rate = 150_000
radius_min = 0.25
radius_max = 12
classes = 24
gamma = 4
pressure = 0.005
rise_cutoff = 0.9
rise_factor = 0.5
[swell]
depth = 0.6
period = 1
fizz = 1
[drops]
rate = 12
[cloud]
rate = 100
bubbles = 40
pushes = 300
split = 0.5
drift = 0.3
[mix]
tone = 3
"#;

fn set(player: &mut dyn Player, path: &str, value: f32, ramp: Option<f32>) {
    let index = param::index_of(path).expect("in the table");
    let control = player.control();
    control.set(index, value, ramp).expect("allowed");
}

/// What a person does while [`EVERYTHING`] plays, each at its frame: none is the beginning of a block or a tick.
fn hands(player: &mut dyn Player, frame: usize) {
    match frame {
        5_003 => set(player, "water.rate", 9_000.0, None),
        7_001 => set(player, "water.radius_min", 0.6, None),
        11_111 => {
            let pitch = Pitch::new(0.004, 0.3, f64::from(HZ));
            let strike = Strike::new(pitch, 100.25, [1 << 25, 1 << 26]);
            player.strike(&strike, &mut ());
        }
        13_000 => player.control().load(&scene(
            "[water]\nrate = 300\npressure = 0.05\n[mix]\nlevel = 20",
        )),
        19_999 => set(player, "mix.limiter", 0.0, None),
        _ => {}
    }
}

const MOMENTS: [usize; 5] = [5_003, 7_001, 11_111, 13_000, 19_999];

/// Half a second of [`EVERYTHING`] under [`hands`], asked for in stretches of the lengths that `lengths` repeats.
fn in_stretches(board: Board, output: Output, lengths: &[usize]) -> Vec<Frame> {
    let mut player = board.player(&scene(EVERYTHING), HZ, 11, output);
    let mut out = vec![Frame::ZERO; 24_000];
    let mut lengths = lengths.iter().cycle();
    let mut at = 0;
    while at < out.len() {
        let next = MOMENTS.into_iter().find(|frame| *frame > at);
        let end = next.unwrap_or(out.len());
        let n = (end - at).min(*lengths.next().expect("a cycle"));
        player.render(&mut out[at..at + n]);
        at += n;
        hands(&mut *player, at);
    }
    let stats = player.stats();
    assert!(stats.rising > 0 && stats.events > 1, "{stats:?}");
    out
}

#[test]
fn nobody_hears_how_many_frames_are_asked_for_at_a_time() {
    for (board, output) in [(Board::Desk, Output::Raw), (Board::F411, Output::Bits16)] {
        let whole = in_stretches(board, output, &[usize::MAX]);
        let loudest = whole.iter().map(|frame| frame.left.abs()).max();
        assert!(loudest > Some(1000), "too soft to tell");
        for lengths in [
            &[1][..],
            &[32],
            &[480],
            &[4096],
            &[31],
            &[TICK],
            &[0, 1, 63, 7, 1000, 33],
        ] {
            let sound = in_stretches(board, output, lengths);
            let first = whole.iter().zip(&sound).position(|(a, b)| a != b);
            assert_eq!(
                first,
                None,
                "{}, stretches of {lengths:?} part here",
                board.name()
            );
        }
        println!("{}, {output:?}: {:#018x}", board.name(), hash(&whole));
    }
}

/// A scene for a hash of two seconds.
struct Golden {
    name: &'static str,
    toml: &'static str,
    board: Board,
    rate: u32,
    seed: u64,
    output: Output,
}

const GOLDEN: [Golden; 7] = [
    Golden {
        name: "drips that rise",
        toml: r#"
            water = { rate = 40, rise_cutoff = 0.4, rise_factor = 3, pressure = 0.3, radius_min = 1 }
            drops = { rate = 6, regularity = 0.5 }
        "#,
        board: Board::Desk,
        rate: 48_000,
        seed: 1,
        output: Output::Bits24,
    },
    Golden {
        name: "everything on the bus",
        toml: EVERYTHING,
        board: Board::Desk,
        rate: 44_100,
        seed: 0x0123_4567_89ab_cdef,
        output: Output::Raw,
    },
    Golden {
        name: "stream with more rising bubbles than voices",
        toml: r#"
            water = { rate = 20_000, gamma = 1, rise_cutoff = 0.2, rise_factor = 0.2, classes = 30, pressure = 0.005 }
            mix = { level = 6, tone = -6 }
        "#,
        board: Board::F407,
        rate: 48_000,
        seed: 2,
        output: Output::Bits24,
    },
    Golden {
        name: "waves of foam, at the most births a second",
        toml: r#"
            water = { rate = 1e6, gamma = 1, alpha = 0.5, pressure = 0.02, classes = 20 }
            swell = { depth = 0.9, period = 0.7, fizz = 2 }
        "#,
        board: Board::F411,
        rate: 48_000,
        seed: u64::MAX,
        output: Output::Bits16,
    },
    Golden {
        name: "two crowds of entrained bubbles, held down",
        toml: r#"
            water = { rate = 400_000, law = "custom", weight = [1, 0.5, 0, 0.01], classes = 5, excitation = "entrainment" }
            mix = { level = 6, width = 0.3 }
        "#,
        board: Board::H743,
        rate: 48_000,
        seed: 3,
        output: Output::Bits24,
    },
    Golden {
        name: "huge bubbles at a high rate",
        toml: r#"
            water = { rate = 300, radius_min = 10, radius_max = 150, gamma = 0, alpha = 0.5, beta = 3, pressure = 0.02 }
            mix = { limiter = "off" }
        "#,
        board: Board::H743,
        rate: 96_000,
        seed: 4,
        output: Output::Bits24,
    },
    Golden {
        name: "bubbles that hear each other and break",
        toml: r#"
            water = { rate = 0 }
            cloud = { rate = 100, bubbles = 128, spacing = 2.5, split = 0.4, drift = 0.5, pushes = 900, pressure = 0.3 }
        "#,
        board: Board::F407,
        rate: 48_000,
        seed: 5,
        output: Output::Bits24,
    },
];

/// Change these only when the sound is meant to change: then paste what the test prints.
const HASHES: [u64; GOLDEN.len()] = [
    0x42898e62b14470ee, // desk, drips that rise
    0x72a128828466b82e, // desk, everything on the bus
    0xab2776c3b3c27489, // f407, stream with more rising bubbles than voices
    0xdd3c7fc002bd578a, // f411, waves of foam, at the most births a second
    0xa52d0d662516a566, // h743, two crowds of entrained bubbles, held down
    0x88ae7c1e7b8a44d4, // h743, huge bubbles at a high rate
    0x9865edd4426c8be2, // f407, bubbles that hear each other and break
];

#[test]
fn the_sound_is_the_one_it_was() {
    let mut hashes = Vec::new();
    for row in &GOLDEN {
        let mut player = row
            .board
            .player(&scene(row.toml), row.rate, row.seed, row.output);
        let second = row.rate as usize;
        let mut sound = play(&mut *player, second, &mut ());
        // A hand at the tone, and other radii.
        set(&mut *player, "mix.tone", 2.0, None);
        set(&mut *player, "water.radius_max", 20.0, None);
        sound.extend(play(&mut *player, second, &mut ()));
        let loudest = sound.iter().map(|frame| frame.left.abs()).max();
        println!(
            "{}, {}: loudest {loudest:?}, {:?}",
            row.board.name(),
            row.name,
            player.stats()
        );
        assert!(loudest > Some(300), "{} is too soft to tell", row.name);
        hashes.push(hash(&sound));
    }
    let table: String = (hashes.iter().zip(&GOLDEN))
        .map(|(hash, row)| format!("    {hash:#018x}, // {}, {}\n", row.board.name(), row.name))
        .collect();
    println!("const HASHES: [u64; GOLDEN.len()] = [\n{table}];");
    assert_eq!(hashes, HASHES, "paste the table above if that is meant");
}

fn seconds(board: Board, toml: &str, seed: u64, output: Output, seconds: f64) -> Vec<Frame> {
    let mut player = board.player(&scene(toml), HZ, seed, output);
    play(&mut *player, (seconds * f64::from(HZ)) as usize, &mut ())
}

#[test]
fn a_seed_is_a_sound_and_another_seed_is_another() {
    for toml in [
        EVERYTHING,
        "water = { rate = 200 }",
        "water = { rate = 0 }\ndrops = { rate = 20 }",
    ] {
        let seeds = [0, 1, 2, 1 << 32, 0xd134_2543_de82_ef95, u64::MAX];
        let sounds = seeds.map(|seed| seconds(Board::Desk, toml, seed, Output::Raw, 0.5));
        for (i, one) in sounds.iter().enumerate() {
            assert!(
                *one == seconds(Board::Desk, toml, seeds[i], Output::Raw, 0.5),
                "seed {:#x} twice",
                seeds[i]
            );
            for (j, two) in sounds.iter().enumerate().skip(i + 1) {
                assert!(one != two, "{:#x} and {:#x} are one", seeds[i], seeds[j]);
            }
        }
    }
}

#[test]
fn as_long_as_there_is_room_every_board_sounds_the_same() {
    let tame = r#"
        water = { classes = 22, rate = 80_000, gamma = 5, radius_min = 0.4, radius_max = 8, pressure = 0.01, rise_cutoff = 0.99, beta = 20 }
        swell = { depth = 0.5, period = 1 }
        drops = { rate = 6, bubbles = 2 }
    "#;
    let mut sounds = Vec::new();
    for board in BOARDS {
        let mut player = board.player(&scene(tame), HZ, 5, Output::Bits24);
        let mut most = 0;
        let mut sound = vec![Frame::ZERO; 96_000];
        for stretch in sound.chunks_mut(TICK) {
            player.render(stretch);
            most = most.max(player.voices());
        }
        let stats = player.stats();
        println!(
            "{}: {:#018x}, up to {most} voices, {stats:?}",
            board.name(),
            hash(&sound)
        );
        assert!(stats.rising > 10, "nothing rises");
        assert_eq!(
            stats.stolen + stats.unvoiced + stats.dropped + stats.late,
            0
        );
        sounds.push(sound);
    }
    for (board, sound) in BOARDS.iter().zip(&sounds) {
        assert!(
            *sound == sounds[0],
            "{} does not sound like the desk",
            board.name()
        );
    }
    // Where voices are short, it is a sound of its own.
    let busy = "water = { rate = 20_000, rise_cutoff = 0.3, pressure = 0.01 }";
    let [one, two] =
        [Board::Desk, Board::F411].map(|board| seconds(board, busy, 5, Output::Raw, 0.5));
    assert!(one != two, "the boards' capacities make no difference");
}

/// Capacities so small that every counter counts.
#[derive(Clone, Copy, Debug)]
struct Tight;

impl Profile for Tight {
    const NAME: &'static str = "tight";
    const VOICES: usize = 32;
    const LIMITS: Limits = limits([1e5; 2], [64; 2], 64);
    const BIRTHS_PER_BLOCK: u32 = 40;
    type Voices = [Voice; 32];
    const IDLE: Self::Voices = [Voice::IDLE; 32];
    type Update = Update<[population::Crowd; 2]>;
    fn update() -> Self::Update {
        Update::new()
    }
    type Cloud = <F411 as Profile>::Cloud;
    const CLOUD: Self::Cloud = F411::CLOUD;
    type Keeper = <F411 as Profile>::Keeper;
    const KEEPER: Self::Keeper = F411::KEEPER;
}

/// Every counter, by name.
fn counters(stats: &Stats) -> [(&'static str, u64); 11] {
    let Stats {
        births,
        rising,
        events,
        stolen,
        unvoiced,
        dropped,
        too_high,
        late,
        overloads,
        limited,
        clipped,
    } = *stats;
    [
        ("births", births),
        ("rising", rising),
        ("events", events),
        ("stolen", stolen),
        ("unvoiced", unvoiced),
        ("dropped", dropped),
        ("too_high", too_high),
        ("late", late),
        ("overloads", overloads),
        ("limited", limited),
        ("clipped", clipped),
    ]
}

/// All counters a few steps before they wrap.
const NEARLY: u64 = u64::MAX - 5;

fn nearly_full() -> Stats {
    Stats {
        births: NEARLY,
        rising: NEARLY,
        events: NEARLY,
        stolen: NEARLY,
        unvoiced: NEARLY,
        dropped: NEARLY,
        too_high: NEARLY,
        late: NEARLY,
        overloads: NEARLY,
        limited: NEARLY,
        clipped: NEARLY,
    }
}

/// When something was born: frames and fractions.
#[derive(Default, PartialEq, Debug)]
struct When(Vec<(u64, u32)>);

impl Observer for When {
    fn birth(&mut self, birth: &Birth) {
        self.0.push((birth.frame, birth.fraction));
    }
    fn crowd(&mut self, crowd: &Crowd) {
        self.0.push((crowd.frame, 0));
    }
}

/// Plays both for `frames`; the second counts frames from `preset` on. All else has to be the same.
fn in_step(one: &mut dyn Player, two: &mut dyn Player, preset: u64, frames: usize) {
    let mut out = [[Frame::ZERO; TICK]; 2];
    let mut when = [When::default(), When::default()];
    for tick in 0..frames / TICK {
        one.render_observed(&mut out[0], &mut when[0]);
        two.render_observed(&mut out[1], &mut when[1]);
        assert!(out[0] == out[1], "the sounds part in tick {tick}");
        assert_eq!(when[0].0.len(), when[1].0.len());
        for (a, b) in when[0].0.iter().zip(&when[1].0) {
            assert_eq!((a.0.wrapping_add(preset), a.1), *b, "in tick {tick}");
        }
        when.iter_mut().for_each(|when| when.0.clear());
    }
}

fn count_alike(one: &dyn Player, two: &dyn Player) -> Vec<&'static str> {
    let mut wrapped = Vec::new();
    for ((name, plain), (_, preset)) in
        (counters(&one.stats()).into_iter()).zip(counters(&two.stats()))
    {
        assert_eq!(preset, NEARLY.wrapping_add(plain), "{name}");
        if preset < NEARLY {
            wrapped.push(name);
        }
    }
    wrapped
}

#[test]
fn ten_minutes_across_the_end_of_every_counter_sound_as_ever() {
    let light = scene(
        "water = { rate = 30, classes = 6, radius_min = 0.15, rise_cutoff = 0.5 }\ndrops = { rate = 1 }",
    );
    let frames = 600 * HZ as usize;
    let player = || Board::F407.player(&light, HZ, 9, Output::Bits16);
    let (mut one, mut two) = (player(), player());
    // In the middle of a block, in the middle of the time.
    let preset = u64::MAX - frames as u64 / 2 + 13;
    two.preset_counters(preset, nearly_full());
    in_step(&mut *one, &mut *two, preset, frames);
    let wrapped = count_alike(&*one, &*two);
    println!("{:?}; past their ends: {wrapped:?}", one.stats());
    assert_eq!(wrapped, ["births", "rising", "events", "too_high"]);
}

#[test]
fn where_everything_is_too_much_every_counter_wraps_and_nothing_else_changes() {
    let heavy = scene(
        r#"
        water = { rate = 100_000, law = "flat", radius_min = 0.15, radius_max = 60, rise_cutoff = 0.2, pressure = 8, beta = 1 }
        drops = { rate = 50, bubbles = 8, pressure = 0.001 }
        "#,
    );
    let player =
        || -> Box<dyn Player> { Box::new(Instrument::<Tight>::new(&heavy, HZ, 9, Output::Bits16)) };
    let (mut one, mut two) = (player(), player());
    let preset = u64::MAX - 10_001;
    two.preset_counters(preset, nearly_full());
    in_step(&mut *one, &mut *two, preset, 40 * TICK);
    set(&mut *one, "mix.limiter", 0.0, None);
    set(&mut *two, "mix.limiter", 0.0, None);
    in_step(&mut *one, &mut *two, preset, 40 * TICK);
    let wrapped = count_alike(&*one, &*two);
    println!("{:?}; past their ends: {wrapped:?}", one.stats());
    assert_eq!(wrapped.len(), counters(&Stats::default()).len());
}

#[test]
fn the_event_log_goes_on_past_the_end_of_the_frame_count() {
    let mut player = Board::Desk.player(&scene(EVERYTHING), HZ, 2, Output::Raw);
    player.preset_counters(u64::MAX - 5_000, nearly_full());
    let mut births = Births::new(HZ);
    play(&mut *player, 24_000, &mut births);
    let strike = Strike::new(Pitch::new(0.003, 0.0, f64::from(HZ)), 0.5, [1 << 20; 2]);
    player.strike(&strike, &mut births);
    let end = u64::MAX as f64 / f64::from(HZ);
    let after = (births.sounds.iter())
        .filter(|sound| sound.time < 1.0)
        .count();
    println!("{} before, {after} after", births.sounds.len() - after);
    assert!(0 < after && after < births.sounds.len());
    for sound in &births.sounds {
        assert!(sound.time <= end && sound.amplitude.iter().all(|x| x.is_finite()));
    }
}

#[test]
fn a_bubble_struck_alone_starts_at_its_frame_wherever_it_is_asked_for() {
    // 3 mm: long enough to tell.
    let pitch = Pitch::new(0.003, 0.0, f64::from(HZ));
    assert!(Bubble::new(0.003).beta < 200.0);
    let quiet = scene("water = { rate = 0 }");
    for at in [0.0, 0.25, 31.0, 31.75, 32.0, 511.5, 10_000.125] {
        let mut player = Board::F407.player(&quiet, HZ, 1, Output::Raw);
        let mut births = Births::new(HZ);
        player.strike(&Strike::new(pitch, at, [1 << 26; 2]), &mut births);
        let sound = play(&mut *player, 12_000, &mut births);
        let first = sound.iter().position(|frame| frame.left != 0);
        assert_eq!(first, Some(at as usize + 1), "struck at {at}");
        let [one] = births.sounds[..] else {
            panic!("{} births", births.sounds.len())
        };
        assert!((one.time * f64::from(HZ) - at).abs() < 1e-6);
    }
}
