//! OSC packets: what they want, and what is answered.
//!
//! Addresses mirror the parameters' paths, `/freshet/water/rate 2000`. Nothing here touches a socket.

use std::fmt::Display;

use freshet::control::RAMP_MAX;
use freshet::param::{self, Kind, Param, TABLE};
use freshet::protocol::{Refusal, SLOTS, Status};
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType};

use super::wish::{Command, Move, SceneChoice, Wish, along};
use crate::client::Hello;
use crate::scene_file;

/// What every address begins with.
pub const ROOT: &str = "/freshet/";

/// Deepest bundle in a bundle.
const DEPTH: u32 = 8;
/// Most arrays in a message; none is of use here.
const ARRAYS: usize = 16;
/// How far beyond 0 and 1 a slider may go, by rounding.
const SLACK: f32 = 1e-3;

/// What is wrong, and with which address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// As it came.
    pub address: String,
    /// For people.
    pub text: String,
}

/// What a packet wants, in order, all of it at once; and what of it cannot be.
pub fn read(packet: &[u8]) -> (Vec<Wish>, Vec<Problem>) {
    let (mut wishes, mut problems) = (Vec::new(), Vec::new());
    let damaged = |text: String| Problem {
        address: String::new(),
        text,
    };
    if !is_shallow(packet, 0) {
        let text = "a packet nested too deep".to_owned();
        return (wishes, vec![damaged(text)]);
    }
    match rosc::decoder::decode_udp(packet) {
        Ok((rest, packet)) => {
            open(packet, &mut wishes, &mut problems);
            if !rest.is_empty() {
                let text = format!("the last {} bytes of a packet are not OSC", rest.len());
                problems.push(damaged(text));
            }
        }
        Err(error) => problems.push(damaged(format!("not an OSC packet ({error})"))),
    }
    (wishes, problems)
}

/// Whether a packet can be unpacked, and dropped again, without going deep: both go as deep as the packet does.
fn is_shallow(packet: &[u8], depth: u32) -> bool {
    let Some(mut rest) = packet.strip_prefix(b"#bundle\0") else {
        return packet.iter().filter(|byte| **byte == b'[').count() <= ARRAYS;
    };
    if depth == DEPTH {
        return false;
    }
    rest = rest.get(8..).unwrap_or_default();
    while let Some((size, after)) = rest.split_first_chunk::<4>() {
        let size = u32::from_be_bytes(*size) as usize;
        let Some((element, after)) = after.split_at_checked(size) else {
            break;
        };
        if !is_shallow(element, depth + 1) {
            return false;
        }
        rest = after;
    }
    true
}

fn open(packet: OscPacket, wishes: &mut Vec<Wish>, problems: &mut Vec<Problem>) {
    match packet {
        OscPacket::Bundle(bundle) => {
            for packet in bundle.content {
                open(packet, wishes, problems);
            }
        }
        OscPacket::Message(message) => match wish(&message) {
            Ok(wish) => wishes.extend(wish),
            Err(text) => problems.push(Problem {
                address: message.addr,
                text,
            }),
        },
    }
}

/// What a message wants; none where it is best not even answered.
fn wish(message: &OscMessage) -> Result<Option<Wish>, String> {
    let path = (message.addr.strip_prefix(ROOT))
        .ok_or_else(|| format!("no such address; all begin with {ROOT}"))?;
    let args = message.args.as_slice();
    let command = match path {
        // Two bridges that talk to each other would go on for ever.
        "error" => return Ok(None),
        "scene" => scene(args)?,
        "trigger" => trigger(args)?,
        "mute" => Command::Mute(mute(args)?),
        "recall" => recall(args)?,
        "get" => get(args)?,
        "subscribe" => subscribe(args)?,
        "hello" => nothing(args, Command::Hello)?,
        "scenes" => nothing(args, Command::Scenes)?,
        _ => return Ok(Some(Wish::Move(set(path, args)?))),
    };
    Ok(Some(Wish::Command(command)))
}

fn set(path: &str, args: &[OscType]) -> Result<Move, String> {
    let (path, norm) = match path.strip_prefix("norm/") {
        Some(path) => (path, true),
        None => (path, false),
    };
    let param = &TABLE[index(path)?];
    let expected = || {
        if norm {
            "expected a number from 0 to 1, and perhaps a ramp in seconds".to_owned()
        } else {
            let expectation = scene_file::expectation(param);
            format!("expected {expectation}, and perhaps a ramp in seconds")
        }
    };
    let (first, ramp) = match args {
        [first] => (first, None),
        [first, ramp] => (first, Some(number(ramp).ok_or_else(expected)?)),
        _ => return Err(expected()),
    };
    if let Some(seconds) = ramp.filter(|seconds| !(0.0..=RAMP_MAX).contains(seconds)) {
        return Err(Refusal::Ramp(seconds).to_string());
    }
    let value = if norm {
        let x = number(first).ok_or_else(expected)?;
        if !(-SLACK..=1.0 + SLACK).contains(&x) {
            return Err(format!("{x}: {}", expected()));
        }
        along(param, x)
    } else {
        value(param, first).ok_or_else(expected)?
    };
    if !param.accepts(value) {
        return Err(Refusal::Value(param.id, value).to_string());
    }
    let id = param.id;
    Ok(Move { id, value, ramp })
}

/// The parameter that an address means.
fn index(path: &str) -> Result<usize, String> {
    let path = path.replace('/', ".");
    param::index_of(&path).ok_or_else(|| {
        let near = scene_file::nearest(&path, TABLE.iter().map(|param| param.path));
        match near {
            Some(near) => format!(
                "no such address; did you mean {ROOT}{}?",
                near.replace('.', "/")
            ),
            None => "no such address".to_owned(),
        }
    })
}

fn value(param: &Param, arg: &OscType) -> Option<f32> {
    if let OscType::String(text) = arg {
        if text == "default" {
            return Some(param.default);
        }
        if let Kind::Choice(names) = param.kind
            && let Some(index) = names.iter().position(|name| name == text)
        {
            return Some(index as f32);
        }
    }
    number(arg)
}

/// A number, as whoever sends it has it.
fn number(arg: &OscType) -> Option<f32> {
    match arg {
        OscType::Int(number) => Some(*number as f32),
        OscType::Long(number) => Some(*number as f32),
        OscType::Float(number) => Some(*number),
        OscType::Double(number) => Some(*number as f32),
        OscType::Bool(on) => Some(f32::from(*on)),
        OscType::String(text) => text.trim().parse().ok(),
        _ => None,
    }
}

/// A whole number.
fn whole<T: TryFrom<i64>>(arg: &OscType) -> Option<T> {
    let number = match arg {
        OscType::Long(number) => *number,
        OscType::Int(number) => i64::from(*number),
        arg => {
            let number = number(arg)?;
            if number.fract() != 0.0 || number.abs() > 1e9 {
                return None;
            }
            number as i64
        }
    };
    T::try_from(number).ok()
}

fn scene(args: &[OscType]) -> Result<Command, String> {
    let expected = || "expected the name or the number of a scene".to_owned();
    let [choice] = args else {
        return Err(expected());
    };
    let choice = match (whole(choice), choice) {
        (Some(number), _) => SceneChoice::Number(number),
        (None, OscType::String(name)) => SceneChoice::Name(name.clone()),
        _ => return Err(expected()),
    };
    Ok(Command::Scene(choice))
}

fn trigger(args: &[OscType]) -> Result<Command, String> {
    let expected = || {
        "expected nothing, or a radius in mm, a pressure in Pa, a rise factor, in this order"
            .to_owned()
    };
    let mut bubble = [None; 3];
    for (i, arg) in args.iter().enumerate() {
        let number = number(arg).filter(|number| number.is_finite());
        let place = bubble.get_mut(i).ok_or_else(expected)?;
        *place = Some(number.ok_or_else(expected)?);
    }
    Ok(Command::Trigger(bubble))
}

fn mute(args: &[OscType]) -> Result<bool, String> {
    let word = |arg: &OscType| match arg {
        OscType::String(text) if text == "on" => Some(true),
        OscType::String(text) if text == "off" => Some(false),
        arg => whole::<u8>(arg).filter(|on| *on < 2).map(|on| on == 1),
    };
    match args {
        [] => Some(true),
        [arg] => word(arg),
        _ => None,
    }
    .ok_or_else(|| "expected 0 or 1".to_owned())
}

fn recall(args: &[OscType]) -> Result<Command, String> {
    match args {
        [] => Some(0),
        [slot] => whole(slot).filter(|slot| *slot <= SLOTS),
        _ => None,
    }
    .map(Command::Recall)
    .ok_or_else(|| format!("expected a slot from 0 to {SLOTS}"))
}

fn get(args: &[OscType]) -> Result<Command, String> {
    let ids = args.iter().map(|arg| match arg {
        OscType::String(path) => {
            let path = path.strip_prefix(ROOT).unwrap_or(path);
            Ok(TABLE[index(path.trim_matches('/'))?].id)
        }
        _ => Err("expected paths such as water/rate, or nothing for all".to_owned()),
    });
    ids.collect::<Result<_, _>>().map(Command::Get)
}

fn subscribe(args: &[OscType]) -> Result<Command, String> {
    match args {
        [ticks] => whole(ticks).map(Command::Subscribe),
        _ => None,
    }
    .ok_or_else(|| {
        format!(
            "expected the ticks between two reports, 0 to {}; 0: no more",
            u16::MAX
        )
    })
}

fn nothing(args: &[OscType], command: Command) -> Result<Command, String> {
    if args.is_empty() {
        Ok(command)
    } else {
        Err("expected no argument".to_owned())
    }
}

fn message(path: impl Display, args: Vec<OscType>) -> OscPacket {
    OscPacket::Message(OscMessage {
        addr: format!("{ROOT}{path}"),
        args,
    })
}

/// As bytes; none where it cannot be told in OSC.
fn bytes(packet: &OscPacket) -> Vec<u8> {
    rosc::encoder::encode(packet).unwrap_or_default()
}

/// `/freshet/error ADDRESS TEXT`.
pub fn error(address: &str, text: &str) -> Vec<u8> {
    // A terminator in the middle would end the text.
    let args = [address, text].map(|text| OscType::String(text.replace('\0', " ")));
    bytes(&message("error", args.into()))
}

/// The values of parameters as messages that would set them, in one bundle or several.
pub fn values(pairs: &[(u16, f32)]) -> Vec<Vec<u8>> {
    let messages = pairs.iter().filter_map(|(id, value)| {
        let path = TABLE[param::index_of_id(*id)?].path.replace('.', "/");
        Some(message(path, vec![OscType::Float(*value)]))
    });
    let messages: Vec<_> = messages.collect();
    if let [single] = messages.as_slice() {
        return vec![bytes(single)];
    }
    // Each within the length that any network takes in one piece.
    let bundles = messages.chunks(24).map(|content| bundle(content.to_vec()));
    bundles.collect()
}

fn bundle(content: Vec<OscPacket>) -> Vec<u8> {
    // At once.
    let timetag = OscTime {
        seconds: 0,
        fractional: 1,
    };
    bytes(&OscPacket::Bundle(OscBundle { timetag, content }))
}

/// `/freshet/hello VERSION BOARD RATE SCENE`.
pub fn hello(hello: &Hello) -> Vec<u8> {
    let args = vec![
        OscType::String(hello.version.clone()),
        OscType::String(hello.board.clone()),
        OscType::Float(hello.rate),
        OscType::String(hello.scene.clone()),
    ];
    bytes(&message("hello", args))
}

/// `/freshet/scenes NAME NAME …`.
pub fn scenes(names: impl Iterator<Item = String>) -> Vec<u8> {
    bytes(&message("scenes", names.map(OscType::String).collect()))
}

/// How things stand: a bundle of `/freshet/status/…`, a number each.
pub fn status(status: &Status<'_>) -> Vec<u8> {
    let count = |number: u64| OscType::Int(i32::try_from(number).unwrap_or(i32::MAX));
    let small = |number: u32| count(number.into());
    let mut content = vec![
        ("load", OscType::Float(status.load)),
        ("peak", OscType::Float(status.peak)),
        ("voices", small(status.voices.into())),
        ("births", count(status.births)),
        ("stolen", small(status.stolen)),
        ("unvoiced", small(status.unvoiced)),
        ("limited", small(status.limited)),
        ("clipped", small(status.clipped)),
        ("underruns", small(status.underruns)),
        ("restarts", small(status.restarts)),
        ("missed", small(status.missed)),
        ("overruns", small(status.overruns)),
        ("framing", small(status.framing)),
        ("garbage", small(status.garbage)),
        ("dropped", small(status.dropped)),
        ("uptime", small(status.uptime)),
        ("trouble", OscType::Int(status.trouble.into())),
    ];
    if let Some(celsius) = status.temperature {
        content.push(("temperature", OscType::Float(celsius)));
    }
    let messages = content
        .into_iter()
        .map(|(name, arg)| message(format_args!("status/{name}"), vec![arg]));
    bundle(messages.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(addr: &str, args: Vec<OscType>) -> Vec<u8> {
        let addr = addr.to_owned();
        bytes(&OscPacket::Message(OscMessage { addr, args }))
    }

    fn one(addr: &str, args: Vec<OscType>) -> Wish {
        let (mut wishes, problems) = read(&packet(addr, args));
        assert_eq!(problems, []);
        wishes.remove(0)
    }

    fn problem(addr: &str, args: Vec<OscType>) -> String {
        let (wishes, mut problems) = read(&packet(addr, args));
        assert_eq!(wishes, []);
        assert_eq!(problems[0].address, addr);
        problems.remove(0).text
    }

    #[test]
    fn no_parameter_has_the_name_of_a_command() {
        for param in &TABLE {
            let path = param.path.replace('.', "/");
            let address = format!("{ROOT}{path}");
            let wish = one(&address, vec![OscType::Float(param.default)]);
            assert!(matches!(wish, Wish::Move(set) if set.id == param.id));
        }
    }

    #[test]
    fn numbers_come_as_anything() {
        let rate = |arg| one("/freshet/water/rate", vec![arg]);
        let wanted = rate(OscType::Float(2000.0));
        for arg in [
            OscType::Int(2000),
            OscType::Long(2000),
            OscType::Double(2000.0),
            OscType::String("2000".to_owned()),
        ] {
            assert_eq!(rate(arg), wanted);
        }
        let law = |arg| one("/freshet/water/law", vec![arg]);
        assert_eq!(
            law(OscType::String("custom".to_owned())),
            law(OscType::Int(2))
        );
        let limiter = |arg| one("/freshet/mix/limiter", vec![arg]);
        assert_eq!(limiter(OscType::Bool(true)), limiter(OscType::Int(1)));
        let choice = |arg| one("/freshet/scene", vec![arg]);
        assert_eq!(
            choice(OscType::Float(3.0)),
            Wish::Command(Command::Scene(SceneChoice::Number(3)))
        );
    }

    #[test]
    fn a_slider_goes_along_the_curve() {
        let norm = |x| match one("/freshet/norm/water/radius_min", vec![OscType::Float(x)]) {
            Wish::Move(set) => set.value,
            Wish::Command(_) => panic!("no move"),
        };
        assert_eq!((norm(0.0), norm(1.0)), (0.15, 150.0));
        assert!((norm(0.5) - 4.743).abs() < 0.01);
        assert_eq!(norm(1.000_1), 150.0);
        let far = problem("/freshet/norm/water/rate", vec![OscType::Float(1.5)]);
        assert!(far.contains("from 0 to 1"), "{far}");
    }

    #[test]
    fn problems_are_told() {
        let float = |number| vec![OscType::Float(number)];
        let told = [
            (
                "/water/rate",
                float(1.0),
                "no such address; all begin with /freshet/",
            ),
            (
                "/freshet/water/rat",
                float(1.0),
                "no such address; did you mean /freshet/water/rate?",
            ),
            (
                "/freshet/mix/level",
                float(99.0),
                "mix.level cannot be 99; expected -80 to 24 dB",
            ),
            (
                "/freshet/mix/level",
                float(f32::NAN),
                "mix.level cannot be NaN; expected -80 to 24 dB",
            ),
            (
                "/freshet/mix/level",
                vec![],
                "expected a number from -80 to 24 dB, and perhaps a ramp in seconds",
            ),
            (
                "/freshet/recall",
                float(17.0),
                "expected a slot from 0 to 16",
            ),
            ("/freshet/mute", float(2.0), "expected 0 or 1"),
        ];
        for (address, args, text) in told {
            assert_eq!(problem(address, args), text);
        }
    }

    #[test]
    fn depth_is_refused_before_it_is_entered() {
        let mut packet = packet("/freshet/mute", vec![]);
        for _ in 0..3000 {
            let mut outer = b"#bundle\0\0\0\0\0\0\0\0\x01".to_vec();
            outer.extend((packet.len() as u32).to_be_bytes());
            outer.extend(packet);
            packet = outer;
        }
        assert_eq!(read(&packet).1[0].text, "a packet nested too deep");
        let mut arrays = b"/freshet/mute\0\0\0,".to_vec();
        arrays.extend([b'['; 60_000]);
        arrays.extend([0; 4]);
        assert_eq!(read(&arrays).1[0].text, "a packet nested too deep");
    }

    #[test]
    fn a_bundle_is_one_wish_after_the_other() {
        let float = |number| vec![OscType::Float(number)];
        let content = vec![
            message("scene", vec![OscType::String("surf".to_owned())]),
            message("water/rate", float(5.0)),
            OscPacket::Bundle(OscBundle {
                timetag: (0, 1).into(),
                content: vec![message("mix/level", float(-6.0))],
            }),
            message("nowhere", float(1.0)),
        ];
        let (wishes, problems) = read(&bundle(content));
        assert_eq!((wishes.len(), problems.len()), (3, 1));
    }
}
