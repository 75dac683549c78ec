//! The twin behind a port, and the commands that talk to it, as programs that know nothing of each other.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use freshet_host::client::{BAUD, Client, Error, Event};

fn freshet(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_freshet"));
    command
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// `freshet simulate`, ended with the test.
struct Simulated {
    process: Child,
    port: String,
}

impl Simulated {
    fn new(words: &[&str]) -> Self {
        let mut process = freshet(&[&["simulate"], words].concat()).spawn().unwrap();
        let mut port = String::new();
        let out = process.stdout.take().unwrap();
        BufReader::new(out).read_line(&mut port).unwrap();
        let port = port.trim().to_owned();
        if port.is_empty() {
            let mut told = String::new();
            process.stderr.unwrap().read_to_string(&mut told).unwrap();
            panic!("{told}");
        }
        Self { process, port }
    }

    /// Runs `freshet WORD PORT WORDS…`; returns its exit code and what it said, on both streams.
    fn run(&self, word: &str, words: &[&str]) -> (i32, String, String) {
        run(&[&[word, &self.port], words].concat())
    }

    /// What has to succeed; returns what it said.
    fn ask(&self, word: &str, words: &[&str]) -> String {
        let (code, out, told) = self.run(word, words);
        assert_eq!(code, 0, "{word} {words:?}: {out}{told}");
        out
    }

    /// What has to be refused; returns why.
    fn refuses(&self, word: &str, words: &[&str]) -> String {
        let (code, out, told) = self.run(word, words);
        assert_eq!((code, out.as_str()), (2, ""), "{told}");
        told
    }

    fn stop(&mut self) -> i32 {
        let pid = self.process.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        ends(&mut self.process)
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn run(words: &[&str]) -> (i32, String, String) {
    let output = freshet(words).output().unwrap();
    (
        output.status.code().unwrap_or(-1),
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

fn ends(process: &mut Child) -> i32 {
    let until = Instant::now() + Duration::from_secs(10);
    while Instant::now() < until {
        if let Some(status) = process.try_wait().unwrap() {
            return status.code().unwrap_or(-1);
        }
        thread::sleep(Duration::from_millis(10));
    }
    panic!("it does not end");
}

/// A path of its own for each test, gone after it.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("freshet-port-{}-{count}-{name}", std::process::id());
        Self(std::env::temp_dir().join(name))
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

#[test]
fn scripts_read_and_move_what_a_board_has() {
    let mut twin = Simulated::new(&["--scene", "surf", "--board", "f411", "--seed", "5"]);
    assert_eq!(
        twin.ask("get", &["mix.level", "water.law"]),
        "mix.level = 0 dB\nwater.law = power\n"
    );
    let answer = twin.ask("set", &["mix.level=-6", "water.law=flat", "--ramp", "0"]);
    assert!(
        answer.starts_with("ok set mix.level=-6 water.law=flat ramp=0 at "),
        "{answer}"
    );
    thread::sleep(Duration::from_millis(50));
    assert_eq!(
        twin.ask("get", &["mix.level", "water.law"]),
        "mix.level = -6 dB\nwater.law = flat\n"
    );
    assert_eq!(twin.ask("get", &[]).lines().count(), freshet::param::COUNT);

    assert!(twin.ask("scene", &[]).contains("= surf (plays)\n"));
    assert!(
        twin.ask("scene", &["light rain"])
            .starts_with("ok scene light rain at ")
    );
    assert!(twin.ask("status", &[]).starts_with("load = "));
    let json: serde_json::Value = serde_json::from_str(&twin.ask("status", &["--json"])).unwrap();
    assert!(json["frame"].as_u64().unwrap() > 1000);
    assert_eq!(json["cause"], "power-on");
    let version = twin.ask("send", &["version"]);
    assert!(
        version.contains(" board=f411 rate=48000 seed=5 "),
        "{version}"
    );
    assert!(twin.ask("send", &["help"]).contains("set PATH VALUE"));
    assert!(
        twin.ask("send", &["store", "3", "my", "rain"])
            .contains("\nok store 3 my rain at ")
    );

    assert_eq!(
        twin.refuses("set", &["mix.level=99"]),
        "error: mix.level cannot be 99; expected -80 to 24 dB\n"
    );
    assert_eq!(
        twin.refuses("get", &["level"]),
        "error: no parameter `level`; did you mean `mix.level`?\n"
    );
    assert_eq!(
        twin.refuses("set", &["level", "9"]),
        "error: `level`: expected PATH=VALUE\n"
    );
    assert_eq!(
        twin.refuses("scene", &["lake"]),
        "error: no scene `lake`; `scene` lists them\n"
    );
    assert_eq!(
        twin.refuses("send", &["sing"]),
        "error no command `sing`; `help` lists them\n"
    );
    assert_eq!(twin.stop(), 0);
    let told = twin.run("status", &[]);
    assert_eq!(told.0, 2);
    assert!(told.2.contains(&twin.port), "{}", told.2);
}

#[test]
fn ports_that_are_none_are_named_and_what_to_do() {
    let (code, _, told) = run(&["get", "/dev/no-such-port", "mix.level"]);
    assert_eq!(code, 2);
    assert!(
        told.starts_with("error: cannot open /dev/no-such-port: there is no such port; "),
        "{told}"
    );
    let file = Scratch::new("file");
    fs::write(&file.0, "precious").unwrap();
    let (code, _, told) = run(&["status", file.path()]);
    assert_eq!(code, 2);
    assert!(told.contains(": that is no serial port ("), "{told}");
    assert_eq!(fs::read(&file.0).unwrap(), b"precious");
}

#[test]
fn a_port_belongs_to_one_program_at_a_time() {
    let twin = Simulated::new(&[]);
    let mut first = Client::open(&twin.port, BAUD).unwrap();
    let told = twin.refuses("status", &[]);
    assert!(
        told.ends_with("another program has it, or the board is gone\n"),
        "{told}"
    );
    assert!(first.status().is_ok());
    drop(first);
    twin.ask("status", &[]);
}

#[test]
fn whoever_does_not_read_holds_nobody_up() {
    let twin = Simulated::new(&[]);
    let mut port = fs::OpenOptions::new()
        .read(true)
        .write(true)
        .open(&twin.port)
        .unwrap();
    for _ in 0..500 {
        port.write_all(b"list\nhelp\n").unwrap();
    }
    drop(port);
    // Half a line, and half a frame.
    let mut port = fs::OpenOptions::new().write(true).open(&twin.port).unwrap();
    port.write_all(b"\x00\x01\x01abc").unwrap();
    drop(port);
    let mut board = Client::open(&twin.port, BAUD).unwrap();
    let before = board.status().unwrap().status().frame;
    thread::sleep(Duration::from_millis(300));
    let played = board.status().unwrap().status().frame - before;
    // In real time, on a machine that has other things to do.
    assert!((4_800..48_000).contains(&played), "{played}");
    board.subscribe(10).unwrap();
    // What the first one has asked for comes, too.
    let until = Instant::now() + Duration::from_secs(5);
    while !matches!(
        board.poll(Duration::from_secs(1)).unwrap(),
        Some(Event::Status(_))
    ) {
        assert!(Instant::now() < until);
    }
}

#[test]
fn the_twins_clock_does_not_drift() {
    let twin = Simulated::new(&["--board", "f411", "--scene", "light-rain"]);
    let mut board = Client::open(&twin.port, BAUD).unwrap();
    let (begun, before) = (Instant::now(), board.status().unwrap().status().frame);
    thread::sleep(Duration::from_secs(2));
    let played = board.status().unwrap().status().frame - before;
    let seconds = begun.elapsed().as_secs_f64();
    let error = played as f64 / 48_000.0 - seconds;
    // A busy machine may let it wait a moment.
    assert!(error.abs() < 0.1, "{error} s of {seconds}");
}

#[test]
fn a_twin_that_goes_away_is_told() {
    let mut twin = Simulated::new(&[]);
    let mut board = Client::open(&twin.port, BAUD).unwrap();
    assert_eq!(twin.stop(), 0);
    let error = board.status().unwrap_err();
    assert!(matches!(error, Error::Gone { .. }), "{error}");
    assert!(error.to_string().contains("is the board still plugged in?"));
}

#[test]
fn presets_are_kept_in_a_file() {
    let file = Scratch::new("presets.toml");
    let mut twin = Simulated::new(&["--keep", file.path()]);
    twin.ask("scene", &["surf"]);
    twin.ask("set", &["mix.level=-9", "--ramp", "0"]);
    twin.ask("send", &["store 2 evening surf"]);
    twin.ask("send", &["boot preset 2"]);
    assert_eq!(twin.stop(), 0);
    let text = fs::read_to_string(&file.0).unwrap();
    assert!(text.contains("name = \"evening surf\""), "{text}");
    let twin = Simulated::new(&["--keep", file.path()]);
    assert_eq!(twin.ask("get", &["mix.level"]), "mix.level = -9 dB\n");
    assert!(
        twin.ask("send", &["presets"])
            .starts_with("preset 2 = evening surf (over surf)\n")
    );
    let mut board = Client::open(&twin.port, BAUD).unwrap();
    assert_eq!(board.restart().unwrap().scene, "surf");
    assert_eq!(board.get(&["mix.level"]).unwrap(), [-9.0]);

    fs::write(&file.0, "version = 7\n").unwrap();
    let (code, out, told) = run(&["simulate", "--keep", file.path()]);
    assert_eq!((code, out.as_str()), (2, ""));
    assert!(told.contains("a file of version 7, expected 1"), "{told}");
    assert_eq!(fs::read_to_string(&file.0).unwrap(), "version = 7\n");
    let (code, _, told) = run(&["simulate", "--keep", "/no/such/folder/x.toml"]);
    assert_eq!(code, 2);
    assert!(told.contains("does the folder exist?"), "{told}");
}

/// `freshet record`, with a person at its keyboard.
struct Recorded {
    process: Child,
    keys: ChildStdin,
}

impl Recorded {
    fn new(twin: &Simulated, file: &Path) -> Self {
        let mut command = freshet(&["record", &twin.port, file.to_str().unwrap()]);
        let mut process = command
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let keys = process.stdin.take().unwrap();
        Self { process, keys }
    }

    fn types(&mut self, line: &str, ms: u64) {
        writeln!(self.keys, "{line}").unwrap();
        thread::sleep(Duration::from_millis(ms));
    }
}

#[test]
fn a_session_is_recorded_and_played_again() {
    let (file, sound) = (Scratch::new("session.txt"), Scratch::new("session.wav"));
    let twin = Simulated::new(&["--seed", "11"]);
    twin.ask("scene", &["river"]);
    let mut record = Recorded::new(&twin, &file.0);
    record.types("set mix.level -6", 100);
    record.types("store 1 loud", 10);
    record.types("mute maybe", 700);
    record.types("recall 1", 200);
    record.types("restart", 100);
    record.types("scene surf", 10);
    let Recorded { mut process, keys } = record;
    drop(keys);
    assert_eq!(ends(&mut process), 0);
    let text = fs::read_to_string(&file.0).unwrap();
    assert!(text.starts_with("freshet version="), "{text}");
    assert!(
        text.contains(" seed=11 ") && text.contains("\nok restart at "),
        "{text}"
    );

    let (code, out, told) = run(&["replay", file.path(), "-o", sound.path(), "--bits", "24"]);
    assert_eq!(code, 0, "{told}");
    assert!(out.contains("commands  4, 2 starts of the board"), "{out}");
    let wav = hound::WavReader::open(&sound.0).unwrap();
    assert_eq!(
        (wav.spec().sample_rate, wav.spec().bits_per_sample),
        (48_000, 24)
    );
    assert!(wav.duration() > 5 * 48_000);

    // What came before the end is still the same.
    let short = Scratch::new("short.wav");
    let (code, ..) = run(&[
        "replay",
        file.path(),
        "-o",
        short.path(),
        "--bits",
        "24",
        "--seconds",
        "0.25",
    ]);
    assert_eq!(code, 0);
    let samples = |path: &Path| {
        let wav = hound::WavReader::open(path).unwrap();
        wav.into_samples::<i32>()
            .map(Result::unwrap)
            .take(24_000)
            .collect::<Vec<_>>()
    };
    assert_eq!(samples(&short.0), samples(&sound.0));

    let (code, _, told) = run(&["replay", "/no/such/file"]);
    assert_eq!(code, 2);
    assert!(told.contains("cannot read /no/such/file"), "{told}");
    let (code, _, told) = run(&["replay", file.path(), "-o", file.path()]);
    assert_eq!(code, 2);
    assert!(told.contains("the recording is there"), "{told}");
    fs::write(&file.0, text.replace(" at ", " bt ")).unwrap();
    let (code, _, told) = run(&["replay", file.path(), "-o", sound.path()]);
    assert_eq!(code, 2);
    assert!(told.contains("session.txt:"), "{told}");
}
