//! Everything the serial protocol can do, through the board's own USART, as it is on the desk.

mod common;

use std::time::Duration;

use common::talk::{MS, SECOND, Talk};
use common::{RATE, from_first_sound, scene, unhurried};
use emulated_board::{Cause, Setup};
use freshet::param::{Kind, TABLE};
use freshet::protocol::{Reply, Request};
use freshet::scene::Scene;
use freshet::{Frame, TICK};
use freshet_host::board::Board as Desk;
use freshet_host::twin::{Kept, Twin};

/// The desk's twin of the board.
fn twin(scenes: &[(&str, Scene)], seed: u64) -> Twin {
    let scenes = scenes
        .iter()
        .map(|(name, scene)| ((*name).to_owned(), scene.clone()));
    Twin::new(Desk::F407, RATE, seed, scenes.collect(), Kept::default())
}

/// The frame an answer names.
fn date(line: &str) -> Option<u64> {
    line.rsplit_once(" at ")?.1.parse().ok()
}

/// A steady sound with no rest in it.
fn steady() -> Scene {
    let text =
        "[water]\nrate = 1000\nclasses = 12\nradius_min = 1\nradius_max = 8\npressure = 0.05";
    freshet_host::scene_file::SceneFile::parse("steady", text)
        .expect("valid")
        .scene
}

/// What the twin plays when each of `commands` comes at its frame; and what it answers.
fn replay(twin: &mut Twin, commands: &[(String, u64)], frames: usize) -> (Vec<[i32; 2]>, String) {
    let mut out = Vec::new();
    let mut said = String::new();
    let mut commands = commands.iter().peekable();
    twin.take();
    while out.len() < frames {
        while let Some((line, _)) = commands.next_if(|(_, at)| *at == twin.device().player().date())
        {
            twin.receive(format!("{line}\n").as_bytes());
        }
        let mut tick = [Frame::ZERO; TICK];
        twin.render(&mut tick);
        said += &String::from_utf8(twin.take()).expect("text");
        out.extend(tick.map(|frame| [frame.left, frame.right]));
    }
    assert_eq!(commands.next(), None, "each had its frame");
    (out, said)
}

#[test]
fn the_board_plays_what_it_is_told_as_the_desk_does() {
    let scenes = [
        ("steady", steady()),
        ("tap", scene("tap")),
        ("surf", scene("surf")),
    ];
    let mut talk = Talk::new(&scenes, 11, unhurried());
    let mut commands = Vec::new();
    for (line, ms) in [
        ("set mix.level=-20 ramp=0.2", 130),
        ("trigger 4 0.5", 1),
        ("trigger 12 0.5 1.5", 77),
        ("set water.rate 4000 1", 40),
        ("set mix.width 0.3", 333),
        ("mute on", 201),
        ("mute off", 150),
        ("scene tap", 400),
        ("set drops.rate=40 drops.radius=3 ramp=0.1", 300),
        ("scene surf", 600),
        ("set intensity 0.8 0.3", 500),
        ("set water.radius_max default", 450),
    ] {
        let answer = talk.ask(line);
        let at = date(&answer[answer.len() - 1]).unwrap_or_else(|| panic!("{line}: {answer:?}"));
        commands.push((line.to_owned(), at, answer.join("\n") + "\n"));
        talk.board.run(ms * MS).expect("it runs");
    }
    let played = talk.board.take_audio();
    let timed: Vec<_> = commands
        .iter()
        .map(|(line, at, _)| (line.clone(), *at))
        .collect();
    let (expected, said) = replay(&mut twin(&scenes, 11), &timed, played.len());
    assert_eq!(
        said,
        commands
            .iter()
            .map(|(_, _, answer)| answer.as_str())
            .collect::<String>()
    );
    let (played, expected) = (from_first_sound(&played), from_first_sound(&expected));
    let length = played.len().min(expected.len());
    let first = (0..length).find(|i| played[*i] != expected[*i]);
    assert_eq!(first, None, "board and desk part here");
    assert!(length > 3 * RATE as usize);
    assert_eq!(talk.count("underruns"), 0.0);
    assert_eq!(talk.count("missed"), 0.0);
    println!("{} commands, {length} frames alike", commands.len());
}

#[test]
fn every_parameter_is_set_and_read_back() {
    let scenes = [("tap", scene("tap"))];
    let mut talk = Talk::new(&scenes, 1, unhurried());
    for param in &TABLE {
        let wanted = match param.kind {
            Kind::Real => param.between(param.min, param.max, 0.375),
            Kind::Whole | Kind::Choice(_) => param.max,
        };
        let shown = match param.kind {
            Kind::Choice(names) => names[wanted as usize].to_owned(),
            Kind::Real | Kind::Whole => wanted.to_string(),
        };
        let answer = talk.ask(&format!("set {}={shown} ramp=0", param.path));
        assert!(
            answer[0].starts_with(&format!("ok set {}={shown} ramp=0 at ", param.path)),
            "{answer:?}"
        );
        talk.board.run(6 * MS).expect("it runs");
        let answer = talk.ask(&format!("get {}", param.path));
        let value = answer[0]
            .strip_prefix(&format!("{} = ", param.path))
            .expect("its value");
        assert_eq!(value.split(' ').next(), Some(&*shown), "{answer:?}");
        let answer = talk.ask(&format!("set {}=1e30", param.path));
        assert!(answer[0].starts_with("error "), "{answer:?}");
    }
    println!("{} parameters", TABLE.len());
}

#[test]
fn every_command_answers_as_the_twin_does() {
    let scenes = [("tap", scene("tap")), ("brook", scene("brook"))];
    let mut talk = Talk::new(&scenes, 7, unhurried());
    let mut twin = twin(&scenes, 7);
    twin.take();
    let ask_twin = |twin: &mut Twin, line: &str| {
        twin.receive(format!("{line}\n").as_bytes());
        let mut said = String::new();
        // Lists go on for as long as there is something to say.
        for _ in 0..300 {
            twin.render(&mut [Frame::ZERO; TICK]);
            said += &String::from_utf8(twin.take()).expect("text");
        }
        said
    };
    let plain = |text: &str| -> Vec<String> {
        let lines = text
            .lines()
            .filter(|line| !line.starts_with("pause of about"));
        lines
            .map(|line| line.split(" at ").next().unwrap_or_default().to_owned())
            .collect()
    };
    for line in [
        "help",
        "help set",
        "list mix",
        "describe water.rate",
        "get mix.level water.rate",
        "get",
        "set mix.level -3",
        "set nothing 3",
        "set mix.level=1 mix.width=9",
        "nonsense",
        "scene",
        "scene brook",
        "scene 7",
        "set mix.level -3.5 0",
        "trigger 3 0.2 0.1",
        "trigger 300",
        "mute",
        "mute off",
        "presets",
        "store 3 my brook",
        "store 17",
        "store",
        "store 4 a*b",
        "presets",
        "recall 3",
        "recall",
        "recall 9",
        "list mix",
        "erase 3",
        "erase 3",
        "boot",
        "boot scene tap",
        "boot",
        "boot settings",
        "boot preset 5",
        "boot scene nothing",
        "unmute",
    ] {
        let answer = talk.ask_all(line);
        let expected = ask_twin(&mut twin, line);
        assert_eq!(plain(&answer), plain(&expected), "{line}");
    }
    let status = talk.ask("status");
    assert!(
        status.iter().any(|line| line == "cause = power-on"),
        "{status:?}"
    );
    let version = talk.ask("version");
    assert!(
        version[0].contains("board=f407") && version[0].contains("scene=brook"),
        "{version:?}"
    );
    // What was stored is what it starts with.
    let before = talk.ask("get mix.level");
    assert_eq!(before[0], "mix.level = -3.5 dB");
    let answer = talk.ask("restart");
    assert!(
        answer[answer.len() - 1].starts_with("ok restart at "),
        "{answer:?}"
    );
    talk.start();
    assert!(talk.ask("version")[0].contains("scene=brook"));
    assert_eq!(talk.ask("get mix.level"), before);
    let causes: Vec<_> = talk
        .board
        .resets()
        .expect("listed")
        .iter()
        .map(|reset| reset.cause)
        .collect();
    assert_eq!(causes, [Cause::PowerOn, Cause::Software]);
    assert!(talk.ask("status").iter().any(|line| line == "trouble = no"));
    assert_eq!(talk.board.unmodelled().expect("listed"), []);
}

#[test]
fn frames_go_through_the_same_door() {
    let scenes = [("tap", scene("tap"))];
    let mut talk = Talk::new(&scenes, 1, unhurried());
    let mut bytes = [0; 400];
    for (tag, request) in [(9u8, Request::Hello), (10, Request::Subscribe(8))] {
        let length = freshet::protocol::encode(&(tag, request), &mut bytes).expect("it fits");
        talk.board.serial_send(&bytes[..length]).expect("sent");
    }
    talk.board.run(SECOND / 2).expect("it runs");
    let sent = talk.board.serial_take();
    let mut reports = 0;
    for frame in sent
        .split(|byte| *byte == 0)
        .filter(|frame| !frame.is_empty())
    {
        let mut payload = [0; freshet::protocol::PAYLOAD_MAX];
        let (tag, reply) =
            freshet::protocol::decode::<(u8, Reply<'_>)>(frame, &mut payload).expect("a frame");
        match reply {
            Reply::Hello(hello) => assert_eq!((tag, hello.scene), (9, "tap")),
            Reply::Status(status) => {
                assert_eq!((tag, status.cause), (10, "power-on"));
                assert!(status.load > 0.0 && status.load < 1.0, "{}", status.load);
                reports += 1;
            }
            other => assert!(matches!(other, Reply::Done { .. }), "{other:?}"),
        }
    }
    assert!(reports >= 20, "{reports}");
}

#[test]
fn damage_on_the_line_is_counted_and_nothing_is_done_that_was_not_asked() {
    let scenes = [("tap", scene("tap"))];
    let mut talk = Talk::new(&scenes, 1, unhurried());
    talk.board.garble_serial(20_000).expect("garbled");
    for _ in 0..200 {
        // Twenty bytes a line: a third of them have damage.
        talk.send("set mix.level=-11.25");
        talk.board.run(12 * MS).expect("it runs");
    }
    talk.board.garble_serial(0).expect("no more");
    talk.board.run(SECOND / 2).expect("it runs");
    talk.board.serial_take();
    talk.heard.clear();
    talk.ask("unmute");
    talk.board.run(SECOND / 5).expect("it runs");
    assert_eq!(talk.ask("get mix.level")[0], "mix.level = -11.25 dB");
    let (framing, garbage) = (talk.count("framing"), talk.count("garbage"));
    assert!(framing > 20.0 && garbage > 10.0, "{framing} {garbage}");
    // Everything else is as it was.
    let mut fresh = twin(&scenes, 1);
    for (index, param) in TABLE.iter().enumerate() {
        let value = fresh.device().player().parameters().get(index);
        let line = &talk.ask(&format!("get {}", param.path))[0];
        if param.kind == Kind::Real && param.path != "mix.level" {
            let same = format!("{} = {value}", param.path);
            assert!(line.starts_with(&same), "{line}: {value}");
        }
    }
    println!("{framing} looks that found damage, {garbage} lines thrown away");
}

#[test]
fn a_crash_is_told_over_the_line() {
    let scenes = [("tap", scene("tap"))];
    let mut talk = Talk::new(&scenes, 1, unhurried());
    let (address, was) = talk
        .board
        .crash("freshet_firmware::control::tick")
        .expect("it crashes");
    talk.board
        .run_until(SECOND, |board| {
            board.resets().is_ok_and(|resets| resets.len() == 2)
        })
        .expect("a reset");
    talk.board.write(address, &was).expect("mended");
    talk.heard.clear();
    talk.start();
    let status = talk.ask("status");
    let fault = format!("panic = hard fault at {address:#x}");
    assert!(
        status.iter().any(|line| line.starts_with(&fault)),
        "{status:?}"
    );
    assert!(status.iter().any(|line| line == "trouble = yes"));
}

/// The busiest scene that an F407 plays in time.
const WORST: &str = "heavy-rain";

/// A line of commands without a gap, at `baud`: none is lost, no block is late, and what is asked sounds soon.
fn flood(baud: u32, most_missed: f64) {
    let scenes = [(WORST, scene(WORST))];
    let seed = 5;
    let mut talk = Talk::new(&scenes, seed, Setup::default());
    // USART2 is clocked with 42 MHz.
    talk.board.serial_divider(42_000_000 / baud).expect("set");
    let byte = Duration::from_secs_f64(10.0 * f64::from(42_000_000 / baud) / 42e6);
    let lines = (3.0 / byte.as_secs_f64() / 21.0) as usize;
    let mut bytes = 0;
    let begun = talk.board.now();
    let mut ends = Vec::new();
    let mut text = String::new();
    for line in 0..lines {
        // Each has a value of its own, so that its answer is known again.
        text += &format!("set mix.level={:.6}\n", -0.000_001 * line as f64);
        bytes = text.len();
        ends.push(begun + byte * bytes as u32);
    }
    talk.board.serial_send(text.as_bytes()).expect("sent");
    talk.board
        .run(byte * bytes as u32 + SECOND / 2)
        .expect("it runs");
    let said = String::from_utf8(talk.board.serial_take()).expect("text");
    talk.heard.clear();
    // When a frame is heard: from the first sound on, all are there.
    let sound = talk.board.first_sound().expect("it sounds");
    let silent = {
        let mut player = Desk::F407.player(&scenes[0].1, RATE, seed, freshet::mix::Output::Bits24);
        let mut out = vec![Frame::ZERO; RATE as usize];
        player.render(&mut out);
        out.iter()
            .position(|frame| *frame != Frame::ZERO)
            .expect("it sounds")
    };
    let mut latest = Duration::ZERO;
    let mut answers = 0;
    for line in said.lines().filter(|line| line.starts_with("ok set")) {
        let value: f64 = line
            .split(['=', ' '])
            .nth(3)
            .and_then(|value| value.parse().ok())
            .expect("a value");
        let number = (value * -1e6).round() as usize;
        let at = date(line).expect("a date");
        let heard = sound + Duration::from_secs_f64((at as f64 - silent as f64) / f64::from(RATE));
        assert!(heard > ends[number], "{line}");
        latest = latest.max(heard - ends[number]);
        answers += 1;
    }
    let dropped = talk.count("dropped");
    let (underruns, missed) = (talk.count("underruns"), talk.count("missed"));
    let lost = [
        talk.count("overruns"),
        talk.count("framing"),
        talk.count("garbage"),
    ];
    let peak = talk.count("peak");
    println!(
        "{baud} baud: {lines} commands, {answers} answered, {dropped} answers dropped, {latest:?} at most from the last \
         byte to the sound; {underruns} underruns, {missed} ticks missed, peak {peak} %"
    );
    assert_eq!(answers as f64 + dropped, lines as f64, "each was done");
    assert_eq!(lost, [0.0; 3]);
    assert_eq!(underruns, 0.0);
    assert!(latest <= 10 * MS, "{latest:?}");
    assert!(missed <= most_missed, "{missed}");
}

#[test]
fn a_flood_at_115_200_baud_disturbs_nothing() {
    flood(115_200, 0.0);
}

#[test]
fn a_flood_at_a_million_baud_disturbs_nothing() {
    // Of 1 125 in three seconds.
    flood(1_000_000, 50.0);
}
