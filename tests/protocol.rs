//! One stream with two doors: what a person types and what a program sends, and what comes back.

mod common;

use common::{scene, with};
use freshet::param::{self, COUNT, TABLE};
use freshet::protocol::{
    Boot, Choice, Device, Item, PAYLOAD_MAX, Pair, Refusal, Reply, Request, Splitter, Tag, decode,
    encode, parse,
};
use freshet::{Frame, TICK};
use freshet_host::board::Board;
use freshet_host::built_in;
use freshet_host::twin::{Kept, Twin};

fn twin() -> Twin {
    let scenes = built_in::all().map(|scene| {
        let (name, scene) = scene.expect("valid");
        (name.to_owned(), scene.scene)
    });
    let scenes = scenes.collect();
    let mut twin = Twin::new(Board::F407, 48_000, 7, scenes, Kept::default());
    twin.take();
    twin
}

/// Says a line and returns the lines that come back until it is done.
fn ask(twin: &mut Twin, line: &str) -> Vec<String> {
    twin.receive(format!("{line}\n").as_bytes());
    let mut text = String::new();
    for _ in 0..1000 {
        text.push_str(&String::from_utf8(twin.take()).expect("text"));
        let last = text.lines().last().unwrap_or_default();
        if last.starts_with("ok") || last.starts_with("error") {
            break;
        }
        twin.render(&mut [Frame::ZERO; TICK]);
    }
    text.lines().map(str::to_owned).collect()
}

/// Sends a frame and returns the replies.
fn send(twin: &mut Twin, tag: Tag, request: &Request<'_>) -> Vec<Vec<u8>> {
    let mut bytes = [0; 512];
    let length = encode(&(tag, request), &mut bytes).expect("it fits");
    twin.receive(&bytes[..length]);
    let mut all = Vec::new();
    for _ in 0..2 * COUNT {
        all.extend(twin.take());
        twin.render(&mut [Frame::ZERO; TICK]);
    }
    all.split(|byte| *byte == 0)
        .filter(|frame| !frame.is_empty())
        .map(<[u8]>::to_vec)
        .collect()
}

/// The reply in a frame.
fn read<'a>(frame: &[u8], payload: &'a mut [u8; PAYLOAD_MAX]) -> (Tag, Reply<'a>) {
    decode(frame, payload).expect("a reply")
}

#[test]
fn every_parameter_is_listed_set_and_read_back_by_both_doors() {
    let mut twin = twin();
    let listed = ask(&mut twin, "list");
    assert_eq!(listed.len(), COUNT + 1);
    for (param, line) in TABLE.iter().zip(&listed) {
        assert!(line.starts_with(&format!("{} = ", param.path)), "{line}");
    }
    for param in &TABLE {
        for value in [param.max, param.min, param.default] {
            let answer = ask(&mut twin, &format!("set {} {value} 0", param.path));
            assert!(answer[0].starts_with("ok set "), "{answer:?}");
            twin.render(&mut [Frame::ZERO; 2 * TICK]);
            let index = param::index_of(param.path).expect("it is there");
            assert_eq!(twin.device().control().get(index), value, "{}", param.path);
            let answer = ask(&mut twin, &format!("get {}", param.path));
            assert_eq!(answer[1], format!("ok get {}", param.path));

            let request = Request::Set {
                values: [(param.id, value)].into_iter().collect(),
                ramp: Some(0.0),
            };
            let frames = send(&mut twin, 9, &request);
            let mut payload = [0; PAYLOAD_MAX];
            let (tag, reply) = read(&frames[0], &mut payload);
            assert!(matches!(reply, Reply::Done { at: Some(_) }) && tag == 9);
            let get = Request::Get([param.id].into_iter().collect());
            let frames = send(&mut twin, 10, &get);
            let mut payload = [0; PAYLOAD_MAX];
            let reply = read(&frames[0], &mut payload);
            assert_eq!(reply, (10, Reply::Value((param.id, value))));
        }
    }
}

#[test]
fn the_whole_table_comes_in_one_exchange() {
    let frames = send(&mut twin(), 3, &Request::List(""));
    assert_eq!(frames.len(), COUNT + 1);
    for (param, frame) in TABLE.iter().zip(&frames) {
        let mut payload = [0; PAYLOAD_MAX];
        let (3, Reply::Row(row)) = read(frame, &mut payload) else {
            panic!("expected a row");
        };
        assert_eq!((row.id, row.path), (param.id, param.path));
        assert_eq!((row.unit, row.about), (param.unit, param.about));
        assert_eq!(
            (row.range, row.default),
            ((param.min, param.max), param.default)
        );
    }
}

#[test]
fn what_is_set_is_heard_from_the_frame_that_the_reply_names_and_not_before() {
    let (mut one, mut two) = (twin(), twin());
    for twin in [&mut one, &mut two] {
        ask(twin, "scene brook");
        twin.render(&mut vec![Frame::ZERO; 48_000]);
    }
    let mut ahead = vec![Frame::ZERO; 77];
    for twin in [&mut one, &mut two] {
        twin.render(&mut ahead);
    }
    let answer = ask(&mut one, "set mix.level -20 0");
    let at: usize = answer[0]
        .rsplit_once(" at ")
        .expect("a frame")
        .1
        .parse()
        .expect("a number");
    let now = 48_000 + 77;
    assert!((now..now + 2 * TICK).contains(&at), "{at}");
    let mut sound = [vec![Frame::ZERO; 2000], vec![Frame::ZERO; 2000]];
    one.render(&mut sound[0]);
    two.render(&mut sound[1]);
    // The mix delays by 64 frames.
    let same = (sound[0].iter().zip(&sound[1]))
        .take_while(|(a, b)| a == b)
        .count();
    let heard = now + same;
    assert!((at + 64..at + 80).contains(&heard), "{heard} {at}");
}

#[test]
fn an_unknown_parameter_is_refused_by_itself() {
    let mut twin = twin();
    let answer = ask(&mut twin, "set water.rat=3 mix.level=-6 mix.tone=99 ramp=0");
    assert_eq!(
        answer[0],
        "error no parameter `water.rat`; did you mean `water.rate`?"
    );
    assert_eq!(
        answer[1],
        "error mix.tone cannot be 99; expected -24 to 24 dB"
    );
    assert!(answer[2].starts_with("ok set mix.level=-6 ramp=0 at "));
    let request = Request::Set {
        values: [(9999, 1.0), (501, -12.0)].into_iter().collect(),
        ramp: None,
    };
    let frames = send(&mut twin, 1, &request);
    let mut payload = [0; PAYLOAD_MAX];
    let reply = read(&frames[0], &mut payload).1;
    assert_eq!(reply, Reply::Skipped(Refusal::Id(9999)));
    let mut payload = [0; PAYLOAD_MAX];
    assert!(matches!(
        read(&frames[1], &mut payload).1,
        Reply::Done { at: Some(_) }
    ));
}

#[test]
fn faults_are_named() {
    let mut twin = twin();
    for (line, answer) in [
        ("sett a 1", "error no command `sett`; `help` lists them"),
        (
            "set level 3",
            "error no parameter `level`; did you mean `mix.level`?",
        ),
        (
            "set mix.level loud",
            "error mix.level cannot be loud; expected -80 to 24 dB",
        ),
        (
            "set water.classes 1.5",
            "error water.classes cannot be 1.5; expected a whole number from 1 to 64",
        ),
        (
            "set water.law bent",
            "error water.law cannot be bent; expected flat | power | custom",
        ),
        (
            "set mix.level -6 -1",
            "error a ramp of -1 s; expected 0 to 3600 s",
        ),
        (
            "set mix.level nan",
            "error mix.level cannot be NaN; expected -80 to 24 dB",
        ),
        (
            "scene nowhere",
            "error no scene `nowhere`; `scene` lists them",
        ),
        ("recall 3", "error nothing is stored in slot 3"),
        ("recall 17", "error no slot 17; expected 1 to 16"),
        ("recall", "error no settings were stored yet"),
        (
            "trigger 0.001",
            "error expected a radius of 0.15 to 150 mm, a pressure of 0 to 8 Pa, a rise factor of 0 to 20",
        ),
        ("mute maybe", "error expected mute [on or off]"),
        (
            "boot scene nowhere",
            "error no scene `nowhere`; `scene` lists them",
        ),
        ("get", "error expected get PATH [PATH …]"),
    ] {
        assert_eq!(ask(&mut twin, line), [answer], "{line}");
    }
}

#[test]
fn what_is_stored_comes_back() {
    let mut twin = twin();
    ask(&mut twin, "scene light-rain");
    ask(&mut twin, "set water.rate=123 mix.level=-9 ramp=0");
    let answer = ask(&mut twin, "store 3 my rain");
    assert!(answer[0].starts_with("pause of about 501 ms at "));
    assert!(answer[1].starts_with("ok store 3 my rain at "));
    assert!(ask(&mut twin, "store")[1].starts_with("ok store at "));
    ask(&mut twin, "scene river");
    let presets = ask(&mut twin, "presets");
    assert_eq!(presets[0], "settings = over light-rain");
    assert_eq!(presets[1], "preset 3 = my rain (over light-rain)");
    let answer = ask(&mut twin, "recall 3");
    assert_eq!(answer[0], "scene 8 = light-rain (plays)");
    assert!(answer.contains(&"mix.level = -9 dB".to_owned()));
    assert!(
        answer
            .last()
            .is_some_and(|line| line.starts_with("ok recall 3 at "))
    );
    // Another intensity still moves what it moves in that scene.
    twin.render(&mut vec![Frame::ZERO; 48_000]);
    let rate = param::index_of("water.rate").expect("known");
    assert_eq!(twin.device().control().get(rate), 123.0);
    let row = ask(&mut twin, "list mix.level");
    assert_eq!(
        row[0],
        "mix.level = -9 dB (default 0, stored -9, -80 to 24)"
    );

    assert_eq!(ask(&mut twin, "boot"), ["boot = default", "ok boot"]);
    assert!(ask(&mut twin, "boot preset 3")[1].starts_with("ok boot preset 3 at "));
    ask(&mut twin, "restart");
    twin.render(&mut [Frame::ZERO; 100 * TICK]);
    let greeting = String::from_utf8(twin.take()).expect("text");
    assert!(greeting.contains("mix.level = -9 dB\n"));
    let last = greeting.lines().last().unwrap_or_default();
    assert!(last.ends_with("at=128 scene=light-rain"), "{greeting}");
    assert_eq!(twin.device().control().get(rate), 123.0);
    ask(&mut twin, "erase 3");
    assert_eq!(
        ask(&mut twin, "recall 3"),
        ["error nothing is stored in slot 3"]
    );
}

#[test]
fn a_command_is_repeated_as_it_can_be_given_again() {
    for line in [
        "set water.rate=2000 mix.level=-6 ramp=0.5",
        "set water.law=flat",
        "scene river",
        "scene 4",
        "trigger 2.5 0.1",
        "mute off",
        "store 3 my rain",
        "store",
        "store 0 evening",
        "recall 0",
        "boot scene river",
        "boot settings",
        "get water.rate",
    ] {
        let request = parse(line, &mut |refusal| panic!("{refusal}")).expect(line);
        assert_eq!(request.to_string(), line);
    }
    let mut skip = |refusal: Refusal<'_>| panic!("{refusal}");
    assert_eq!(
        parse("boot default", &mut skip),
        Ok(Request::SetBoot(Boot::Default))
    );
    assert_eq!(
        parse("scene 3", &mut skip),
        Ok(Request::Scene(Choice::Number(3)))
    );
    assert_eq!(
        parse(" set  water.rate =  2000   0.5 ", &mut skip),
        parse("set water.rate=2000 ramp=0.5", &mut skip)
    );
}

#[test]
fn noise_costs_what_it_hit_and_nothing_after_the_next_delimiter() {
    let mut twin = twin();
    for noise in [
        &b"\x01\x01\xff\xff"[..],
        b"\x01get mix.level\xff",
        b"\xff\xfe\x80set",
        b"\x00\x00\x01\x01",
        &[b'x'; 2000],
    ] {
        twin.receive(noise);
        twin.receive(b"\0");
        twin.take();
        assert_eq!(ask(&mut twin, "get mix.level").len(), 2, "{noise:?}");
    }
    // A line feed ends what is not a frame, too.
    twin.receive(b"\xff\xfe\x80set\n");
    twin.take();
    assert_eq!(ask(&mut twin, "get mix.level").len(), 2);
    // And so does a tenth of a second of silence what is one.
    twin.receive(b"\x01\x01abc");
    twin.render(&mut [Frame::ZERO; 41 * TICK]);
    assert_eq!(ask(&mut twin, "get mix.level").len(), 2);
}

#[test]
fn a_listener_that_does_not_read_loses_replies_and_nothing_else() {
    let mut twin = twin();
    for n in 0..20_000 {
        twin.receive(format!("set mix.level {} 0\n", -(n % 80)).as_bytes());
    }
    twin.render(&mut [Frame::ZERO; 2 * TICK]);
    let level = param::index_of("mix.level").expect("known");
    assert_eq!(twin.device().control().get(level), -79.0);
    twin.take();
    let status = ask(&mut twin, "status");
    let dropped = status
        .iter()
        .find_map(|line| line.strip_prefix("dropped = "));
    let dropped: u32 = dropped.expect("counted").parse().expect("a number");
    assert!(dropped > 10_000, "{dropped}");
}

#[test]
fn mute_is_silence_and_moves_nothing() {
    let mut twin = twin();
    ask(&mut twin, "scene heavy-rain");
    twin.render(&mut vec![Frame::ZERO; 24_000]);
    ask(&mut twin, "mute");
    let mut sound = vec![Frame::ZERO; 24_000];
    twin.render(&mut sound);
    // 50 ms and the glide; after them the DC blocker lets go of its mean, which nobody hears.
    let loudest = |part: &[Frame]| part.iter().map(|frame| frame.left.abs()).max();
    assert!(
        loudest(&sound[19_200..]) < Some(2_000),
        "{:?}",
        loudest(&sound[19_200..])
    );
    ask(&mut twin, "mute off");
    twin.render(&mut sound);
    assert!(sound.iter().any(|frame| frame.left.abs() > 100_000));
}

#[test]
fn a_trigger_sounds_one_bubble() {
    let quiet = with(scene("[water]\nrate = 0"), "drops.rate", 0.0);
    let scenes = vec![("quiet".to_owned(), quiet)];
    let mut twin = Twin::new(Board::F407, 48_000, 7, scenes, Kept::default());
    twin.take();
    let answer = ask(&mut twin, "trigger 3 0.5 0.1");
    assert_eq!(answer, ["ok trigger 3 0.5 0.1 at 128"]);
    let mut sound = vec![Frame::ZERO; 4800];
    twin.render(&mut sound);
    let first = sound
        .iter()
        .position(|frame| frame.left.abs() > 1000)
        .expect("a sound");
    assert!((128 + 64..128 + 64 + 40).contains(&first), "{first}");
    assert_eq!(twin.device().player().stats().events, 1);
}

#[test]
fn telemetry_comes_as_often_as_it_was_asked_for() {
    let mut twin = twin();
    let frames = send(&mut twin, 5, &Request::Subscribe(10));
    let mut payload = [0; PAYLOAD_MAX];
    let reports = frames[1..]
        .iter()
        .filter(|frame| matches!(read(frame, &mut payload), (5, Reply::Status(_))));
    // What the last tick said was not fetched.
    assert_eq!(reports.count(), (2 * COUNT - 1) / 10);
}

#[test]
fn the_splitter_gives_back_every_frame_whatever_is_in_it() {
    let mut bytes = [0; 512];
    for ramp in 0..2000 {
        let values: Vec<Pair> = (0..ramp as u16 % 20)
            .map(|n| (n * 13, f32::from(n)))
            .collect();
        let request = Request::Set {
            values: values.into_iter().collect(),
            ramp: Some(ramp as f32),
        };
        let length = encode(&(ramp as u8, &request), &mut bytes).expect("it fits");
        let mut splitter = Splitter::new();
        let mut found = 0;
        for byte in &bytes[..length] {
            if let Some(Item::Frame(frame)) = splitter.push(*byte) {
                let mut payload = [0; PAYLOAD_MAX];
                let back: (Tag, Request<'_>) = decode(frame, &mut payload).expect("a request");
                assert_eq!(back, (ramp as u8, request.clone()));
                found += 1;
            }
        }
        assert_eq!(found, 1);
    }
}

/// Bytes as docs/protocol.md shows them.
fn shown(bytes: &[u8]) -> String {
    let bytes: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    bytes.join(" ")
}

#[test]
fn the_frames_of_the_documentation_are_true() {
    let docs = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/protocol.md"));
    let docs = docs.expect("docs/protocol.md");
    let mut bytes = [0; 512];
    let mut check = |message: &dyn Fn(&mut [u8]) -> usize| {
        let length = message(&mut bytes);
        let shown = shown(&bytes[..length]);
        assert!(docs.contains(&shown), "not in docs/protocol.md: {shown}");
    };
    let set = Request::Set {
        values: [(501, -6.0)].into_iter().collect(),
        ramp: None,
    };
    check(&|out| encode(&(1 as Tag, &set), out).expect("it fits"));
    let done = Reply::Done { at: Some(51_200) };
    check(&|out| encode(&(1 as Tag, &done), out).expect("it fits"));
    check(&|out| encode(&(2 as Tag, &Request::Hello), out).expect("it fits"));
}
