//! What goes wrong does so without noise, is counted, and the sound comes back right.

mod common;

use std::time::Duration;

use common::{START, board, desk, elf, from_first_sound, scene};
use emulated_board::{Board, Cause, Chip, Setup};
use freshet::BLOCK;
use freshet::scene::Scene;
use freshet_host::scene_file::SceneFile;

/// What renders a block, and the DMA's interrupt.
const PLAY: &str = "freshet_firmware::audio::Player::play";
const DMA: u16 = 47;
/// Lights: alive, clip, late, trouble.
const LATE: usize = 2;
const TROUBLE: usize = 3;

const SECOND: Duration = Duration::from_secs(1);

/// A steady sound with no rest in it.
fn steady() -> Scene {
    let text =
        "[water]\nrate = 3000\nclasses = 12\nradius_min = 1\nradius_max = 8\npressure = 0.05";
    SceneFile::parse("steady", text).expect("valid").scene
}

fn counter(board: &mut Board, name: &str) -> u32 {
    let bytes = board.read_symbol(name).expect("it is there");
    u32::from_le_bytes(bytes.try_into().expect("a word"))
}

fn causes(board: &mut Board) -> Vec<Cause> {
    let resets = board.resets().expect("listed");
    resets.iter().map(|reset| reset.cause).collect()
}

/// Holds the audio task up for `time`.
fn hold(board: &mut Board, time: Duration) {
    let (address, was) = board.hang(PLAY).expect("it hangs");
    board.run(time).expect("it runs");
    board.write(address, &was).expect("mended");
}

/// The last `frames` played are the desk's, `late` blocks later than it plays them.
fn assert_back_in_step(played: &[[i32; 2]], expected: &[[i32; 2]], frames: usize, late: usize) {
    let begin = played.len() - frames;
    let same = (begin..played.len()).all(|i| played[i] == expected[i - late * BLOCK]);
    assert!(same, "not the same sound, {late} blocks late");
}

/// Everything a board plays, and what the desk plays, from the first sample on.
fn both(board: &mut Board, scene: &Scene, seed: u64) -> (Vec<[i32; 2]>, Vec<[i32; 2]>) {
    let played = from_first_sound(&board.take_audio()).to_vec();
    let expected = desk(
        freshet_host::board::Board::F407,
        scene,
        seed,
        played.len() + 48_000,
    );
    (played, from_first_sound(&expected).to_vec())
}

#[test]
fn a_late_block_fades_out_is_counted_and_the_sound_goes_on_where_it_was() {
    for held in [true, false] {
        let scene = steady();
        let mut board = board(&[("steady", scene.clone())], 3, Setup::default());
        board.run(START).expect("it runs");
        let before = board.frames();
        if held {
            hold(&mut board, Duration::from_millis(4));
        } else {
            board
                .mask_interrupt(DMA, Duration::from_millis(4))
                .expect("it is masked");
        }
        board.run(Duration::from_millis(100)).expect("it runs");
        let late = counter(&mut board, "freshet_firmware::i2s::LATE") as usize;
        assert!(late >= 1, "held {held}: nothing was late");
        let after = (board.frames() - before) as usize;
        let (played, expected) = both(&mut board, &scene, 3);
        // 4 ms of fault, 20 to recover.
        let since = after - 24 * 48;
        let blocks = (0..40)
            .find(|blocks| {
                (played.len() - since..played.len())
                    .all(|i| played[i] == expected[i - blocks * BLOCK])
            })
            .expect("the sound goes on where it was, whole blocks later");
        assert!(
            (1..=7).contains(&blocks),
            "held {held}: {blocks} blocks lost"
        );
        assert_eq!(board.i2s_underruns(), 0);
        // No step that the sound itself does not have.
        let largest = |frames: &[[i32; 2]]| {
            let steps = frames
                .windows(2)
                .flat_map(|pair| [0, 1].map(|ear| (pair[1][ear] - pair[0][ear]).unsigned_abs()));
            steps.max().unwrap_or(0)
        };
        if held {
            let here = largest(&played[played.len() - after..]);
            assert!(here <= largest(&expected), "a step of {here}");
        }
        println!("held {held}: {late} late, {blocks} blocks lost, then the same samples");
    }
}

#[test]
fn a_thousand_late_blocks_in_a_row_leave_the_channels_where_they_were() {
    let scene = steady();
    let mut board = board(&[("steady", scene.clone())], 4, Setup::default());
    board.run(START).expect("it runs");
    for _ in 0..1000 {
        hold(&mut board, Duration::from_micros(1_400));
        board.run(Duration::from_micros(1_600)).expect("it runs");
    }
    board.run(Duration::from_millis(200)).expect("it runs");
    let late = counter(&mut board, "freshet_firmware::i2s::LATE");
    assert!(late >= 1000, "{late} late");
    let (played, expected) = both(&mut board, &scene, 4);
    let tail = 48 * 150;
    let blocks = (0..4000)
        .find(|blocks| {
            let from = played.len() - tail;
            from >= blocks * BLOCK
                && (from..played.len()).all(|i| played[i] == expected[i - blocks * BLOCK])
        })
        .expect("the sound goes on where it was");
    assert_back_in_step(&played, &expected, tail, blocks);
    assert_eq!(causes(&mut board), [Cause::PowerOn]);
    println!("{late} late, {blocks} blocks lost");
}

#[test]
fn whenever_the_driver_is_built_anew_the_channels_are_where_they_were() {
    let scene = steady();
    let mut board = board(&[("steady", scene.clone())], 9, Setup::default());
    board.run(START).expect("it runs");
    let failed = elf("f407")
        .symbol("freshet_firmware::i2s::FAILED")
        .expect("it is there")
        .address;
    for i in 0..100 {
        // As the interrupt does on an error, at any time in a frame.
        board.write(failed, &[1]).expect("RAM");
        board
            .run(Duration::from_nanos(10_000_000 + 777 * i))
            .expect("it runs");
    }
    board.run(Duration::from_millis(100)).expect("it runs");
    let (played, expected) = both(&mut board, &scene, 9);
    let tail = 48 * 80;
    // Each time what is on its way is lost, and some frames pass in silence.
    let shift = (-20_000..20_000).find(|shift| {
        (played.len() - tail..played.len())
            .all(|i| expected.get(i.wrapping_add_signed(*shift)) == Some(&played[i]))
    });
    assert!(shift.is_some(), "the sound does not go on as it was");
    assert_eq!(board.i2s_underruns(), 0);
    println!("after 100 restarts {shift:?} frames ahead");
}

#[test]
fn a_hung_control_task_is_reset_by_the_watchdog_and_the_sound_is_back_within_a_second() {
    let scene = steady();
    let mut board = board(&[("steady", scene)], 5, Setup::default());
    board.run(START).expect("it runs");
    let hung = board.now();
    let (address, was) = board
        .hang("freshet_firmware::control::tick")
        .expect("it hangs");
    board
        .run_until(SECOND, |board| {
            board.resets().is_ok_and(|resets| resets.len() == 2)
        })
        .expect("a reset");
    board.write(address, &was).expect("mended");
    board.take_audio();
    board
        .run_until(SECOND, |board| {
            board.take_audio().iter().any(|frame| *frame != [0; 2])
        })
        .expect("sound");
    assert_eq!(causes(&mut board), [Cause::PowerOn, Cause::Watchdog]);
    let silent = board.now() - hung;
    assert!(silent < SECOND, "{silent:?} from the fault to the sound");
    board.run(Duration::from_millis(200)).expect("it runs");
    assert!(board.leds()[TROUBLE], "the trouble light is on");
    println!("sound {silent:?} after the fault");
}

#[test]
fn a_crash_leaves_a_record_that_survives_the_reset() {
    let scene = steady();
    let mut board = board(&[("steady", scene)], 6, Setup::default());
    board.run(START).expect("it runs");
    let (address, was) = board
        .crash("freshet_firmware::control::tick")
        .expect("it crashes");
    board
        .run_until(SECOND, |board| {
            board.resets().is_ok_and(|resets| resets.len() == 2)
        })
        .expect("a reset");
    board.write(address, &was).expect("mended");
    board.run(SECOND).expect("it runs");
    assert_eq!(causes(&mut board), [Cause::PowerOn, Cause::Software]);
    let record = board.read_symbol("BLACKBOX").expect("it is there");
    let text = String::from_utf8_lossy(&record[12..]).into_owned();
    let place = format!("hard fault at {address:#x}");
    assert!(text.starts_with(&place), "{text}");
    assert!(board.leds()[TROUBLE], "the trouble light is on");
    println!("{text}");
}

/// `push {r0-r7}`, and again.
const OVERFLOW: [u8; 4] = [0xff, 0xb4, 0xfd, 0xe7];

#[test]
fn a_stack_that_overflows_leaves_a_record_too() {
    let scene = steady();
    for function in [
        // As it starts, and while it plays: at the bottom of the stack, and above all else.
        "freshet_firmware::control::start_synth",
        "freshet_firmware::control::tick",
        PLAY,
    ] {
        let mut board = board(&[("steady", scene.clone())], 6, Setup::default());
        if function != "freshet_firmware::control::start_synth" {
            board.run(START).expect("it runs");
        }
        let elf = elf("f407");
        let address = elf.function(function).expect("it is there").address;
        let was = board.read(address, OVERFLOW.len()).expect("it is flash");
        board.write(address, &OVERFLOW).expect("it is flash");
        board
            .run_until(SECOND, |board| {
                board.resets().is_ok_and(|resets| resets.len() == 2)
            })
            .expect("a reset");
        board.write(address, &was).expect("mended");
        board.run(SECOND).expect("it runs");
        assert_eq!(causes(&mut board), [Cause::PowerOn, Cause::Software]);
        let record = board.read_symbol("BLACKBOX").expect("it is there");
        let text = String::from_utf8_lossy(&record[12..]).into_owned();
        assert!(
            text.starts_with("the stack overflowed"),
            "{function}: {text}"
        );
    }
}

#[test]
fn a_start_that_hangs_is_cut_short_by_the_watchdog() {
    let mut board = board(&[("steady", steady())], 6, Setup::default());
    let (address, was) = board
        .hang("freshet_firmware::control::start_synth")
        .expect("it hangs");
    board
        .run_until(4 * SECOND, |board| {
            board.resets().is_ok_and(|resets| resets.len() == 2)
        })
        .expect("a reset");
    board.write(address, &was).expect("mended");
    board.run(SECOND).expect("it runs");
    assert_eq!(causes(&mut board), [Cause::PowerOn, Cause::Watchdog]);
}

#[test]
fn a_panic_leaves_its_message() {
    let scene = steady();
    let mut board = board(&[("steady", scene)], 6, Setup::default());
    board.run(START).expect("it runs");
    // A control path whose memory is full of ones cannot go on.
    let elf = elf("f407");
    let control = elf
        .matching("CONTROL")
        .find(|symbol| symbol.size > 1000)
        .expect("it is there");
    board
        .write(control.address, &vec![0xff; control.size as usize])
        .expect("RAM");
    board
        .run_until(SECOND, |board| {
            board.resets().is_ok_and(|resets| resets.len() == 2)
        })
        .expect("a reset");
    board.run(SECOND).expect("it runs");
    let record = board.read_symbol("BLACKBOX").expect("it is there");
    let text = String::from_utf8_lossy(&record[12..]).into_owned();
    assert!(
        text.starts_with("panicked at ") || text.starts_with("hard fault at "),
        "{text}"
    );
    let resets = causes(&mut board);
    assert_eq!(resets, [Cause::PowerOn, Cause::Software], "{text}");
    println!("{text}");
}

#[test]
fn a_damaged_bank_plays_the_built_in_scene_and_says_so() {
    let setup = Setup::default();
    let elf = elf("f407");
    let seed = setup
        .unique_id
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
    let mut board = Board::new(Chip::F407, &elf, setup).expect("a board");
    let bank = elf.section(".bank").expect("linked");
    let middle = bank.address + bank.size / 2;
    let byte = board.read(middle, 1).expect("flash")[0];
    board.write(middle, &[byte ^ 0x10]).expect("flash");
    board.run(START + SECOND / 2).expect("it runs");
    let (played, expected) = both(&mut board, &Scene::default(), seed);
    assert!(played.len() > 10_000);
    assert_eq!(played, expected[..played.len()]);
    assert!(board.leds()[TROUBLE], "the trouble light is on");
}

#[test]
fn without_a_crystal_or_a_codec_it_sounds_and_shows_that_something_is_wrong() {
    for (crystal, codec) in [(false, true), (true, false), (true, true)] {
        let setup = Setup {
            crystal,
            codec,
            ..Setup::default()
        };
        let mut board = board(&[("steady", steady())], 7, setup);
        board.run(START + SECOND / 2).expect("it runs");
        let start = board.first_sound().expect("it sounds");
        assert!(start < SECOND, "{start:?}");
        assert_eq!(board.leds()[TROUBLE], !(crystal && codec));
        let nominal = board.sample_rate().expect("it runs");
        assert!((nominal - 48_000.0).abs() < 1.0, "{nominal} Hz");
    }
}

#[test]
fn the_button_steps_to_the_next_scene_as_the_desk_does() {
    let (one, two) = (scene("tap"), scene("cave-drip"));
    let mut board = board(
        &[("tap", one.clone()), ("cave-drip", two.clone())],
        8,
        Setup::default(),
    );
    board.run(START + SECOND).expect("it runs");
    board.button(true).expect("pressed");
    board.run(Duration::from_millis(100)).expect("it runs");
    board.button(false).expect("released");
    board.run(2 * SECOND).expect("it runs");
    let played = from_first_sound(&board.take_audio()).to_vec();
    let total = played.len();
    // It acts at a tick; which one, the sound tells.
    let same = (240..960).find(|tick| {
        let mut player =
            freshet_host::board::Board::F407.player(&one, 48_000, 8, freshet::mix::Output::Bits24);
        let mut out = vec![freshet::Frame::ZERO; total + 24_000];
        let (before, after) = out.split_at_mut(tick * freshet::TICK);
        player.render(before);
        player.control().load(&two);
        player.render(after);
        let frames: Vec<[i32; 2]> = out.iter().map(|frame| [frame.left, frame.right]).collect();
        let frames = from_first_sound(&frames);
        frames.len() >= total && frames[..total] == played[..]
    });
    println!(
        "the scene changed at tick {:?}",
        same.expect("board and desk agree on some tick")
    );
    assert_eq!(counter(&mut board, "freshet_firmware::i2s::LATE"), 0);
    assert!(!board.leds()[LATE]);
}
