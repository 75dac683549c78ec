//! Whatever comes in, nothing breaks: lines, frames, banks and stored settings made of noise and of what is nearly right.
//!
//! Each test runs its corpus (`tests/__fuzz__/NAME/corpus`) and then so many random inputs; a failure names its seed.
//! A long run: `BOLERO_RANDOM_ITERATIONS=1000000000 cargo test --release --test fuzz`.

use bolero::check;
use freshet::bank::{Bank, Boot, HEADER, checksum};
use freshet::control::Control;
use freshet::param::TABLE;
use freshet::profile::{F411, Profile};
use freshet::protocol::{
    BootRecord, Device, FRAME_MAX, FrameError, Hello, Item, Job, Line, PAYLOAD_MAX, Preset,
    Refusal, Reply, Request, Shell, Slot, Splitter, Status, Tag, decode, encode, parse,
};
use freshet::scene::Scene;
use freshet_host::bank;

/// Pieces that noise is mixed with: an input's bytes from 128 on stand for one of these each.
const PIECES: [&[u8]; 96] = [
    b"set ",
    b"get ",
    b"list ",
    b"describe ",
    b"scene ",
    b"trigger ",
    b"mute ",
    b"store ",
    b"recall ",
    b"boot ",
    b"erase ",
    b"status",
    b"version",
    b"help ",
    b"presets",
    b"restart",
    b"\n",
    b"\r\n",
    b"\0",
    b"\0\x01\x01",
    b"=",
    b" ",
    b"ramp=",
    b" in ",
    b"default",
    b"on",
    b"off",
    b"settings",
    b"preset ",
    b"water.rate",
    b"water.law",
    b"water.classes",
    b"water.weight.64",
    b"water.weight.65",
    b"mix.level",
    b"mix.limiter",
    b"intensity",
    b"water",
    b"mix.",
    b"flat",
    b"custom",
    b"river",
    b"brook",
    b"0",
    b"1",
    b"-6",
    b"3.5",
    b"1e9",
    b"-1e-40",
    b"nan",
    b"inf",
    b"-0",
    b"99999999999999999999",
    b"65535",
    b"65536",
    b"17",
    b"16",
    b"0.15",
    b"=2000 ",
    b"set mix.level=-6\n",
    b"set water.rate 10 1\n",
    b"recall 1\n",
    b"store 1 a b\n",
    b"scene 0\n",
    b"boot preset 1\n",
    b"list\n",
    b"get water.rate mix.level\n",
    b"trigger 3 0.1\n",
    b"mute\n",
    b"\x01",
    b"\x01\x01\x01",
    b"\x7f",
    b"\x08",
    b"\t",
    b"\xff",
    b"\xc3\xa4",
    b"\x01\x01\x03\x05\x01\x01\x01",
    b"\x02",
    b"\x03",
    b"\x04",
    b"\x05",
    b"\x06",
    b"\x07",
    b"\x0a",
    b"\x0b",
    b"\x0c",
    b"\x0d",
    b"\x0e",
    b"\x0f",
    b"\x10",
    b"\x11",
    b"\x12",
    b"\x13",
    b"\x14",
    b"\x15",
    b"\x16",
];

/// The stream of bytes that an input stands for.
fn unpack(input: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    for byte in input {
        match byte
            .checked_sub(128)
            .and_then(|n| PIECES.get(usize::from(n)))
        {
            Some(piece) => out.extend_from_slice(piece),
            None => out.push(*byte),
        }
    }
    out
}

/// A device with nothing behind it but its parameters.
struct Bare {
    control: Control,
    scenes: [(&'static str, Scene); 2],
    kept: [Option<Preset>; 17],
    playing: u16,
    boot: BootRecord,
}

impl Bare {
    fn new() -> Self {
        let scene = Scene::default();
        Self {
            control: Control::new(&scene, 48_000, F411::LIMITS, 1),
            scenes: [("brook", scene.clone()), ("river", scene)],
            kept: [const { None }; 17],
            playing: 0,
            boot: BootRecord::Default,
        }
    }
}

impl Device for Bare {
    fn control(&self) -> &Control {
        &self.control
    }
    fn control_mut(&mut self) -> &mut Control {
        &mut self.control
    }
    fn date(&self) -> u64 {
        u64::MAX
    }
    fn hello(&self) -> Hello<'_> {
        Hello {
            version: "0",
            board: "none",
            rate: 48_000.0,
            seed: 0,
            schema: 0,
            scene: "",
            at: 0,
        }
    }
    fn status(&self) -> Status<'_> {
        Status::default()
    }
    fn scene(&self, number: u16) -> Option<(&str, Scene)> {
        self.scenes.get(usize::from(number)).cloned()
    }
    fn playing(&self) -> u16 {
        self.playing
    }
    fn set_playing(&mut self, number: u16) {
        self.playing = number;
    }
    fn stored(&self) -> Option<&Preset> {
        self.kept[0].as_ref()
    }
    fn preset(&self, slot: Slot) -> Option<Preset> {
        self.kept[usize::from(slot)].clone()
    }
    fn boot(&self) -> BootRecord {
        self.boot.clone()
    }
    fn begin(&mut self, job: Job<'_>) -> Result<Option<u32>, Refusal<'static>> {
        match job {
            Job::Store(slot, preset) => self.kept[usize::from(slot)] = Some(preset.clone()),
            Job::Erase(slot) => self.kept[usize::from(slot)] = None,
            Job::Boot(boot) => self.boot = boot.clone(),
            Job::Restart => {}
        }
        Ok(None)
    }
}

/// What is found in `bytes`, each a line or a frame.
fn found(splitter: &mut Splitter, bytes: &[u8]) -> Vec<Result<String, Vec<u8>>> {
    let mut all = Vec::new();
    for byte in bytes {
        match splitter.push(*byte) {
            Some(Item::Line(line)) => all.push(Ok(line.to_owned())),
            Some(Item::Frame(frame)) => all.push(Err(frame.to_vec())),
            Some(Item::Garbage) | None => {}
        }
    }
    all
}

#[test]
fn after_any_noise_a_delimiter_brings_lines_and_frames_back() {
    let mut frame = [0; FRAME_MAX + 3];
    let length = encode(&(7 as Tag, Request::Status), &mut frame).expect("it fits");
    let frame = frame[..length].to_vec();
    check!(name = "splitter")
        .with_iterations(3_000_000)
        .for_each(|input: &[u8]| {
            let mut splitter = Splitter::new();
            found(&mut splitter, &unpack(input));
            splitter.push(0);
            let line = [Ok("get mix.level".to_owned())];
            assert_eq!(found(&mut splitter, b"get mix.level\n"), line);
            let inner = frame[1..length - 1].to_vec();
            assert_eq!(found(&mut splitter, &frame), [Err(inner)]);
        });
}

#[test]
fn any_line_is_read_or_refused_in_words_and_what_is_read_can_be_said_again() {
    check!(name = "lines")
        .with_iterations(3_000_000)
        .for_each(|input: &[u8]| {
            let bytes = unpack(input);
            let text = String::from_utf8_lossy(&bytes);
            let mut refused = 0;
            let mut skip = |refusal: Refusal<'_>| {
                refused += 1;
                assert!(!refusal.to_string().is_empty());
            };
            match parse(&text, &mut skip) {
                Ok(request) => {
                    let said = request.to_string();
                    let again = parse(&said, &mut |refusal| panic!("{said}: {refusal}"));
                    match (&request, again) {
                        // All that was to be set was refused.
                        (Request::Set { values, .. }, Err(_)) => assert!(values.is_empty()),
                        // What is not a number is not itself.
                        (_, Ok(again)) => assert_eq!(format!("{again:?}"), format!("{request:?}")),
                        (_, Err(refusal)) => panic!("{said}: {refusal}"),
                    }
                }
                Err(refusal) => assert!(!refusal.to_string().is_empty()),
            }
        });
}

#[test]
fn any_frame_is_read_or_refused() {
    check!(name = "frames")
        .with_iterations(3_000_000)
        .for_each(|input: &[u8]| {
            let mut payload = [0; PAYLOAD_MAX];
            let _ = decode::<(Tag, Request<'_>)>(input, &mut payload);
            // With a checksum that fits, it comes as far as the message.
            let mut bytes = [0; FRAME_MAX + 3];
            let raw = &input[..input.len().min(250)];
            let length = encode(&Raw(raw), &mut bytes).expect("it fits");
            let mut payload = [0; PAYLOAD_MAX];
            let frame = &bytes[1..length - 1];
            match decode::<(Tag, Request<'_>)>(frame, &mut payload) {
                Ok((tag, request)) => {
                    let mut again = [0; FRAME_MAX + 3];
                    let _ = encode(&(tag, &request), &mut again);
                    assert!(!request.to_string().is_empty());
                }
                Err(error) => assert_eq!(error, FrameError::Message),
            }
            let mut payload = [0; PAYLOAD_MAX];
            if let Ok((_, reply)) = decode::<(Tag, Reply<'_>)>(frame, &mut payload) {
                let _ = Line(&reply, &Request::Hello).to_string();
            }
        });
}

/// Bytes as they are, without a length before them.
struct Raw<'a>(&'a [u8]);

impl serde::Serialize for Raw<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeTuple;
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        self.0
            .iter()
            .try_for_each(|byte| tuple.serialize_element(byte))?;
        tuple.end()
    }
}

#[test]
fn a_device_answers_whatever_it_is_told() {
    check!(name = "shell")
        .with_iterations(50_000)
        .with_max_len(256)
        .for_each(|input: &[u8]| {
            let mut device = Bare::new();
            let mut shell = Shell::<4096>::new();
            for chunk in unpack(input).chunks(13) {
                shell.receive(chunk, &mut device);
                shell.tick(&device);
                shell.out().take(&mut [0; 64]);
            }
            shell.receive(b"\0", &mut device);
            while !shell.out().is_empty() || shell.lists() {
                shell.out().take(&mut [0; 4096]);
                shell.tick(&device);
            }
            shell.receive(b"get mix.level\n", &mut device);
            let mut answer = [0; 256];
            let length = shell.out().take(&mut answer);
            let answer = std::str::from_utf8(&answer[..length]).expect("text");
            assert!(answer.ends_with("ok get mix.level\n"), "{answer}");
            for (index, param) in TABLE.iter().enumerate() {
                let value = device.control.get(index);
                assert!(param.accepts(value), "{} is {value}", param.path);
            }
        });
}

#[test]
fn any_bank_is_opened_or_refused() {
    let scene = Scene::default();
    let whole =
        bank::write(&[("a", scene.clone()), ("b", scene)], Boot::default()).expect("a bank");
    check!(name = "bank")
        .with_iterations(1_000_000)
        .for_each(|input: &[u8]| {
            if let Ok(bank) = Bank::open(input) {
                read_all(&bank);
            }
            // Two bytes each: where to change the good one, and into what. Its checksum is made to fit again.
            let mut bytes = whole.clone();
            for change in input.chunks_exact(2) {
                let at = usize::from(change[0]) % bytes.len();
                bytes[at] = change[1];
            }
            let check = checksum(&bytes[..12], &bytes[HEADER..]).to_le_bytes();
            bytes[12..16].copy_from_slice(&check);
            if let Ok(bank) = Bank::open(&bytes) {
                read_all(&bank);
            }
        });
}

fn read_all(bank: &Bank<'_>) {
    for number in 0..bank.scenes() {
        let (name, _) = bank.scene(number).expect("it was checked");
        assert!(!name.is_empty());
    }
    assert!(bank.scene(bank.scenes()).is_none());
}

#[test]
fn any_settings_are_read_or_refused() {
    check!(name = "settings")
        .with_iterations(1_000_000)
        .for_each(|input: &[u8]| {
            if let Ok(preset) = postcard::from_bytes::<Preset>(input) {
                let scene = preset.over(Scene::default());
                for &(index, value) in &scene.values {
                    assert!(TABLE[index].accepts(value));
                }
            }
        });
}
