//! The bridge with real senders: OSC from an OSC library over UDP, MIDI as the bytes that a device sends, to a twin in this
//! program.

use std::io::{self, PipeWriter, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use freshet::param;
use freshet::protocol::{Choice, Device, Item, PAYLOAD_MAX, Request, SLOTS, Splitter, Tag, decode};
use freshet::{Frame, TICK};
use freshet_host::bridge::{Bridge, Inputs, Log, Mapping, Wanted, learn, parse_mapping, radius};
use freshet_host::client::{Client, Error, Link};
use freshet_host::twin::Twin;
use rosc::{OscBundle, OscMessage, OscPacket, OscType, decoder, encoder};

/// Whatever is waited for is there by then, on a busy machine too.
const PATIENCE: Duration = Duration::from_secs(20);

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until {
        if let Some(found) = look() {
            return found;
        }
        thread::sleep(Duration::from_millis(2));
    }
    panic!("{what}: not within {PATIENCE:?}");
}

/// A line to the twin that says what went over it, and can be cut.
struct Tap {
    twin: Arc<Mutex<Twin>>,
    sent: Arc<Mutex<Vec<String>>>,
    cut: Arc<AtomicBool>,
    splitter: Splitter,
}

impl Link for Tap {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.check()?;
        for byte in bytes {
            let Some(Item::Frame(frame)) = self.splitter.push(*byte) else {
                continue;
            };
            let mut payload = [0; PAYLOAD_MAX];
            let (_, request): (Tag, Request<'_>) = decode(frame, &mut payload).unwrap();
            locked(&self.sent).push(request.to_string());
        }
        self.twin.write(bytes)
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.check()?;
        self.twin.read(buffer, timeout)
    }
    fn name(&self) -> &str {
        "the tap"
    }
}

impl Tap {
    fn check(&self) -> io::Result<()> {
        if self.cut.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        Ok(())
    }
}

/// A bridge in this program, its board, and a sender.
struct Stage {
    twin: Arc<Mutex<Twin>>,
    sent: Arc<Mutex<Vec<String>>>,
    said: Arc<Mutex<Vec<String>>>,
    cut: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<anyhow::Result<()>>>,
    sender: UdpSocket,
    bridge: Option<SocketAddr>,
    midi: Option<PipeWriter>,
}

impl Stage {
    fn osc() -> Self {
        Self::new(true, None)
    }

    fn midi(mapping: Mapping) -> Self {
        Self::new(false, Some((mapping, None, Wanted::default())))
    }

    fn new(osc: bool, midi: Option<(Mapping, Option<PathBuf>, Wanted)>) -> Self {
        let twin = Arc::new(Mutex::new(Twin::example().unwrap()));
        let sent = Arc::new(Mutex::new(Vec::new()));
        let said = Arc::new(Mutex::new(Vec::new()));
        let [cut, stop] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let clock = {
            let (twin, stop) = (Arc::clone(&twin), Arc::clone(&stop));
            thread::spawn(move || {
                let tick = locked(&twin).tick_time();
                while !stop.load(Ordering::Relaxed) {
                    locked(&twin).render(&mut [Frame::ZERO; TICK]);
                    thread::sleep(tick);
                }
                Ok(())
            })
        };
        let opener = {
            let (twin, sent, cut) = (Arc::clone(&twin), Arc::clone(&sent), Arc::clone(&cut));
            Box::new(move || {
                if cut.load(Ordering::Relaxed) {
                    return Err(Error::Open {
                        port: "the tap".to_owned(),
                        reason: "it is cut".to_owned(),
                    });
                }
                Client::over(Tap {
                    twin: Arc::clone(&twin),
                    sent: Arc::clone(&sent),
                    cut: Arc::clone(&cut),
                    splitter: Splitter::new(),
                })
            })
        };
        let (mapping, map, wanted) =
            midi.clone()
                .unwrap_or((Mapping::default(), None, Wanted::default()));
        let (reader, writer) = io::pipe().unwrap();
        let inputs = Inputs {
            osc: osc.then(|| (SocketAddr::from(([127, 0, 0, 1], 0)), None)),
            midi: (midi.is_some()).then(|| Box::new(reader) as Box<dyn Read + Send>),
            mapping,
            map,
            wanted,
        };
        let log = {
            let said = Arc::clone(&said);
            Log::new(move |line| locked(&said).push(line.to_owned()))
        };
        let bridge = Bridge::new(opener, inputs, log).unwrap();
        let address = bridge.osc();
        let running = {
            let stop = Arc::clone(&stop);
            thread::spawn(move || bridge.run(&stop))
        };
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.set_read_timeout(Some(PATIENCE)).unwrap();
        Self {
            twin,
            sent,
            said,
            cut,
            stop,
            threads: vec![clock, running],
            sender,
            bridge: address,
            midi: midi.is_some().then_some(writer),
        }
    }

    fn datagram(&self, bytes: &[u8]) {
        self.sender.send_to(bytes, self.bridge.unwrap()).unwrap();
    }

    fn send(&self, addr: &str, args: impl IntoIterator<Item = OscType>) {
        let packet = message(addr, args);
        self.datagram(&encoder::encode(&packet).unwrap());
    }

    /// What is answered next.
    fn answer(&self) -> OscPacket {
        let mut buffer = [0; 1 << 16];
        let count = self.sender.recv(&mut buffer).expect("no answer");
        let (rest, packet) = decoder::decode_udp(&buffer[..count]).unwrap();
        assert!(rest.is_empty());
        packet
    }

    fn reply(&self) -> OscMessage {
        match self.answer() {
            OscPacket::Message(message) => message,
            OscPacket::Bundle(bundle) => panic!("{bundle:?}"),
        }
    }

    /// The next answer is an error about `address`.
    fn error(&self, address: &str) -> String {
        let OscMessage { addr, args } = self.reply();
        match (addr.as_str(), args.as_slice()) {
            ("/freshet/error", [OscType::String(about), OscType::String(text)]) => {
                assert_eq!(about, address);
                text.clone()
            }
            other => panic!("{other:?}"),
        }
    }

    fn play(&mut self, bytes: &[u8]) {
        self.midi.as_mut().unwrap().write_all(bytes).unwrap();
    }

    fn target(&self, index: usize) -> f32 {
        locked(&self.twin).device().control_mut().target(index)
    }

    fn wait_for_target(&self, index: usize, value: f32) {
        let path = param::TABLE[index].path;
        wait_for(&format!("{path} = {value}"), || {
            (self.target(index) == value).then_some(())
        });
    }

    fn wait_for_sent(&self, request: &str) {
        wait_for(request, || {
            let sent = locked(&self.sent);
            sent.iter().any(|sent| sent == request).then_some(())
        });
    }

    fn wait_for_said(&self, part: &str) -> String {
        wait_for(part, || {
            let said = locked(&self.said);
            said.iter().find(|line| line.contains(part)).cloned()
        })
    }

    fn sets(&self) -> Vec<String> {
        let sent = locked(&self.sent);
        let sets = sent.iter().filter(|request| request.starts_with("set "));
        sets.cloned().collect()
    }

    fn end(&mut self) -> anyhow::Result<()> {
        let mut result = Ok(());
        for thread in std::mem::take(&mut self.threads).into_iter().rev() {
            // The bridge comes first, and the clock is stopped after it.
            result = result.and(thread.join().unwrap());
            self.stop.store(true, Ordering::Relaxed);
        }
        result
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in std::mem::take(&mut self.threads) {
            let ended = thread.join();
            if !thread::panicking() {
                ended.unwrap().unwrap();
            }
        }
    }
}

fn message(addr: &str, args: impl IntoIterator<Item = OscType>) -> OscPacket {
    OscPacket::Message(OscMessage {
        addr: addr.to_owned(),
        args: args.into_iter().collect(),
    })
}

fn float(number: f32) -> [OscType; 1] {
    [OscType::Float(number)]
}

fn text(text: &str) -> [OscType; 1] {
    [OscType::String(text.to_owned())]
}

#[test]
fn what_is_sent_by_osc_arrives() {
    let stage = Stage::osc();
    stage.send("/freshet/water/rate", float(1234.0));
    stage.wait_for_target(param::RATE, 1234.0);
    stage.send("/freshet/water/law", text("custom"));
    stage.wait_for_target(param::LAW, 2.0);
    stage.send("/freshet/norm/mix/level", float(0.0));
    stage.wait_for_target(param::LEVEL, -80.0);
    stage.send(
        "/freshet/mix/level",
        [OscType::Int(-6), OscType::Float(0.5)],
    );
    stage.wait_for_sent("set mix.level=-6 ramp=0.5");

    stage.send("/freshet/scene", text("surf"));
    stage.wait_for_sent("scene surf");
    stage.send("/freshet/scene", [OscType::Int(2)]);
    stage.wait_for_sent("scene 2");
    stage.send("/freshet/trigger", [3.0, 0.5].map(OscType::Float));
    stage.wait_for_sent("trigger 3 0.5");
    stage.send("/freshet/mute", [OscType::Int(1)]);
    stage.wait_for_sent("mute on");
    stage.send("/freshet/mute", [OscType::Bool(false)]);
    stage.wait_for_sent("mute off");
    stage.send("/freshet/recall", float(3.0));
    assert_eq!(
        stage.error("/freshet/recall"),
        "nothing is stored in slot 3"
    );
}

#[test]
fn questions_are_answered_to_whoever_asked() {
    let stage = Stage::osc();
    stage.send("/freshet/hello", []);
    let hello = stage.reply();
    assert_eq!(hello.addr, "/freshet/hello");
    assert_eq!(hello.args[1], OscType::String("f407".to_owned()));
    stage.send("/freshet/scenes", []);
    assert!(stage.reply().args.len() > 5);
    stage.send(
        "/freshet/mix/width",
        [OscType::Float(0.25), OscType::Float(0.0)],
    );
    stage.wait_for_target(param::WIDTH, 0.25);
    thread::sleep(Duration::from_millis(20));
    stage.send("/freshet/get", text("mix/width"));
    let width = stage.reply();
    assert_eq!(
        (width.addr.as_str(), &width.args[..]),
        ("/freshet/mix/width", &float(0.25)[..])
    );
    stage.send("/freshet/get", []);
    let mut count = 0;
    while count < param::COUNT {
        match stage.answer() {
            OscPacket::Bundle(bundle) => count += bundle.content.len(),
            OscPacket::Message(_) => count += 1,
        }
    }
    assert_eq!(count, param::COUNT);

    stage.send("/freshet/subscribe", [OscType::Int(10)]);
    let OscPacket::Bundle(report) = stage.answer() else {
        panic!("no report")
    };
    let is_voices = |packet: &OscPacket| matches!(packet, OscPacket::Message(message) if message.addr == "/freshet/status/voices");
    assert!(report.content.iter().any(is_voices));
    stage.send("/freshet/subscribe", [OscType::Int(0)]);
    stage.wait_for_sent("subscribe 0");
}

#[test]
fn a_bundle_is_one_request() {
    let stage = Stage::osc();
    let content = vec![
        message("/freshet/scene", text("surf")),
        message("/freshet/water/rate", float(50.0)),
        message("/freshet/mix/level", float(-3.0)),
        OscPacket::Bundle(OscBundle {
            timetag: (0, 1).into(),
            content: vec![message("/freshet/water/gamma", float(4.0))],
        }),
        message("/freshet/nowhere", float(4.0)),
    ];
    let timetag = (0, 1).into();
    let bundle = OscPacket::Bundle(OscBundle { timetag, content });
    stage.datagram(&encoder::encode(&bundle).unwrap());
    stage.error("/freshet/nowhere");
    stage.wait_for_target(param::LEVEL, -3.0);
    let sent = locked(&stage.sent);
    let scene = sent.iter().position(|sent| sent == "scene surf").unwrap();
    let set = &sent[scene + 1];
    for pair in ["water.rate=50", "mix.level=-3", "water.gamma=4"] {
        assert!(set.starts_with("set ") && set.contains(pair), "{set}");
    }
}

#[test]
fn what_cannot_be_is_answered() {
    let stage = Stage::osc();
    stage.send("/freshet/water/rat", float(1.0));
    assert_eq!(
        stage.error("/freshet/water/rat"),
        "no such address; did you mean /freshet/water/rate?"
    );
    stage.send("/freshet/mix/level", float(f32::INFINITY));
    assert!(stage.error("/freshet/mix/level").contains("-80 to 24 dB"));
    stage.send("/freshet/scene", text("nowhere"));
    assert!(stage.error("/freshet/scene").contains("no scene `nowhere`"));
    stage.send("/freshet/trigger", float(1e9));
    assert!(stage.error("/freshet/trigger").contains("0.15 to 150 mm"));
    stage.datagram(b"hello");
    assert!(stage.error("").contains("not an OSC packet"));
    stage.wait_for_said("did you mean /freshet/water/rate?");
    // Not even an answer, or two bridges would talk for ever.
    stage.send("/freshet/error", text("what"));
    stage.send("/freshet/hello", []);
    assert_eq!(stage.reply().addr, "/freshet/hello");
}

#[test]
fn any_bytes_are_survived() {
    let stage = Stage::osc();
    let whole = OscPacket::Bundle(OscBundle {
        timetag: (0, 1).into(),
        content: vec![
            message("/freshet/water/gamma", float(1.0)),
            message("/freshet/get", text("water/rate")),
        ],
    });
    let whole = encoder::encode(&whole).unwrap();
    let mut state = 7_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) as usize
    };
    for i in 0..20_000 {
        let mut bytes = whole.clone();
        if i % 2 == 0 {
            bytes = (0..random() % 200).map(|_| random() as u8).collect();
        } else {
            for _ in 0..random() % 4 {
                let at = random() % bytes.len();
                bytes[at] = random() as u8;
            }
            bytes.truncate(random() % (bytes.len() + 1));
        }
        stage.datagram(&bytes);
        if i % 100 == 0 {
            thread::sleep(Duration::from_millis(1));
        }
    }
    thread::sleep(Duration::from_millis(100));
    stage.send("/freshet/mix/tone", float(3.0));
    stage.wait_for_target(param::TONE, 3.0);
    assert!(locked(&stage.said).len() < 500);
}

#[test]
fn of_a_flood_the_last_value_stays() {
    let stage = Stage::osc();
    let began = Instant::now();
    for i in 0..100_000 {
        stage.send("/freshet/water/rate", float(i as f32));
        // The system keeps a few hundred datagrams, no more.
        if i % 100 == 0 {
            thread::sleep(Duration::from_millis(1));
        }
    }
    thread::sleep(Duration::from_millis(100));
    stage.send("/freshet/water/rate", float(100_000.0));
    let took = began.elapsed();
    stage.wait_for_target(param::RATE, 100_000.0);
    let most = took.as_millis() / 5 + 2;
    let sets = stage.sets().len() as u128;
    assert!(sets > 5 && sets <= most, "{sets} requests in {took:?}");
}

#[test]
fn midi_bytes_play_the_board() {
    let mut stage = Stage::midi(
        parse_mapping(
            "map.toml",
            "[[cc]]\nchannel = 2\ncc = 74\nparam = \"mix.level\"\nrange = [-60, 0]\n\
             [[cc]]\ncc = 1\nparam = \"water.radius_max\"\n",
        )
        .unwrap(),
    );
    // Running status, the clock in between, another channel.
    stage.play(&[0xB1, 74, 0xF8, 127, 74, 0xFE, 0, 0xB0, 74, 127, 1, 127]);
    stage.wait_for_target(param::RADIUS_MAX, 150.0);
    stage.wait_for_target(param::LEVEL, -60.0);
    stage.play(&[0xC5, 3]);
    stage.wait_for_sent("scene 3");
    stage.play(&[0x90, 69, 127, 69, 0]);
    stage.wait_for_sent(&format!("trigger {} 1 0", radius(69).unwrap()));
    stage.play(&[0x90, 3, 127]);
    stage.wait_for_said("no bubble is lower than");

    for i in 0..100_000_u32 {
        stage.play(&[0xB1, 74, (i % 127) as u8]);
    }
    stage.play(&[0xB1, 74, 127]);
    drop(stage.midi.take());
    // The bytes end, and with them the bridge, when all is done.
    stage.end().unwrap();
    assert_eq!(stage.target(param::LEVEL), 0.0);
}

#[test]
fn a_controller_is_learnt() {
    let folder = Folder::new();
    let file = folder.0.join("map.toml");
    std::fs::write(&file, "# mine\nnotes = false\n").unwrap();
    let wanted = Wanted::default();
    wanted.push(param::LEVEL);
    wanted.push(param::GAMMA);
    let mut stage = Stage::new(
        false,
        Some((Mapping::default(), Some(file.clone()), wanted)),
    );
    // A bank, a command to the instrument: neither is a controller. The first one goes on moving.
    stage.play(&[0xB0, 0, 1, 123, 0, 20, 5, 20, 9, 20, 127]);
    stage.wait_for_target(param::LEVEL, 24.0);
    stage.play(&[0xB3, 21, 127]);
    stage.wait_for_target(param::GAMMA, 10.0);
    stage.wait_for_said("controller 20 of channel 1 moves mix.level");
    let kept = std::fs::read_to_string(&file).unwrap();
    assert!(kept.starts_with("# mine\n"), "{kept}");
    let mapping = parse_mapping("map.toml", &kept).unwrap();
    assert_eq!((mapping.rules.len(), mapping.notes), (2, None));
    assert_eq!(
        (mapping.rules[1].channel, mapping.rules[1].cc),
        (Some(4), 21)
    );
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 1);
    std::fs::write(&file, "[[cc]\n").unwrap();
    let error = learn(&file, 1, 2, param::LEVEL).unwrap_err().to_string();
    assert!(error.contains("map.toml:1:"), "{error}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "[[cc]\n");
}

#[test]
fn a_board_that_goes_away_is_found_again() {
    let stage = Stage::osc();
    stage.send("/freshet/mix/tone", float(1.0));
    stage.wait_for_target(param::TONE, 1.0);
    stage.cut.store(true, Ordering::Relaxed);
    stage.wait_for_said("is the board still plugged in?; looking for it");
    stage.send("/freshet/mix/tone", float(5.0));
    stage.send("/freshet/mix/tone", float(6.0));
    stage.send("/freshet/trigger", []);
    assert_eq!(stage.error("/freshet/trigger"), "the board is away");
    thread::sleep(Duration::from_millis(1500));
    assert_eq!(stage.target(param::TONE), 1.0);
    stage.cut.store(false, Ordering::Relaxed);
    // What was wanted last meanwhile.
    stage.wait_for_target(param::TONE, 6.0);
    stage.wait_for_said("the tap is back, playing");
    assert!(locked(&stage.said).len() < 10);
}

#[test]
fn the_slots_are_those_of_the_board() {
    let stage = Stage::osc();
    stage.send("/freshet/recall", [OscType::Int(i32::from(SLOTS) + 1)]);
    assert_eq!(
        stage.error("/freshet/recall"),
        "expected a slot from 0 to 16"
    );
    let mut twin = locked(&stage.twin);
    assert!(twin.device().number_of(Choice::Name("surf")).is_some());
}

/// A folder of its own, gone after the test.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("freshet-bridge-{}-{count}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
