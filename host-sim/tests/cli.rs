//! The command as a person or a script meets it: exit status, messages, and the files that it leaves.

#[cfg(feature = "flash")]
mod elf;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufWriter, Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use freshet::bubble::Bubble;
use freshet_host::scene_file::SceneFile;

/// A folder of its own for each test, gone after it.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("freshet-cli-{}-{count}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).unwrap()
    }

    fn sound(&self, name: &str) -> Sound {
        Sound::open(&self.path(name))
    }

    /// Every regular file with its content.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let entries = fs::read_dir(&self.0).unwrap().map(Result::unwrap);
        entries
            .filter(|entry| entry.file_type().unwrap().is_file())
            .map(|entry| entry.file_name().into_string().unwrap())
            .map(|name| (name.clone(), self.read(&name)))
            .collect()
    }

    /// `freshet` with the words of `line`, to be run in this folder.
    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_freshet"));
        command
            .current_dir(&self.0)
            .args(line.split_whitespace())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn freshet(&self, line: &str) -> Outcome {
        Outcome::of(line, self.command(line).output().unwrap())
    }

    /// Runs what has to succeed; returns the standard output.
    fn succeeds(&self, line: &str) -> String {
        let outcome = self.freshet(line);
        assert_eq!(outcome.code(), Some(0), "{outcome:?}");
        outcome.text()
    }

    /// Runs what has to be refused, with all of `words` in the message and every file left as it was.
    fn refuses(&self, line: &str, words: &[&str]) {
        let before = self.files();
        let outcome = self.freshet(line);
        outcome.complains(words);
        assert!(outcome.out.is_empty(), "{outcome:?}");
        assert!(self.files() == before, "files were touched: {outcome:?}");
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// What came of a run.
struct Outcome {
    line: String,
    status: ExitStatus,
    out: Vec<u8>,
    err: String,
}

impl Outcome {
    fn of(line: &str, output: Output) -> Self {
        let outcome = Self {
            line: line.to_owned(),
            status: output.status,
            out: output.stdout,
            err: String::from_utf8(output.stderr).expect("messages are UTF-8"),
        };
        assert!(!outcome.err.contains("panicked"), "{outcome:?}");
        outcome
    }

    fn code(&self) -> Option<i32> {
        self.status.code()
    }

    fn text(&self) -> String {
        String::from_utf8(self.out.clone()).expect("the standard output is text")
    }

    /// One message for people, with all of `words`.
    fn complains(&self, words: &[&str]) {
        assert_eq!(self.code(), Some(2), "{self:?}");
        assert!(self.err.starts_with("error: "), "{self:?}");
        assert!(!self.err.contains("os error"), "{self:?}");
        for word in words {
            assert!(self.err.contains(word), "no `{word}` in {self:?}");
        }
    }
}

impl std::fmt::Debug for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let out: String = String::from_utf8_lossy(&self.out)
            .chars()
            .take(1_000)
            .collect();
        let (line, status, err) = (&self.line, self.status, &self.err);
        write!(f, "`freshet {line}`: {status}\n{out}\n{err}")
    }
}

/// A WAV, its samples as the file has them: integers as whole numbers.
struct Sound {
    spec: hound::WavSpec,
    frames: Vec<[f64; 2]>,
}

impl Sound {
    fn open(path: &Path) -> Self {
        let reader = hound::WavReader::open(path).unwrap_or_else(|e| panic!("{path:?}: {e}"));
        let spec = reader.spec();
        assert_eq!(spec.channels, 2);
        let samples: Vec<f64> = match spec.sample_format {
            hound::SampleFormat::Float => reader
                .into_samples::<f32>()
                .map(|x| f64::from(x.unwrap()))
                .collect(),
            hound::SampleFormat::Int => reader
                .into_samples::<i32>()
                .map(|x| f64::from(x.unwrap()))
                .collect(),
        };
        let frames = samples.as_chunks().0.to_vec();
        Self { spec, frames }
    }

    fn is_float(&self) -> bool {
        self.spec.sample_format == hound::SampleFormat::Float
    }

    fn is_mono(&self) -> bool {
        self.frames.iter().all(|[left, right]| left == right)
    }

    fn peak(&self) -> f64 {
        let samples = self.frames.iter().flatten();
        samples.fold(0.0, |peak, x| x.abs().max(peak))
    }

    fn rms(&self) -> f64 {
        let samples = self.frames.iter().flatten();
        (samples.map(|x| x * x).sum::<f64>() / (2 * self.frames.len()) as f64).sqrt()
    }
}

/// The number after `label` in a summary.
fn figure(summary: &str, label: &str) -> f64 {
    let rest = summary.split(label).nth(1);
    let word = rest.and_then(|rest| rest.split_whitespace().next());
    let number = word.and_then(|word| word.parse().ok());
    number.unwrap_or_else(|| panic!("no number after `{label}` in {summary}"))
}

fn is_picture(bytes: &[u8]) -> bool {
    // The signature, and 1400 × 800 pixels.
    bytes.starts_with(b"\x89PNG\r\n\x1a\n") && bytes[16..24] == [0, 0, 5, 120, 0, 0, 3, 32]
}

// Rendering.

#[test]
fn a_scene_becomes_ten_seconds_in_a_wav_of_its_name_with_a_summary() {
    let folder = Folder::new();
    let summary = folder.succeeds("render brook");
    let brook = folder.sound("brook.wav");
    assert_eq!(brook.spec.sample_rate, 48_000);
    assert_eq!(brook.spec.bits_per_sample, 16);
    assert_eq!(brook.frames.len(), 480_000);
    assert!(summary.contains("brook.wav  10.000 s at 48000 Hz"));
    assert!(summary.contains(" x real time"), "{summary}");
    assert!(summary.contains(" stolen"), "{summary}");
    assert!(figure(&summary, "births") > 100.0, "{summary}");
    for (label, level) in [("peak", brook.peak()), ("rms", brook.rms())] {
        let db = 20.0 * (level / 32_768.0).log10();
        assert!((figure(&summary, label) - db).abs() < 0.06, "{summary}");
    }
}

#[test]
fn every_scene_that_is_listed_says_what_it_sounds_like_and_sounds() {
    let folder = Folder::new();
    let list = folder.succeeds("list");
    assert!(list.contains("brook"), "{list}");
    for line in list.lines() {
        let (name, sounds) = line.split_once(' ').unwrap();
        assert!(sounds.trim().len() > 10, "{name}: {sounds}");
        folder.succeeds(&format!("render {name} --seconds 4 -o a.wav"));
        assert!(folder.sound("a.wav").rms() > 1.0, "{name} is silent");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_one_others() {
    let folder = Folder::new();
    for (name, seed) in [
        ("seven", "--seed 7"),
        ("again", "--seed 7"),
        ("eight", "--seed 8"),
        ("last", "--seed 18446744073709551615"),
        ("none", ""),
        ("one", "--seed 1"),
    ] {
        folder.succeeds(&format!("render brook --seconds 1 {seed} -o {name}"));
    }
    let files = folder.files();
    assert!(files["seven"] == files["again"]);
    assert!(files["seven"] != files["eight"]);
    assert!(files["seven"] != files["last"]);
    assert!(files["none"] == files["one"]);
}

#[test]
fn a_longer_rendering_begins_as_a_shorter_one() {
    let folder = Folder::new();
    folder.succeeds("render surf --seconds 0.5 -o short.wav");
    folder.succeeds("render surf --seconds 0.75 -o long.wav");
    let (short, long) = (folder.read("short.wav"), folder.read("long.wav"));
    assert!(short[44..] == long[44..short.len()]);
}

#[test]
fn bits_and_rate_are_those_asked_for() {
    let folder = Folder::new();
    folder.succeeds("render brook --seconds 0.5 --bits 24 --rate 96000 -o fine.wav");
    let fine = folder.sound("fine.wav");
    assert_eq!(fine.spec.sample_rate, 96_000);
    assert_eq!(fine.spec.bits_per_sample, 24);
    assert!(!fine.is_float());
    assert_eq!(fine.frames.len(), 48_000);
    // The lowest eight bits are used.
    assert!(fine.frames.iter().any(|frame| frame[0] % 256.0 != 0.0));
    for rate in [8_000, 44_100, 192_000] {
        folder.succeeds(&format!(
            "render brook --seconds 0.1 --rate {rate} -o a.wav"
        ));
        let heard = folder.sound("a.wav");
        assert_eq!(heard.spec.sample_rate, rate);
        assert_eq!(heard.frames.len(), rate as usize / 10);
    }
}

#[test]
fn what_is_set_from_outside_wins_over_the_scene_and_its_intensity() {
    let folder = Folder::new();
    folder.write(
        "Quiet pool.toml",
        "title = \"Quiet pool\"\n[intensity]\nat = 0.5\n\"water.rate\" = [[0, 0], [1, 0]]\n",
    );
    let births = |options: &str| {
        let mut command = folder.command("render");
        command.arg("Quiet pool.toml").args(options.split(' '));
        let outcome = Outcome::of(options, command.output().unwrap());
        assert_eq!(outcome.code(), Some(0), "{outcome:?}");
        figure(&outcome.text(), "births")
    };
    assert_eq!(births("--seconds 0.5"), 0.0);
    assert_eq!(folder.sound("Quiet pool.wav").peak(), 0.0);
    let set = births("--seconds 0.5 --set water.rate=2000");
    assert!((800.0..1_200.0).contains(&set), "{set} births");
    let last = births("--seconds 0.5 --set water.rate=2000 --set water.rate=100");
    assert!((20.0..100.0).contains(&last), "{last} births");
}

#[test]
fn a_board_plays_within_its_capacities_and_the_summary_says_what_that_cost() {
    let folder = Folder::new();
    let line = "render waterfall --seconds 0.5 --set water.rate=1000000 --board";
    let desk = folder.succeeds(&format!("{line} desk"));
    assert!(!desk.contains("the board's most"), "{desk}");
    for board in ["f407", "f411", "h743"] {
        let summary = folder.succeeds(&format!("{line} {board}"));
        assert!(summary.contains("1000000 births a second asked for"));
        assert!(figure(&summary, "births") < figure(&desk, "births"));
    }
}

#[test]
fn too_many_bubbles_at_once_are_stolen_or_dropped_and_counted() {
    let folder = Folder::new();
    let mut rows = String::from("time,radius_mm,amplitude\n");
    for i in 0..2_000 {
        let (time, amplitude) = (f64::from(i) * 0.001, 0.001 + f64::from(i % 97) * 0.000_1);
        writeln!(rows, "{time},60,{amplitude}").unwrap();
    }
    folder.write("many.csv", rows);
    let summary = folder.succeeds("render many.csv --board f407");
    assert_eq!(figure(&summary, "births"), 2_000.0);
    assert!(figure(&summary, "at most,") > 100.0, "{summary}");
    let summary = folder.succeeds("render many.csv --board desk");
    assert!(summary.contains(" 0 stolen"), "{summary}");
}

#[test]
fn a_spectrogram_is_a_picture_beside_the_sound() {
    let folder = Folder::new();
    folder.succeeds("render brook --seconds 1 --spectrogram brook.png");
    assert!(is_picture(&folder.read("brook.png")));
    assert_eq!(folder.sound("brook.wav").frames.len(), 48_000);
}

// Bubble events, and measuring.

#[test]
fn a_single_raw_bubble_is_a_decaying_sine_of_the_amplitude_and_pitch_given() {
    let folder = Folder::new();
    for (radius, amplitude) in [(0.003, 0.5), (0.000_8, -0.01), (0.04, 8.0)] {
        folder.write(
            "one.csv",
            format!("time,radius_m,amplitude,rise_factor\n0,{radius},{amplitude},0\n"),
        );
        folder.succeeds("render one.csv --raw");
        let heard = folder.sound("one.wav");
        assert!(heard.is_float() && heard.is_mono());

        let Bubble { beta, .. } = Bubble::new(radius);
        let pitch = Bubble::new(radius).pitch();
        // The soft attack is over where the envelope has come down to 0.85.
        let begin = (0.17 / beta * 48_000.0) as usize;
        let mut worst: f64 = 0.0;
        let mut crossings = Vec::new();
        for (n, pair) in heard.frames.windows(2).enumerate().skip(begin) {
            let time = n as f64 / 48_000.0;
            let envelope = amplitude * (-beta * time).exp();
            let wanted = envelope * (std::f64::consts::TAU * pitch * time).sin();
            worst = worst.max((pair[0][0] - wanted).abs());
            let [before, after] = [pair[0][0], pair[1][0]].map(|x| x / envelope);
            // Down to 70 dB below the beginning.
            if before < 0.0 && after >= 0.0 && beta * time < 8.0 {
                crossings.push((n as f64 + before / (before - after)) / 48_000.0);
            }
        }
        assert!(
            worst < 1e-4 * amplitude.abs(),
            "{radius} m: off by {worst} Pa"
        );
        let turns = (crossings.len() - 1) as f64;
        let heard = turns / (crossings.last().unwrap() - crossings[0]);
        assert!(turns > 20.0, "{turns} turns");
        assert!(
            (heard / pitch - 1.0).abs() < 5e-4,
            "{heard} Hz, not {pitch} Hz"
        );
        if radius == 0.003 {
            // By hand from HF (36–38).
            assert!((heard / 1_094.235 - 1.0).abs() < 5e-4, "{heard} Hz");
        }
    }
}

#[test]
fn a_bubble_begins_when_its_row_says_and_the_sound_ends_when_the_last_one_has_rung_out() {
    let folder = Folder::new();
    folder.write(
        "late.csv",
        "time,radius_mm,amplitude\n0.25,3,0.5\n1.5,3,-0.5\n",
    );
    folder.succeeds("render late.csv --raw");
    let heard = folder.sound("late.wav").frames;
    assert!(heard[..=12_000].iter().all(|frame| *frame == [0.0; 2]));
    assert!(heard[12_001][0] > 0.0);
    // The second is the first one upside down.
    for (one, other) in heard[12_001..17_000].iter().zip(&heard[72_001..77_000]) {
        assert!((one[0] + other[0]).abs() < 1e-6, "{one:?} and {other:?}");
    }
    // 103 dB down.
    let end = (1.5 + 141_000_f64.ln() / Bubble::new(0.003).beta) * 48_000.0;
    assert!((heard.len() as f64 - end).abs() < 2.0, "{}", heard.len());
    assert!(heard.last().unwrap()[0].abs() < 1e-5);
}

#[test]
fn columns_stand_in_any_order_and_others_are_ignored() {
    let folder = Folder::new();
    let header = "time,radius_mm,amplitude,rise_factor";
    folder.write("plain.csv", format!("{header}\n0,3,0.5,2\n"));
    folder.write(
        "RICH.CSV",
        "# by hand\r\nnote,rise_factor,amplitude,radius_m,time,id\r\n\"a, b\",2,0.5,0.003,0,9\r\n",
    );
    folder.write("level.csv", format!("{header}\n0,3,0.5,0\n"));
    for name in ["plain.csv", "RICH.CSV", "level.csv"] {
        folder.succeeds(&format!("render {name} --raw --seconds 0.2"));
    }
    assert!(folder.read("plain.wav") == folder.read("RICH.wav"));
    // A rising pitch is another sound.
    assert!(folder.read("plain.wav") != folder.read("level.wav"));
}

#[test]
fn a_header_alone_is_a_short_silence() {
    let folder = Folder::new();
    folder.write("none.csv", "time,radius_mm,amplitude\n");
    let summary = folder.succeeds("render none.csv");
    assert_eq!(figure(&summary, "births"), 0.0);
    let heard = folder.sound("none.wav");
    assert!(!heard.frames.is_empty());
    assert_eq!(heard.peak(), 0.0);
}

#[test]
fn raw_has_no_limiter_tone_dither_or_width() {
    let folder = Folder::new();
    let rows = "0,20,1.5\n".repeat(8);
    folder.write("loud.csv", format!("time,radius_mm,amplitude\n{rows}"));
    folder.succeeds("render loud.csv --raw");
    assert!(folder.sound("loud.wav").peak() > 4.0);
    folder.succeeds("render loud.csv");
    assert!(folder.sound("loud.wav").peak() <= 32_767.0);

    let line = "render brook --seconds 1 --raw";
    folder.succeeds(&format!("{line} -o plain.wav"));
    folder.succeeds(&format!(
        "{line} --set mix.tone=24 --set mix.width=1 -o set.wav"
    ));
    assert!(folder.read("plain.wav") == folder.read("set.wav"));
    let plain = folder.sound("plain.wav");
    assert!(plain.is_float() && plain.is_mono());
    folder.succeeds(&format!(
        "{line} --set water.rate=0 --set drops.rate=0 -o still.wav"
    ));
    assert_eq!(folder.sound("still.wav").peak(), 0.0);
}

#[test]
fn the_events_file_logs_every_birth_in_order_of_time() {
    let folder = Folder::new();
    for scene in ["brook", "tap", "waterfall"] {
        let summary = folder.succeeds(&format!("render {scene} --seconds 2 --events births.csv"));
        let log = folder.text("births.csv");
        let mut rows = log.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = rows.next().unwrap();
        let first = ["time", "radius_m", "amplitude", "rise_factor"];
        assert_eq!(header[..4], first);
        let births = header.iter().position(|name| *name == "births").unwrap();
        let (mut before, mut count) = (0.0, 0.0);
        for row in rows {
            assert_eq!(row.len(), header.len(), "{row:?}");
            let time: f64 = row[0].parse().unwrap();
            assert!((before..2.001).contains(&time), "{row:?} after {before} s");
            before = time;
            count += row[births].parse::<f64>().unwrap();
        }
        assert_eq!(count, figure(&summary, "births"), "{scene}");
    }
}

#[test]
fn the_events_file_can_be_rendered_itself() {
    let folder = Folder::new();
    // The ends of all ranges have to survive the way through the file.
    folder.write(
        "first.csv",
        "time,radius_mm,amplitude,rise_factor\n0,150,0.5,0\n0.0123,3,0.5,0\n0.02,0.15,0.1,0\n\
         0.1000071,1.1,-8,0.1\n0.1000071,150,1,100\n",
    );
    let options = "--raw --seconds 1";
    folder.succeeds(&format!("render first.csv {options} --events second.csv"));
    let summary = folder.succeeds(&format!("render second.csv {options}"));
    assert_eq!(figure(&summary, "births"), 5.0);
    let (first, second) = (folder.sound("first.wav"), folder.sound("second.wav"));
    for (a, b) in first.frames.iter().zip(&second.frames) {
        assert!((a[0] - b[0]).abs() < 1e-6, "{a:?} became {b:?}");
    }
    // All that a scene may log: crowds, voices, bubbles too high to be heard.
    for scene in ["brook --rate 8000", "waterfall", "light-rain", "lava"] {
        folder.succeeds(&format!(
            "render {scene} {options} --events log.csv -o scene.wav"
        ));
        let summary = folder.succeeds(&format!("render log.csv {options}"));
        assert!(figure(&summary, "births") > 0.0, "{scene}");
    }
    folder.succeeds(&format!("render tap {options} --events log.csv"));
    folder.succeeds(&format!("render log.csv {options}"));
    let ratio = folder.sound("log.wav").rms() / folder.sound("tap.wav").rms();
    assert!((0.8..1.25).contains(&ratio), "{ratio} times as loud");
}

// Streaming, and stopping.

#[test]
fn a_dash_streams_the_same_sound_to_the_standard_output() {
    let folder = Folder::new();
    for format in ["--bits 16", "--bits 24", "--raw"] {
        let line = format!("render brook --seconds 0.5 {format} -o");
        folder.succeeds(&format!("{line} file.wav"));
        let outcome = folder.freshet(&format!("{line} -"));
        assert_eq!(outcome.code(), Some(0), "{outcome:?}");
        // The summary is out of the sound's way.
        assert!(outcome.err.contains("births"), "{outcome:?}");
        let (stream, file) = (&outcome.out, &folder.read("file.wav"));
        assert_eq!(stream.len(), file.len());
        // All but the two lengths, which a stream does not know.
        let data = file.windows(4).position(|word| word == b"data").unwrap();
        assert!(stream[..4] == file[..4]);
        assert!(stream[8..data + 4] == file[8..data + 4]);
        assert!(stream[data + 8..] == file[data + 8..]);
        assert!(!folder.path("-").exists());
        if cfg!(unix) {
            let named = folder.freshet(&format!("{line} /dev/stdout"));
            assert!(named.out == *stream, "{named:?}");
        }
    }
}

#[test]
fn a_reader_that_goes_away_is_no_fault() {
    let folder = Folder::new();
    let line = "render brook --seconds 100000 -o - --events births.csv";
    let mut child = folder.command(line).spawn().unwrap();
    let mut out = child.stdout.take().unwrap();
    out.read_exact(&mut [0; 1_000]).unwrap();
    drop(out);
    let outcome = Outcome::of(line, child.wait_with_output().unwrap());
    assert_eq!(outcome.code(), Some(0), "{outcome:?}");
    assert!(outcome.err.contains("stopped early"), "{outcome:?}");
    assert!(!outcome.err.contains("error"), "{outcome:?}");
    assert!(folder.text("births.csv").ends_with('\n'));
    for line in ["list", "describe", "render brook --seconds 0.1"] {
        let mut child = folder.command(line).spawn().unwrap();
        drop(child.stdout.take());
        let outcome = Outcome::of(line, child.wait_with_output().unwrap());
        assert_eq!(outcome.code(), Some(0), "{outcome:?}");
    }
}

#[cfg(unix)]
fn press_ctrl_c(child: &Child) {
    let id = child.id().to_string();
    let status = Command::new("kill").args(["-INT", &id]).status();
    assert!(status.unwrap().success());
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_valid_files_of_what_was_rendered() {
    let folder = Folder::new();
    let line =
        "render brook --seconds 20000 --rate 8000 -o a.wav --events a.csv --spectrogram a.png";
    let child = folder.command(line).spawn().unwrap();
    let begun = Instant::now();
    while fs::metadata(folder.path("a.wav")).map_or(0, |meta| meta.len()) < 200_000 {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing comes");
        std::thread::sleep(Duration::from_millis(5));
    }
    press_ctrl_c(&child);
    let outcome = Outcome::of(line, child.wait_with_output().unwrap());
    assert_eq!(outcome.code(), Some(130), "{outcome:?}");
    let summary = outcome.text();
    assert!(summary.contains("stopped early"), "{summary}");
    let heard = folder.sound("a.wav");
    assert!((40_000..160_000_000).contains(&heard.frames.len()));
    assert!(heard.peak() > 0.0);
    let seconds = heard.frames.len() as f64 / 8_000.0;
    assert!((figure(&summary, "a.wav") - seconds).abs() < 0.001);
    assert!(is_picture(&folder.read("a.png")));
    let again = folder.succeeds("render a.csv --rate 8000 -o b.wav");
    assert_eq!(figure(&again, "births"), figure(&summary, "births"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_stream_too() {
    let folder = Folder::new();
    let line = "render brook --seconds 1000000 --rate 8000 -o -";
    let mut child = folder.command(line).spawn().unwrap();
    let mut out = child.stdout.take().unwrap();
    out.read_exact(&mut [0; 10_000]).unwrap();
    press_ctrl_c(&child);
    std::io::copy(&mut out, &mut std::io::sink()).unwrap();
    let outcome = Outcome::of(line, child.wait_with_output().unwrap());
    assert_eq!(outcome.code(), Some(130), "{outcome:?}");
    assert!(outcome.err.contains("stopped early"), "{outcome:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn on_a_terminal_a_bar_shows_the_speed_and_no_sound_is_written_to_it() {
    let folder = Folder::new();
    let on_terminal = |line: &str| {
        let line = format!("'{}' {line}", env!("CARGO_BIN_EXE_freshet"));
        let mut script = Command::new("script");
        script
            .args(["-qec", &line, "/dev/null"])
            .current_dir(&folder.0)
            .stdin(Stdio::null());
        Outcome::of(&line, script.output().expect("`script` makes a terminal"))
    };
    let line = "render brook --seconds 100 -o a.wav";
    let outcome = on_terminal(line);
    assert_eq!(outcome.code(), Some(0), "{outcome:?}");
    let text = String::from_utf8_lossy(&outcome.out);
    let mut drawn = text.split('\r').filter(|text| text.contains(" % "));
    assert!(
        drawn.any(|bar| bar.contains("x real time") && bar.contains("left")),
        "{outcome:?}"
    );
    assert!(text.contains("births"), "{text}");
    let outcome = on_terminal("render brook --seconds 1 -o -");
    assert_eq!(outcome.code(), Some(2), "{outcome:?}");
    let text = outcome.text();
    assert!(text.contains("cannot write the sound to a terminal"));
    // Anywhere else a bar would be in the way.
    let outcome = folder.freshet(line);
    assert!(outcome.err.is_empty(), "{outcome:?}");
}

// Memory.

/// Runs `line`, reading its standard output to the end; returns the most memory it held, kB.
#[cfg(target_os = "linux")]
fn peak_memory(folder: &Folder, line: &str) -> u64 {
    let mut child = folder.command(line).spawn().unwrap();
    let mut out = child.stdout.take().unwrap();
    let drain = std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
    let mut most = 0;
    // The mark only ever rises: the last look misses the last 2 ms at most.
    while child.try_wait().unwrap().is_none() {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id()));
        let status = status.unwrap_or_default();
        let mark = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        if let Some(mark) = mark.and_then(|mark| mark.split_whitespace().next()) {
            most = mark.parse().unwrap();
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    drain.join().unwrap().unwrap();
    let outcome = Outcome::of(line, child.wait_with_output().unwrap());
    assert_eq!(outcome.code(), Some(0), "{outcome:?}");
    assert!(most > 0, "nothing was measured");
    most
}

#[cfg(target_os = "linux")]
#[test]
fn an_hour_takes_no_more_memory_than_a_minute() {
    let folder = Folder::new();
    let most = |seconds: u32| {
        let line = format!(
            "render brook --rate 8000 --set water.rate=20 --seconds {seconds} -o - --events births.csv"
        );
        peak_memory(&folder, &line)
    };
    let (minute, hour) = (most(60), most(3_600));
    println!("{minute} kB for a minute, {hour} kB for an hour");
    assert!(hour < minute + 4_096, "{minute} kB became {hour} kB");
    assert!(hour < 65_536, "{hour} kB");
}

#[cfg(target_os = "linux")]
#[test]
fn ten_million_events_are_streamed() {
    let folder = Folder::new();
    let mut file = BufWriter::new(fs::File::create(folder.path("big.csv")).unwrap());
    file.write_all(b"time,radius_mm,amplitude\n").unwrap();
    for i in 0..10_000 {
        let row = format!("{}.{},{}.5,.001\n", i / 10, i % 10, i % 9);
        file.write_all(row.repeat(1_000).as_bytes()).unwrap();
    }
    file.flush().unwrap();
    let line = "render big.csv --seconds 1 -o a.wav --events b.csv";
    let most = peak_memory(&folder, line);
    println!("{most} kB for ten million events");
    assert!(most < 65_536, "{most} kB");
    assert_eq!(folder.text("b.csv").lines().count(), 10_001);
    // A fault in the last row is found before anything is written.
    file.write_all(b"1000.1,3\n").unwrap();
    drop(file);
    let before = folder.read("a.wav");
    let outcome = folder.freshet(line);
    outcome.complains(&["big.csv:10000002: expected 3 fields"]);
    assert!(folder.read("a.wav") == before);
}

// What is refused.

#[test]
fn an_unknown_scene_is_answered_with_the_nearest_one() {
    let folder = Folder::new();
    folder.write("brook.wav", "precious");
    folder.write("notes.md", "hello");
    let expected = "expected a scene (.toml), bubble events (.csv) or bubble tracks (.txt, .xz)";
    for (source, words) in [
        ("brok", &["no scene `brok`", "did you mean `brook`?"][..]),
        ("watterfall", &["did you mean `waterfall`?"]),
        ("xyzzy", &["no scene `xyzzy`", "`freshet list` shows all"]),
        ("notes.md", &["notes.md: ", expected]),
        (".", &[expected]),
    ] {
        folder.refuses(&format!("render {source}"), words);
        folder.refuses(&format!("describe --scene {source}"), words);
    }
    folder.refuses("render", &["<SOURCE>"]);
    folder.succeeds("render Light_Rain --seconds 0.1");
    assert!(folder.path("light-rain.wav").exists());
}

#[test]
fn impossible_options_are_refused_with_what_is_expected() {
    let folder = Folder::new();
    folder.write("brook.wav", "precious");
    for (options, words) in [
        ("--seconds 0", &["--seconds 0", "above 0"][..]),
        ("--seconds -1", &["--seconds -1", "above 0"]),
        ("--seconds nan", &["--seconds NaN", "above 0"]),
        ("--seconds inf", &["--seconds inf", "frames"]),
        ("--seconds -inf", &["--seconds -inf", "above 0"]),
        ("--seconds 1e-9", &["--seconds 1e-9", "from 1 to"]),
        ("--seconds 1e300", &["--seconds 1e300", "frames"]),
        ("--seconds 1e6", &["4 GiB", "the longest possible is 22369"]),
        ("--seconds ten", &["'ten'", "--seconds"]),
        ("--seed abc", &["'abc'", "--seed"]),
        ("--seed -1", &["'-1'", "--seed"]),
        ("--seed 1.5", &["'1.5'", "--seed"]),
        ("--seed 18446744073709551616", &["--seed"]),
        ("--rate 0", &["--rate 0", "from 8000 to 192000 Hz"]),
        ("--rate 7999", &["from 8000 to 192000 Hz"]),
        ("--rate 192001", &["from 8000 to 192000 Hz"]),
        ("--rate -5", &["'-5'", "--rate"]),
        ("--rate fast", &["'fast'", "--rate"]),
        ("--bits 12", &["'12'", "16, 24"]),
        ("--bits 24 --raw", &["--bits", "--raw"]),
        ("--board nonsense", &["'nonsense'", "desk, f407"]),
        ("--bord f407", &["'--bord'", "'--board'"]),
        ("--set water.rate", &["expected path=value"]),
        ("--set water.rate=", &["water.rate = : expected a number"]),
        ("--set water.rate=nan", &["water.rate = nan: expected"]),
        ("--set water.rate=inf", &["water.rate = inf: expected"]),
        ("--set water.rate=-1", &["expected a number from 0 to"]),
        ("--set water.rate=1e7", &["from 0 to 1000000 1/s"]),
        ("--set water.rate=fast", &["water.rate = fast: expected"]),
        ("--set water.classes=2.5", &["expected a whole number"]),
        ("--set water.law=steep", &["one of flat, power, custom"]),
        ("--set mix.level=NaN", &["from -80 to 24 dB"]),
        ("--set watre.rate=5", &["did you mean `water.rate`?"]),
        ("--set =5", &["no parameter ``"]),
        (
            "--set water.radius_min=50 --set water.radius_max=20",
            &["water.radius_min = 50 mm is above water.radius_max = 20 mm"],
        ),
    ] {
        folder.refuses(&format!("render brook {options}"), words);
    }
    // The order in which two values are set does not matter.
    folder
        .succeeds("render brook --seconds 0.1 --set water.radius_min=50 --set water.radius_max=60");
}

#[test]
fn a_scene_that_is_not_toml_is_refused_with_file_line_and_column() {
    let folder = Folder::new();
    folder.write("a.wav", "precious");
    let nested = format!("x = {}", "[".repeat(100_000));
    for (text, place) in [
        ("title = \"a\n", "a.toml:1:"),
        ("[water\nrate = 5\n", "a.toml:1:"),
        ("[water]\nrate 5\n", "a.toml:2:"),
        ("[water]\nrate = \n", "a.toml:2:"),
        ("[water]\nrate = 5\nrate = 6\n", "a.toml:3:1: "),
        ("[water]\nrate = 5\n[water]\ngamma = 1\n", "a.toml:3:"),
        ("[intensity]\n\"water.rate\" = [[0, 1], [1", "a.toml:2:"),
        (&nested, "a.toml:1:"),
    ] {
        folder.write("a.toml", text);
        folder.refuses("render a.toml", &[place, "not valid TOML"]);
    }
    folder.write("a.toml", b"[water]\nrate = \xb5\n");
    folder.refuses("render a.toml", &["a.toml:2:8: expected text in UTF-8"]);
    for text in ["", " \r\n\n"] {
        folder.write("a.toml", text);
        folder.refuses("render a.toml", &["a.toml: the file is empty"]);
    }
    folder.write("a.toml", "#".repeat(2 << 20));
    folder.refuses("render a.toml", &["a.toml: ", "is this a TOML file?"]);
    fs::create_dir(folder.path("folder.toml")).unwrap();
    folder.refuses("render folder.toml", &["cannot read folder.toml: Is a"]);
    folder.refuses("render none.toml", &["cannot read none.toml", "path right"]);
    folder.refuses("render no/a.toml", &["cannot read no/a.toml", "path right"]);
}

#[test]
fn a_scene_cut_off_anywhere_is_read_or_refused_with_its_place() {
    let text = include_str!("../../scenes/tap.toml");
    for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)) {
        if let Err(error) = SceneFile::parse("tap.toml", &text[..end]) {
            assert!(error.to_string().starts_with("tap.toml:"), "{error}");
        }
    }
}

#[test]
fn a_value_that_a_scene_may_not_have_is_refused_with_its_place_and_what_is_expected() {
    let folder = Folder::new();
    folder.write("a.wav", "precious");
    for (text, words) in [
        ("title = 5", &["1:9: expected a text in quotes"][..]),
        (
            "[water]\n\nrte = 5",
            &["3:1: no parameter `water.rte`", "mean `water.rate`?"],
        ),
        (
            "[wotter]\nrate = 5",
            &["2:1: no parameter `wotter.rate`", "mean `water.rate`?"],
        ),
        ("water = 5", &["1:1: no parameter `water`"]),
        (
            "[water]\nrate = -5",
            &["2:8: water.rate = -5: expected a number from 0 to 1000000"],
        ),
        (
            "[water]\nrate = 1e7",
            &["2:8: water.rate = 1e7: expected a number"],
        ),
        (
            "[water]\nrate = nan",
            &["2:8: water.rate = nan: expected a number"],
        ),
        (
            "[water]\nrate = -inf",
            &["2:8: water.rate = -inf: expected a number"],
        ),
        (
            "[water]\nrate = 99999999999999999999",
            &["2:8: water.rate = 99999999999999999999: expected"],
        ),
        (
            "[water]\nrate = \"much\"",
            &["2:8: water.rate: expected a number"],
        ),
        (
            "[water]\nrate = true",
            &["2:8: water.rate: expected a number"],
        ),
        (
            "[water]\nrate = [1]",
            &["2:8: water.rate: expected a number"],
        ),
        (
            "[water]\nrate = 2026-01-01",
            &["2:8: water.rate: expected a number"],
        ),
        (
            "[water]\nclasses = 2.5",
            &["2:11: water.classes = 2.5: expected a whole number from 1 to 64"],
        ),
        (
            "[water]\nlaw = \"steep\"",
            &["2:7: water.law = steep: expected one of flat, power, custom"],
        ),
        (
            "[water]\nweight = [1, 2]",
            &["2:14: water.weight.2 = 2: expected a number from 0 to 1"],
        ),
        (
            "[mix]\nlimiter = \"maybe\"",
            &["2:11: mix.limiter = maybe: expected one of off, on"],
        ),
        (
            "[water]\nradius_min = 9\nradius_max = 3",
            &["water.radius_min = 9 mm is above water.radius_max = 3 mm"],
        ),
        (
            "[water]\nradius_min = 99",
            &["2:1: water.radius_min = 99 mm is above water.radius_max"],
        ),
        (
            "intensity = 2",
            &["1:13: intensity = 2: expected a number from 0 to 1"],
        ),
    ] {
        folder.write("a.toml", text);
        let place = ["a.toml:"];
        folder.refuses("render a.toml", &[&place, words].concat());
    }
}

#[test]
fn a_curve_that_an_intensity_may_not_have_is_refused_with_its_place_and_what_is_expected() {
    let folder = Folder::new();
    let wanted = "expected points [intensity, value] in order of intensity";
    let nine = (0..9).map(|k| format!("[0.{k}, 1]"));
    let nine = format!("\"water.rate\" = [{}]", nine.collect::<Vec<_>>().join(", "));
    let many = (1..=17).map(|k| format!("\"water.weight.{k}\" = [[0, 1]]\n"));
    let many: String = many.collect();
    for (text, words) in [
        ("at = nan", &["2:6: intensity = nan: expected"][..]),
        (
            "water.rate = [[0, 1]]",
            &["2:1: write the path in quotes, like \"water.rate\""],
        ),
        (
            "\"water.rte\" = [[0, 1]]",
            &["2:1: no parameter `water.rte`"],
        ),
        ("\"water.rate\" = 5", &["2:16: ", wanted]),
        ("\"water.rate\" = []", &["2:16: ", wanted]),
        ("\"water.rate\" = [[0, 1, 2]]", &["2:17: ", wanted]),
        ("\"water.rate\" = [[1, 1], [0, 2]]", &["2:25: ", wanted]),
        ("\"water.rate\" = [[1, 1], [1, 2]]", &["2:25: ", wanted]),
        (
            "\"water.rate\" = [[0, 1e9]]",
            &["2:21: water.rate = 1e9: expected"],
        ),
        (
            "\"water.rate\" = [[2, 1]]",
            &["2:18: intensity = 2: expected"],
        ),
        (
            "\"intensity\" = [[0, 1]]",
            &["2:1: the intensity cannot move itself"],
        ),
        (
            "\"water.rate\" = [[0, 1]]\n[water]\nrate = 5",
            &["4:1: `water.rate` is moved by the intensity too"],
        ),
        (&nine, &["2:", "a curve has at most 8 points"]),
        (&many, &["an intensity moves at most 16 parameters"]),
    ] {
        folder.write("a.toml", format!("[intensity]\n{text}\n"));
        let place = ["a.toml:"];
        folder.refuses("render a.toml", &[&place, words].concat());
    }
}

#[test]
fn a_malformed_event_file_is_refused_with_its_line_its_column_and_what_is_expected() {
    let folder = Folder::new();
    folder.write("a.wav", "precious");
    let endless = "1".repeat(1 << 20);
    for (text, words) in [
        ("", &["a.csv: the file is empty", "time,radius_mm"][..]),
        ("0,3,0.5\n", &["a.csv:1: expected a header"]),
        (
            "time,amplitude\n",
            &["a.csv:1: expected a column `radius_m` or `radius_mm`"],
        ),
        (
            "time,radius_mm\n",
            &["a.csv:1: expected a column `amplitude`"],
        ),
        (
            "Time,radius_mm,amplitude\n",
            &["a.csv:1: expected a column `time`", "lower case"],
        ),
        (
            "time;radius_mm;amplitude\n",
            &["a.csv:1: ", "separated by commas"],
        ),
        (
            "time,radius_mm,radius_m,amplitude\n",
            &["a.csv:1: ", "got both"],
        ),
        (
            "time,time,radius_mm,amplitude\n",
            &["a.csv:1: ", "stands twice"],
        ),
        (&endless, &["a.csv:1: ", "is this a CSV file?"]),
    ] {
        folder.write("a.csv", text);
        folder.refuses("render a.csv", words);
    }
    for (rows, words) in [
        (
            "0,3",
            &[":3: expected 4 fields (time,", "got 2", "copied whole?"][..],
        ),
        ("0,3,0.5,0,7", &[":3: expected 4 fields", "got 5"]),
        ("0,3,0.5,", &[":3: column `rise_factor`", "got nothing"]),
        (
            "x,3,0.5,0",
            &[":3: column `time`: expected a number from 0", "got `x`"],
        ),
        ("-1,3,0.5,0", &[":3: column `time`: expected", "got `-1`"]),
        ("nan,3,0.5,0", &[":3: column `time`: expected", "got `nan`"]),
        ("inf,3,0.5,0", &[":3: column `time`: expected", "got `inf`"]),
        (
            "0,0,0.5,0",
            &[":3: column `radius_mm`: expected a number from 0.15 to 150"],
        ),
        ("0,NaN,0.5,0", &[":3: column `radius_mm`: expected"]),
        (
            "0,3,9,0",
            &[":3: column `amplitude`: expected a number from -8 to 8"],
        ),
        ("0,3,-inf,0", &[":3: column `amplitude`: expected"]),
        (
            "0,3,0.5,-1",
            &[":3: column `rise_factor`: expected a number from 0 to 100"],
        ),
        ("0,3,0.5,1e999", &[":3: column `rise_factor`: expected"]),
        ("0,3,\"0.5,0", &[":3: a text in quotes does not end"]),
        (
            "1,3,0.5,0\n0.5,3,0.5,0",
            &[":4: column `time`: 0.5 s comes after 1 s in line 3"],
        ),
        ("1e300,3,0.5,0", &["1e300 s", "frames"]),
        ("1e6,3,0.5,0", &["4 GiB"]),
    ] {
        let text = format!("time,radius_mm,amplitude,rise_factor\n0,3,0.5,0\n{rows}");
        folder.write("a.csv", text);
        folder.refuses("render a.csv", words);
    }
    folder.write("a.csv", b"time,radius_mm,amplitude\n0,3,\xb5\n");
    folder.refuses("render a.csv", &["a.csv:2: expected text in UTF-8"]);
    fs::create_dir(folder.path("folder.csv")).unwrap();
    folder.refuses("render folder.csv", &["cannot read folder.csv: Is a"]);
    folder.refuses("render none.csv", &["cannot read none.csv", "path right"]);
}

#[cfg(unix)]
#[test]
fn a_pipe_as_event_file_is_refused_instead_of_waited_for() {
    let folder = Folder::new();
    let made = Command::new("mkfifo").arg(folder.path("pipe.csv")).status();
    assert!(made.unwrap().success());
    folder.refuses(
        "render pipe.csv",
        &["pipe.csv: expected a file on the disk"],
    );
}

#[test]
fn an_output_that_cannot_be_written_is_refused_before_anything_is_rendered_or_overwritten() {
    let folder = Folder::new();
    for name in ["folder", "folder.png"] {
        fs::create_dir(folder.path(name)).unwrap();
    }
    for name in ["a.wav", "a.csv", "a.png"] {
        folder.write(name, "precious");
    }
    let hint = "does the folder exist?";
    for (options, words) in [
        ("-o no/a.wav", &["cannot write no/a.wav", hint][..]),
        ("-o folder", &["cannot write folder: Is a directory"]),
        ("-o a.wav/b.wav", &["cannot write a.wav/b.wav", hint]),
        (
            "-o no/a.wav --events a.csv --spectrogram a.png",
            &["cannot write no/a.wav"],
        ),
        (
            "-o no/a.wav --events new.csv --spectrogram new.png",
            &["cannot write no/a.wav"],
        ),
        ("--events no/a.csv", &["cannot write no/a.csv", hint]),
        ("--events folder", &["cannot write folder: Is a directory"]),
        ("--spectrogram no/a.png", &["cannot write no/a.png", hint]),
        ("--spectrogram folder.png", &["cannot write folder.png: Is"]),
        ("--spectrogram a.jpg", &["a.jpg", "ends in .png"]),
        (
            "--spectrogram a.png --events no/a.csv",
            &["cannot write no/a.csv"],
        ),
        (
            "--spectrogram no/a.png --events new.csv",
            &["cannot write no/a.png"],
        ),
    ] {
        // An hour: what is found at its end is found too late.
        let options = format!("--seconds 3600 {options}");
        let output = if options.contains("-o") {
            ""
        } else {
            "-o a.wav"
        };
        folder.refuses(&format!("render brook {options} {output}"), words);
    }
    let mut command = folder.command("render brook -o");
    let outcome = Outcome::of("render brook -o ''", command.arg("").output().unwrap());
    outcome.complains(&["--output"]);
}

#[test]
fn what_is_read_is_never_written_to_and_no_file_is_written_twice() {
    let folder = Folder::new();
    folder.write("a.csv", "time,radius_mm,amplitude\n0,3,0.5\n");
    folder.write("a.toml", "water.rate = 100\n");
    fs::create_dir(folder.path("sub")).unwrap();
    for line in [
        "a.csv -o a.csv",
        "a.csv -o ./sub/../a.csv",
        "a.csv --events a.csv",
        "a.csv --events ./a.csv",
        "a.toml -o a.toml",
        "a.toml --events a.toml",
        "brook -o b.wav --events b.wav",
        "brook --events brook.wav",
        "brook -o b.png --spectrogram ./b.png",
        "brook --events b.png --spectrogram b.png",
    ] {
        let words = ["cannot write", "give another name"];
        folder.refuses(&format!("render {line}"), &words);
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("a.csv", folder.path("link.csv")).unwrap();
        folder.refuses("render a.csv --events link.csv", &["another name"]);
        // What is no file holds nothing that could be lost.
        folder.succeeds("render a.csv -o /dev/null --events /dev/null");
    }
    // Nor does a scene that travels with the command.
    folder.succeeds("render brook --seconds 0.1 -o brook");
    folder.succeeds("render brook --seconds 0.1 -o brook");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported_and_the_rest_stays_valid() {
    let folder = Folder::new();
    for (option, name) in [
        ("-o", "full.wav"),
        ("--events", "full.csv"),
        ("--spectrogram", "full.png"),
    ] {
        std::os::unix::fs::symlink("/dev/full", folder.path(name)).unwrap();
        let outcome = folder.freshet(&format!("render brook --seconds 2 {option} {name}"));
        outcome.complains(&["cannot write", name]);
        if option != "-o" {
            folder.sound("brook.wav");
        }
    }
}

// The other commands.

#[test]
fn describe_shows_current_value_default_range_and_unit() {
    let folder = Folder::new();
    folder.write(
        "mine.toml",
        "drops.radius = 4.25\nwater.law = \"custom\"\n[intensity]\n\"mix.level\" = [[0, -10], [1, 0]]\n",
    );
    // The line that begins with `word`, single-spaced.
    let line = |text: &str, word: &str| {
        let line = text.lines().find(|line| line.trim().starts_with(word));
        let line = line.unwrap_or_else(|| panic!("no `{word}` in {text}"));
        line.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let all = folder.succeeds("describe");
    assert!(line(&all, "path").starts_with("path current default range unit"));
    for path in ["intensity", "water.rate", "swell.period", "mix.width"] {
        line(&all, path);
    }
    let all = folder.succeeds("describe --scene mine.toml");
    let radius = line(&all, "drops.radius");
    assert!(radius.starts_with("drops.radius 4.25 2.5 0.3 .. 20 mm "));
    assert!(line(&all, "mix.level").starts_with("mix.level -5 0 -80 .. 24 dB "));
    let one = folder.succeeds("describe drops.radius --scene mine.toml");
    assert_eq!(line(&one, "current"), "current 4.25");
    assert_eq!(line(&one, "default"), "default 2.5");
    assert!(line(&one, "range").starts_with("range 0.3 .. 20"));
    assert_eq!(line(&one, "unit"), "unit mm");
    assert!(!one.contains("drops.rate"));
    let law = folder.succeeds("describe water.law --scene mine.toml");
    assert_eq!(line(&law, "current"), "current custom");
    let group = folder.succeeds("describe drops");
    assert!(group.contains("drops.rate") && !group.contains("water."));
    folder.refuses("describe drops.raduis", &["did you mean `drops.radius`?"]);
    folder.refuses("describe zzz", &["no parameter `zzz`"]);
}

#[cfg(not(feature = "play"))]
#[test]
fn play_says_how_to_build_it_where_it_was_left_out() {
    let folder = Folder::new();
    let words = ["without a sound card", "--features play"];
    folder.refuses("play brook", &words);
}

// Flashing. No test asks for a probe that may be there: it would flash somebody's board.

#[test]
fn flash_takes_the_boards_and_a_probe_by_its_usb_ids() {
    let folder = Folder::new();
    folder.refuses("flash", &["--board"]);
    let boards = ["f407", "f411", "h743"];
    folder.refuses("flash --board desk", &boards);
    folder.refuses("flash --board f407 --probe mine", &["0483:374b"]);
}

#[cfg(not(feature = "flash"))]
#[test]
fn flash_says_how_to_build_it_where_it_was_left_out() {
    let folder = Folder::new();
    let words = [
        "without debug probes",
        "--features flash -- flash --board h743",
    ];
    folder.refuses("flash --board h743", &words);
}

#[cfg(feature = "flash")]
#[test]
fn flash_reads_the_firmware_before_it_looks_for_a_probe() {
    let folder = Folder::new();
    for (board, how) in [("f407", "build"), ("f411", "field"), ("h743", "build")] {
        let flag = if how == "field" { "--field" } else { "" };
        folder.refuses(
            &format!("flash --board {board} {flag}"),
            &[
                &format!("no target/thumbv7em-none-eabihf/firmware/freshet-{board}"),
                &format!("`cargo {how}-{board}`"),
            ],
        );
    }
    folder.write("a.hex", ":00000001FF");
    folder.write("h743", elf::Elf::firmware("h743").bytes());
    let mut x86 = elf::Elf::firmware("f407");
    x86.machine = 62;
    folder.write("x86", x86.bytes());
    for (file, word) in [
        ("nothing", "there is no nothing"),
        (".", "expected a file"),
        ("a.hex", "a.hex: not an ELF file"),
        ("x86", "x86: an ELF file for x86-64"),
        ("h743", "h743: firmware for board h743, expected board f407"),
    ] {
        folder.refuses(&format!("flash --board f407 --elf {file}"), &[word]);
    }
}

#[cfg(feature = "flash")]
#[test]
fn flash_without_its_probe_says_what_to_do() {
    let folder = Folder::new();
    folder.write("f407", elf::Elf::firmware("f407").bytes());
    let line = "flash --board f407 --elf f407 --probe ffff:ffff:none";
    folder.refuses(line, &["no debug probe ffff:ffff:none"]);
}

#[test]
fn bench_gives_multiples_of_real_time() {
    let folder = Folder::new();
    let table = folder.succeeds("bench --seconds 0.01");
    assert!(table.contains("x real time") && table.contains("brook"));
    for seconds in ["0", "nan", "1e9", "ten"] {
        folder.refuses(&format!("bench --seconds {seconds}"), &["--seconds"]);
    }
}

#[test]
fn help_and_version_are_there() {
    let folder = Folder::new();
    let help = folder.succeeds("--help");
    for command in ["render", "list", "describe", "play", "bench"] {
        assert!(help.contains(command), "{help}");
    }
    let help = folder.succeeds("render --help");
    let options = "output seconds seed rate bits board set spectrogram events raw";
    for option in options.split(' ') {
        assert!(help.contains(&format!("--{option}")), "{help}");
    }
    assert!(folder.succeeds("--version").starts_with("freshet "));
    let outcome = folder.freshet("");
    assert_eq!(outcome.code(), Some(2));
    assert!(outcome.err.contains("Usage"), "{outcome:?}");
}

const PAIR: &str = "Bub 0 0.003\n  Start: N 0\n  0 1086.667 0 0 0\n  End: C 0.2\n\
    Bub 1 0.003\n  Start: N 0.0\n  0 1086.667 0.006 0 0\n  End: C 0.2\n";

#[test]
fn tracks_are_rendered_coupled_and_uncoupled() {
    let folder = Folder::new();
    folder.write("pair.txt", PAIR);
    let told = folder.succeeds("render pair.txt --spectrogram pair.png");
    for words in [
        "pair.wav",
        "2 bubbles",
        "coupled   2 at most",
        "level",
        "one sample",
    ] {
        assert!(told.contains(words), "no `{words}` in {told}");
    }
    assert!(folder.read("pair.png").starts_with(b"\x89PNG"));
    let told = folder.succeeds("render pair.txt -o alone.wav --uncoupled");
    assert!(told.contains("--uncoupled"), "{told}");
    assert!(folder.read("pair.wav") != folder.read("alone.wav"));
    folder.succeeds("render pair.txt -o again.wav");
    assert!(folder.read("pair.wav") == folder.read("again.wav"));
}

#[test]
fn what_tracks_cannot_do_is_refused_before_a_file_is_touched() {
    let folder = Folder::new();
    folder.write("pair.txt", PAIR);
    folder.write("bad.txt", "Bub 0 0.003\n  Start: N zero\n");
    for (line, words) in [
        (
            "render pair.txt --solver exact",
            vec!["'exact'", "dense, reduced"],
        ),
        (
            "render pair.txt --epsilon 1",
            vec!["--epsilon 1", "above 1"],
        ),
        ("render pair.txt --events b.csv", vec!["--events"]),
        ("render pair.txt --board f407", vec!["--board f407"]),
        ("render bad.txt", vec!["bad.txt:2", "the start"]),
        ("render none.txt", vec!["cannot read", "none.txt"]),
        ("render pair.txt -o pair.txt", vec!["cannot write"]),
        (
            "render brook --uncoupled",
            vec!["--uncoupled", "bubble tracks"],
        ),
        ("modes none.csv", vec!["cannot read", "none.csv"]),
        ("cloud c.csv --count 0", vec!["--count 0"]),
        (
            "cloud c.txt --split 1.5",
            vec!["--split 1.5", "from 0 to 1"],
        ),
    ] {
        folder.refuses(line, &words);
    }
}

#[test]
fn a_cloud_is_made_and_its_modes_told() {
    let folder = Folder::new();
    folder.succeeds("cloud c.csv --count 40 --ball 30");
    let told = folder.succeeds("modes c.csv --plot c.png");
    assert_eq!(told.trim().lines().count(), 41, "{told}");
    assert!(folder.read("c.png").starts_with(b"\x89PNG"));
    let json: serde_json::Value =
        serde_json::from_str(&folder.succeeds("modes c.csv --json")).unwrap();
    let list = |name: &str| -> Vec<f64> {
        let values = json[name].as_array().unwrap();
        values.iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let (dense, reduced) = (list("frequencies_hz"), list("reduced_frequencies_hz"));
    assert_eq!((dense.len(), reduced.len()), (40, 40));
    assert!(dense.is_sorted());
    assert!(
        dense
            .iter()
            .zip(&reduced)
            .all(|(a, b)| (a / b - 1.0).abs() < 0.04)
    );
    folder.write(
        "mixed.csv",
        "x_m,y_m,z_m,radius_m\n0,0,0,0.01\n0.0001,0,0,0.0002\n0,0.0001,0,0.0002\n",
    );
    folder.write("wrong.csv", "x_m,y_m,z_m,radius_m\n0,0,0,big\n");
    folder.refuses(
        "modes mixed.csv --kernel cb --epsilon 0",
        &["not positive definite", "--kernel definite"],
    );
    folder.refuses("modes wrong.csv", &["wrong.csv:2", "radius_m", "`big`"]);
}
