//! A session is recorded by writing down what the board says, and played again sample for sample.

use freshet::mix::Output;
use freshet::param::{COUNT, Kind, TABLE};
use freshet::protocol::{BootRecord, Name, Preset};
use freshet::{Frame, TICK};
use freshet_host::board::Board;
use freshet_host::built_in::{self, SCENES};
use freshet_host::replay::Replay;
use freshet_host::twin::{Kept, Setup, Twin};
use proptest::prelude::*;

/// A twin, and all that it said and sounded.
struct Session {
    twin: Twin,
    said: Vec<u8>,
    sound: Vec<Frame>,
    /// How often what it says is fetched: a slow line has little room for answers.
    fetched: usize,
}

impl Session {
    fn new(board: Board, first: u16, seed: u64) -> Self {
        Self::with(board, first, seed, Kept::default())
    }

    fn with(board: Board, first: u16, seed: u64, kept: Kept) -> Self {
        let twin = Twin::with(Setup {
            board,
            rate: 48_000,
            seed,
            scenes: built_in::named().unwrap(),
            first,
            kept,
            output: Output::Bits24,
        });
        Self {
            twin,
            said: Vec::new(),
            sound: Vec::new(),
            fetched: 0,
        }
    }

    /// Says a line, then listens for so many frames.
    fn say(&mut self, line: &str, frames: usize) {
        self.twin.receive(format!("{line}\n").as_bytes());
        self.listen(frames);
    }

    fn listen(&mut self, frames: usize) {
        let begun = self.sound.len();
        self.sound.resize(begun + frames, Frame::ZERO);
        for part in self.sound[begun..].chunks_mut(97) {
            self.twin.render(part);
            self.fetched += 1;
            let mut bytes = [0; 64];
            let count = self.twin.take_into(&mut bytes);
            self.said.extend(&bytes[..count]);
        }
    }

    fn text(mut self) -> (String, Vec<Frame>) {
        // What is still to be said.
        self.twin.render(&mut vec![Frame::ZERO; 500 * TICK]);
        self.said.extend(self.twin.take());
        (String::from_utf8(self.said).unwrap(), self.sound)
    }
}

fn replayed(text: &str, frames: usize) -> Vec<Frame> {
    let replay = Replay::new("session", text, Output::Bits24).unwrap();
    let mut sound = Vec::new();
    replay
        .play(frames as u64, |part| {
            sound.extend_from_slice(part);
            true
        })
        .unwrap();
    sound
}

/// The first frame that differs.
fn difference(a: &[Frame], b: &[Frame]) -> Option<usize> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).position(|(a, b)| a != b)
}

fn command() -> impl Strategy<Value = String> {
    let value = (0.0_f32..1.0, 0_usize..100).prop_map(|(x, place)| {
        let param = &TABLE[place % COUNT];
        let value = param.min + (param.max - param.min) * x * x;
        // The dearest of it would take minutes to render.
        let value = if param.path == "water.rate" {
            value / 100.0
        } else {
            value
        };
        let whole = !matches!(param.kind, Kind::Real);
        format!(
            "{}={}",
            param.path,
            if whole { value.round() } else { value }
        )
    });
    let ramp = prop_oneof![
        Just(String::new()),
        (0.0_f32..0.3).prop_map(|s| format!(" ramp={s}"))
    ];
    let set = (prop::collection::vec(value, 1..4), ramp)
        .prop_map(|(values, ramp)| format!("set {}{ramp}", values.join(" ")));
    prop_oneof![
        6 => set,
        1 => (0_u16..13).prop_map(|number| format!("scene {number}")),
        1 => Just("scene light rain".to_owned()),
        1 => Just("scene".to_owned()),
        1 => (0.0_f32..1.0).prop_map(|x| format!("set intensity {x}")),
        3 => Just("trigger".to_owned()),
        1 => (0.2_f32..20.0).prop_map(|mm| format!("trigger {mm} 0.5")),
        1 => prop_oneof![Just("mute".to_owned()), Just("mute off".to_owned())],
        2 => (0_u8..4).prop_map(|slot| format!("store {slot} at {slot}")),
        3 => (0_u8..4).prop_map(|slot| format!("recall {slot}")),
        1 => (0_u8..4).prop_map(|slot| format!("erase {slot}")),
        1 => prop_oneof![
            Just("boot default".to_owned()),
            Just("boot scene river".to_owned()),
            Just("boot preset 1".to_owned()),
            Just("boot settings".to_owned()),
            Just("boot".to_owned()),
        ],
        1 => Just("restart".to_owned()),
        1 => prop_oneof![
            Just("get mix.level water.rate".to_owned()),
            Just("list mix".to_owned()),
            Just("list".to_owned()),
            Just("status".to_owned()),
            Just("presets".to_owned()),
            Just("version".to_owned()),
            Just("help".to_owned()),
            Just("nonsense = 3".to_owned()),
        ],
    ]
}

fn board() -> impl Strategy<Value = Board> {
    prop_oneof![
        Just(Board::Desk),
        Just(Board::F407),
        Just(Board::F411),
        Just(Board::H743)
    ]
}

/// Presets in slots 0 to 3, and perhaps one of them from the start.
fn kept() -> impl Strategy<Value = Kept> {
    let preset = (
        0_usize..12,
        prop::collection::vec((0_usize..40, 0.0_f32..1.0), 0..40),
    )
        .prop_map(|(scene, values)| {
            let mut preset = Preset {
                scene: Name::try_from(SCENES[scene].0).unwrap(),
                ..Preset::default()
            };
            for (place, x) in values {
                let param = &TABLE[place];
                let x = if x < 0.2 {
                    param.default
                } else {
                    param.between(param.min, param.max, x)
                };
                let new = preset.values.iter().all(|(id, _)| *id != param.id);
                if new && param.path != "water.rate" {
                    preset.values.push((param.id, x)).unwrap();
                }
            }
            preset
        });
    let boot = prop_oneof![
        Just(BootRecord::Default),
        (0_u8..4).prop_map(BootRecord::Preset),
        Just(BootRecord::Scene(Name::try_from("surf").unwrap())),
    ];
    (prop::collection::btree_map(0_u8..4, preset, 0..4), boot)
        .prop_map(|(presets, boot)| Kept { presets, boot })
}

/// Pauses between commands: none at all, a moment, long enough for anything to end.
fn pause() -> impl Strategy<Value = usize> {
    prop_oneof![3 => Just(0), 3 => 0_usize..1000, 1 => 0_usize..40_000]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn any_session_is_played_again_sample_for_sample(
        board in board(),
        first in 0_u16..12,
        seed in any::<u64>(),
        kept in kept(),
        begin in pause(),
        commands in prop::collection::vec((command(), pause()), 0..25),
    ) {
        let mut session = Session::with(board, first, seed, kept);
        session.listen(begin);
        for (command, frames) in &commands {
            session.say(command, *frames);
        }
        session.listen(5_000);
        let (text, sound) = session.text();
        let again = replayed(&text, sound.len());
        prop_assert_eq!(difference(&sound, &again), None, "{}", text);
    }

    #[test]
    fn what_is_damaged_is_named_and_nothing_breaks(
        commands in prop::collection::vec((command(), 0_usize..300), 0..20),
        cut in any::<prop::sample::Index>(),
        harm in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
    ) {
        let mut session = Session::new(Board::F411, 1, 3);
        for (command, frames) in &commands {
            session.say(command, *frames);
        }
        let (text, _) = session.text();
        let mut bytes = text.into_bytes();
        bytes.truncate(cut.index(bytes.len() + 1));
        for (place, byte) in harm {
            if !bytes.is_empty() {
                let place = place.index(bytes.len());
                bytes[place] = byte;
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        match Replay::new("damaged", &text, Output::Bits24) {
            Ok(replay) => {
                if let Err(error) = replay.play(3_000, |_| true) {
                    prop_assert!(error.to_string().starts_with("damaged:"), "{}", error);
                }
            }
            Err(error) => prop_assert!(error.to_string().starts_with("damaged:"), "{}", error),
        }
    }
}

fn refusal(text: &str) -> String {
    match Replay::new("x.txt", text, Output::Bits24) {
        Ok(replay) => replay.play(1_000_000, |_| true).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn what_is_missing_is_told_with_its_line() {
    let (greeting, _) = Session::new(Board::F407, 2, 7).text();
    for (text, words) in [
        (
            "ok set mix.level=-6 at 256\n".to_owned(),
            "x.txt: no start of a board in it, only 1 commands; a recording begins with the line `freshet version=…`",
        ),
        (
            String::new(),
            "x.txt: no start of a board in it, only 0 commands",
        ),
        (
            greeting.replace("at=128", "at=51200"),
            "x.txt:1: this greeting comes 51072 frames after the start",
        ),
        (
            greeting.replace("version=0", "version=9"),
            "x.txt:1: recorded with freshet 9",
        ),
        (
            greeting.replace("board=f407", "board=f999"),
            "x.txt:1: there is no board `f999` here",
        ),
        (
            greeting.replace("scene=brook", "scene=lake"),
            "x.txt:1: there is no scene `lake` here",
        ),
        (
            format!("{greeting}ok set mix.lev=-6 at 256\n"),
            "x.txt:2: cannot read `ok set mix.lev=-6 at 256`",
        ),
        (
            format!("{greeting}ok set mix.level=-6 at 257\n"),
            "x.txt:2: cannot read the frame `257`: expected a multiple of 128",
        ),
        (
            format!("{greeting}ok set mix.level=-6\n"),
            "x.txt:2: `ok set mix.level=-6` does not say at which frame",
        ),
        (
            format!("{greeting}\nok set mix.level=99 at 256\n"),
            "x.txt:3: the twin refuses: mix.level cannot be 99",
        ),
        (
            format!("{greeting}ok recall 3 at 256\n"),
            "x.txt:2: the scene and the values of `recall 3` are not before it",
        ),
        (
            format!("{greeting}pause of about 501 ms at 256\n"),
            "x.txt:2: the pause that begins here has no end",
        ),
        (
            format!("{greeting}{greeting}"),
            "x.txt:2: the board has started again here, and nothing says when",
        ),
        (
            format!("{greeting}ok set mix.level=-6 at 256"),
            "x.txt:2: the last line has no end",
        ),
    ] {
        let error = refusal(&text);
        assert!(error.starts_with(words), "{error}");
    }
}

#[test]
fn what_was_before_the_start_is_left_out_and_counted() {
    let mut session = Session::new(Board::F407, 1, 7);
    session.say("scene river", 5_000);
    session.say("set mix.level -3", 5_000);
    session.say("restart", 1_000);
    session.say("set mix.level -6", 5_000);
    let (text, _) = session.text();
    // The first greeting was missed.
    let (_, rest) = text.split_once('\n').unwrap();
    let replay = Replay::new("session", rest, Output::Bits24).unwrap();
    assert_eq!((replay.before, replay.commands()), (2, 1));
}
