//! `freshet bridge` as a person meets it: against `freshet simulate`, and what it says where something is wrong.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use rosc::{OscMessage, OscPacket, OscType, decoder, encoder};

const PATIENCE: Duration = Duration::from_secs(30);

/// `freshet` running, and what it says line by line.
struct Running {
    child: Child,
    said: Receiver<String>,
}

impl Running {
    fn start(words: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_freshet"))
            .args(words)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (tell, said) = channel();
        let tell_too = tell.clone();
        let (out, err) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
        thread::spawn(move || {
            let lines = BufReader::new(out).lines();
            lines
                .map_while(Result::ok)
                .try_for_each(|line| tell.send(line))
        });
        thread::spawn(move || {
            let lines = BufReader::new(err).lines();
            lines
                .map_while(Result::ok)
                .try_for_each(|line| tell_too.send(line))
        });
        Self { child, said }
    }

    fn line(&self, part: &str) -> String {
        let until = Instant::now() + PATIENCE;
        let mut others = Vec::new();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.said.recv_timeout(left) {
                Ok(line) if line.contains(part) => return line,
                Ok(line) => others.push(line),
                Err(error) => panic!("no line with {part:?} ({error}), only {others:?}"),
            }
        }
    }

    /// A board's twin, and its port.
    fn twin() -> (Self, String) {
        let twin = Self::start(&["simulate"]);
        let port = twin.line("/dev/");
        let port = port
            .split_whitespace()
            .find(|word| word.starts_with("/dev/"));
        let port = port.unwrap().to_owned();
        (twin, port)
    }

    fn ends(&mut self) -> Option<i32> {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("it goes on")
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn error(words: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_freshet"))
        .arg("bridge")
        .args(words)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{words:?}");
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

fn temporary(name: &str, content: &str) -> PathBuf {
    let name = format!("freshet-{}-{name}", std::process::id());
    let path = std::env::temp_dir().join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// The value in the next answer.
fn asked(socket: &UdpSocket, path: &str) -> f32 {
    let packet = OscPacket::Message(OscMessage {
        addr: "/freshet/get".to_owned(),
        args: vec![OscType::String(path.to_owned())],
    });
    socket.send(&encoder::encode(&packet).unwrap()).unwrap();
    let mut buffer = [0; 2048];
    let count = socket.recv(&mut buffer).unwrap();
    match decoder::decode_udp(&buffer[..count]).unwrap().1 {
        OscPacket::Message(OscMessage { args, .. }) => match args.as_slice() {
            [OscType::Float(value)] => *value,
            other => panic!("{other:?}"),
        },
        OscPacket::Bundle(bundle) => panic!("{bundle:?}"),
    }
}

fn wait_for_value(socket: &UdpSocket, path: &str, wanted: f32) {
    let until = Instant::now() + PATIENCE;
    loop {
        let value = asked(socket, path);
        if (value - wanted).abs() <= wanted.abs() * 1e-4 {
            return;
        }
        assert!(Instant::now() < until, "{path} is {value}, not {wanted}");
        thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn osc_and_midi_reach_a_simulated_board() {
    let (twin, port) = Running::twin();
    let map = temporary("play.toml", "[[cc]]\ncc = 20\nparam = \"mix.tone\"\n");
    let map_path = map.to_str().unwrap();
    let mut bridge = Running::start(&[
        "bridge",
        &port,
        "--osc",
        "127.0.0.1:0",
        "--midi",
        "-",
        "--map",
        map_path,
    ]);
    let line = bridge.line("hears OSC at ");
    let address = line.split("OSC at ").nth(1).unwrap();
    let address = address
        .split_whitespace()
        .next()
        .unwrap()
        .trim_end_matches(';');
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    socket.connect(address).unwrap();

    let packet = OscPacket::Message(OscMessage {
        addr: "/freshet/water/rate".to_owned(),
        args: vec![OscType::Float(321.0)],
    });
    socket.send(&encoder::encode(&packet).unwrap()).unwrap();
    wait_for_value(&socket, "water/rate", 321.0);
    let midi = bridge.child.stdin.as_mut().unwrap();
    midi.write_all(&[0xB0, 20, 127]).unwrap();
    midi.flush().unwrap();
    wait_for_value(&socket, "mix/tone", 24.0);

    // The recipe in Python, by OSC.
    if let Some(mut python) = python(&[address]) {
        assert!(python.wait().unwrap().success());
        wait_for_value(&socket, "mix/level", -6.0);
        wait_for_value(&socket, "water/rate", 1500.0);
    }

    // The board goes away.
    drop(twin);
    bridge.line("looking for it every 1s");
    assert!(bridge.child.try_wait().unwrap().is_none());
    std::fs::remove_file(map).unwrap();
}

#[test]
fn the_recipe_in_python_plays_by_itself() {
    let (_twin, port) = Running::twin();
    let Some(python) = python(&[&port]) else {
        return;
    };
    let output = python.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(said.contains("water.rate is 1500"), "{said}");
}

/// Runs the recipe; none where there is no Python.
fn python(words: &[&str]) -> Option<Child> {
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/recipes/freshet.py");
    Command::new("python3")
        .arg("-B")
        .arg(recipe)
        .args(words)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()
}

#[test]
fn midi_alone_ends_with_its_bytes() {
    let (_twin, port) = Running::twin();
    let mut bridge = Running::start(&["bridge", &port, "--midi", "-"]);
    let mut midi = bridge.child.stdin.take().unwrap();
    midi.write_all(&[0xB0, 7, 127, 0xC0, 1, 0x90, 60, 100])
        .unwrap();
    drop(midi);
    assert_eq!(bridge.ends(), Some(0));
    let get = Command::new(env!("CARGO_BIN_EXE_freshet"))
        .args(["scene", &port])
        .output()
        .unwrap();
    let scenes = String::from_utf8(get.stdout).unwrap();
    let plays = scenes.lines().position(|line| line.contains("plays"));
    assert_eq!(plays, Some(1), "{scenes}");
}

#[test]
fn what_is_wrong_is_said() {
    let map = temporary("wrong.toml", "[[cc]]\ncc = 300\nparam = \"mix.level\"\n");
    let map_path = map.to_str().unwrap();
    let told: &[(&[&str], &str)] = &[
        (&[], "which serial port?"),
        (&["/dev/nowhere"], "there is no such port"),
        (
            &["/dev/nowhere", "--osc", "what"],
            "what: expected an address such as 127.0.0.1:9000",
        ),
        (
            &["/dev/nowhere", "--midi", "-", "--reply", "9001"],
            "add --osc",
        ),
        (
            &["/dev/nowhere", "--midi", "-", "--map", map_path],
            ":2:6: cc: expected a whole number from 0 to 119",
        ),
        (
            &["/dev/nowhere", "--midi", "-", "--map", "/nowhere.toml"],
            "cannot read /nowhere.toml",
        ),
        (
            &[
                "/dev/nowhere",
                "--midi",
                "-",
                "--map",
                map_path,
                "--learn",
                "mix.lvl",
            ],
            "did you mean `mix.level`?",
        ),
        (
            &["/dev/nowhere", "--midi", "-", "--map", map_path, "--learn"],
            "the standard input is MIDI's",
        ),
        (&["/dev/nowhere", "--learn", "mix.level"], "--midi"),
    ];
    for (words, wanted) in told {
        let said = error(words);
        assert!(said.contains(wanted), "{words:?}: {said}");
    }
    if cfg!(not(feature = "midi")) {
        let said = error(&["--midi"]);
        assert!(
            said.contains("--features midi") && said.contains("libasound2-dev"),
            "{said}"
        );
    }
    std::fs::remove_file(map).unwrap();
}
