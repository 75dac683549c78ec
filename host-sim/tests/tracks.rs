//! Bubble tracks as other programs write them, well and badly.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use freshet_host::cloud::ensemble::Ensemble;
use freshet_host::cloud::forcing::Cause;
use freshet_host::cloud::player::TrackPlayer;
use freshet_host::cloud::solver::Method;
use freshet_host::cloud::synthetic::{Law, Random, Stream, write_stream};
use freshet_host::cloud::tracks::{Oddity, Tracks, at_time};

fn read(text: impl AsRef<[u8]>) -> anyhow::Result<Tracks> {
    Tracks::read(
        Path::new("tracks.txt"),
        text.as_ref(),
        &AtomicBool::new(false),
    )
}

fn refusal(text: impl AsRef<[u8]>) -> String {
    match read(text) {
        Ok(_) => panic!("accepted"),
        Err(error) => format!("{error:#}"),
    }
}

const GOOD: &str = "\
Bub 7 0.003
  Start: N 0.1
  0.1 1086.7 0.01 -0.02 0.03 101325 0.02
  0.2 1087.7 0.01 -0.01 0.03 101325 0.01
  End: S 0.2 8 9
Bub 8 0.0028
  Start: S 0.2 7
  0.2 1164.2 0.01 -0.01 0.03
  End: M 0.3 10
Bub 9 0.0012
  Start: S 0.2 7
  0.2 2716.6 0.012 -0.01 0.03
  End: M 0.3 10
Bub 10 0.003
  Start: M 0.3 8 9
  0.3 1086.7 0.01 -0.01 0.03
  End: C 0.4
";

#[test]
fn a_good_file_is_read_whole_and_bubbles_go_on_in_their_heirs() {
    let mut tracks = read(GOOD).unwrap();
    assert_eq!(tracks.tracks.len(), 4);
    assert_eq!(tracks.tracks[0].next, Some(1));
    assert_eq!(tracks.tracks[1].next, Some(3));
    assert_eq!(
        (tracks.tracks[2].next, tracks.tracks[2].before),
        (None, None)
    );
    assert_eq!(tracks.tracks[3].cause, Cause::Merged([0.0028, 0.0012]));
    // One sample for a whole life is worth a note, and nothing else here.
    assert_eq!(
        tracks.oddities.sentences().len(),
        1,
        "{:?}",
        tracks.oddities
    );
    assert_eq!(tracks.oddities.count(Oddity::OneSample), 3);
    let samples = tracks.samples_of(0).unwrap();
    let (place, tone) = at_time(&samples, 0.003, tracks.surface, 0.15);
    assert!((tone.omega0 / std::f64::consts::TAU - 1087.2).abs() < 1e-3);
    assert!((place.depth - 0.015).abs() < 1e-6 && (place.at[1] + 0.015).abs() < 1e-6);
}

#[test]
fn line_ends_comments_tabs_and_a_byte_order_mark_change_nothing() {
    let good = read(GOOD).unwrap();
    let odd = format!(
        "\u{feff}# made by hand\r\n\r\n{}",
        GOOD.replace('\n', "  # why\r\n")
            .replace("  Start", "\tStart")
    );
    let odd = read(odd).unwrap();
    assert_eq!(good.samples, odd.samples);
    assert_eq!(good.tracks.len(), odd.tracks.len());
    assert_eq!(odd.line(0), 3);
}

#[test]
fn what_is_packed_is_unpacked_and_what_is_cut_off_is_said() {
    let mut packed =
        lzma_rust2::XzWriter::new(Vec::new(), lzma_rust2::XzOptions::with_preset(3)).unwrap();
    std::io::Write::write_all(&mut packed, GOOD.as_bytes()).unwrap();
    let packed = packed.finish().unwrap();
    assert_eq!(read(&packed).unwrap().tracks.len(), 4);
    let text = refusal(&packed[..packed.len() / 2]);
    assert!(text.contains("cannot unpack"), "{text}");
    let mut broken = packed.clone();
    let middle = packed.len() / 2;
    broken[middle] ^= 0x55;
    let text = refusal(&broken);
    assert!(text.contains("cannot unpack"), "{text}");
}

/// Reads it and says how often, and where first, something was odd.
fn odd(text: &str, oddity: Oddity) -> (u64, Vec<u64>) {
    let tracks = read(text).unwrap();
    (
        tracks.oddities.count(oddity),
        tracks.oddities.lines(oddity).to_vec(),
    )
}

#[test]
fn what_is_odd_is_counted_with_its_line() {
    let missing = "Bub 0 1e-3\n Start: N 0\n 0 3000 0 0 0\n 0.02 3000 0 0 0\nBub 1 1e-3\n Start: N 0.01\n 0.01 3000 0 0 0\n";
    assert_eq!(odd(missing, Oddity::NoEnd), (2, vec![1, 5]));
    let tracks = read(missing).unwrap();
    assert_eq!((tracks.tracks[0].end, tracks.tracks[1].end), (0.02, 0.01));
    let one = |body: &str| format!("Bub 0 1e-3\n Start: N 0.1\n{body}\n");
    for (text, oddity, line) in [
        (
            one(" 0.05 3000 0 0 0\n End: C 0.2"),
            Oddity::SampleBeforeStart,
            1,
        ),
        (
            one(" 0.25 3000 0 0 0\n End: C 0.2"),
            Oddity::SampleAfterEnd,
            1,
        ),
        (one(" 0.1 3000 0 0 0\n End: C 0.1"), Oddity::EndsAtStart, 1),
        (
            one(" 0.1 3000 0 0 0\n End: C 0.05"),
            Oddity::EndsBeforeStart,
            1,
        ),
        (one(" End: C 0.2"), Oddity::NoSamples, 1),
        (
            one(" 0.2 3000 0 0 0\n 0.1 3000 0 0 0\n End: C 0.2"),
            Oddity::Unordered,
            1,
        ),
        (one(" 0.1 -1 0 0 0\n End: C 0.2"), Oddity::NoFrequency, 3),
        (one(" 0.1 nan 0 0 0\n End: C 0.2"), Oddity::NoFrequency, 3),
        (
            one(" 0.1 3000 0 0 0 what\n End: C 0.2"),
            Oddity::NoPressure,
            3,
        ),
        (one(" 0.1 3000 0 0 0 1 -0.1\n End: C 0.2"), Oddity::Above, 3),
        (
            one(" 0.1 3000 0 0 0 1 0.1 5\n End: C 0.2"),
            Oddity::MoreColumns,
            3,
        ),
        (one(" 0.1 3000 0 0 0\n End: M 0.2 99"), Oddity::NoChild, 1),
        (one(" 0.1 3000 0 0 0\n End: S 0.2"), Oddity::OddChildren, 1),
        (
            "Bub 0 1e-3\n Start: S 0.1 5\n 0.1 3000 0 0 0\n End: C 0.2\n".into(),
            Oddity::NoParent,
            1,
        ),
        (
            "Bub 0 1e-3\n Start: M 0.1\n 0.1 3000 0 0 0\n End: C 0.2\n".into(),
            Oddity::LoneMerger,
            1,
        ),
        (
            "Bub 0 1e-3\n Start: N 0.1 3\n 0.1 3000 0 0 0\n End: C 0.2\n".into(),
            Oddity::EntrainedParents,
            1,
        ),
        (
            "Bub 0 1e-3\n Start: N -0.1\n 0.1 3000 0 0 0\n End: C 0.2\n".into(),
            Oddity::Negative,
            1,
        ),
        (
            "Bub 0 1e-3\n 0.1 3000 0 0 0\n Start: N 0.1\n End: C 0.2\n".into(),
            Oddity::SampleAboveStart,
            2,
        ),
    ] {
        assert_eq!(odd(&text, oddity), (1, vec![line]), "{oddity:?}: {text}");
    }
    let child_first = "Bub 0 1e-3\n Start: N 0.2\n 0.2 3000 0 0 0\n End: S 0.3 1 2\n\
        Bub 1 8e-4\n Start: S 0.1 0\n 0.1 3000 0 0 0\n End: C 0.3\n\
        Bub 2 5e-4\n Start: S 0.3 0\n 0.3 3000 0 0 0\n End: C 0.4\n";
    assert_eq!(odd(child_first, Oddity::BeforeParent), (1, vec![5]));
    let one_sided = GOOD.replace("Start: S 0.2 7", "Start: S 0.2");
    let (count, lines) = odd(&one_sided, Oddity::OneSided);
    assert_eq!((count, lines), (2, vec![1, 1]));
}

#[test]
fn bubbles_that_descend_from_themselves_are_cut_loose() {
    let loop_of = |a: &str, b: &str| {
        format!(
            "Bub 0 1e-3\n Start: S 0.1 {a}\n 0.1 3000 0 0 0\n End: S 0.2 {b} 2\n\
             Bub 1 1e-3\n Start: S 0.1 0\n 0.1 3000 0 0 0\n End: S 0.2 0 2\n\
             Bub 2 1e-3\n Start: S 0.2 0 1\n 0.2 3000 0 0 0\n End: C 0.3\n"
        )
    };
    assert_eq!(odd(&loop_of("1", "1"), Oddity::Cycle), (2, vec![1, 5]));
    assert_eq!(odd(&loop_of("0", "0"), Oddity::Cycle).1[0], 1);
    for text in [loop_of("1", "1"), loop_of("0", "0")] {
        assert!(
            play(read(&text).unwrap(), false)
                .iter()
                .all(|x| x.is_finite())
        );
    }
}

#[test]
fn what_cannot_be_understood_is_refused_with_line_and_reason() {
    for (text, line, words) in [
        ("Bub x 1e-3\n", 1, "whole number"),
        ("Bub 0\n", 1, "got nothing"),
        ("Bub 0 0\n", 1, "in metres"),
        ("Bub 0 1.5\n", 1, "in metres"),
        ("Bub 0 nan\n", 1, "the radius"),
        ("Bub 0 1e-3 5\n", 1, "end of the line"),
        ("Bub 0 1e-3\n 0 3000 0 0 0\n", 1, "`Start:`"),
        ("Bub 0 1e-3\nBub 1 1e-3\n", 1, "no `Start:`"),
        ("Bub 0 1e-3\n Start: X 0\n", 2, "N entrained"),
        ("Bub 0 1e-3\n Start: N inf\n", 2, "the start"),
        (
            "Bub 0 1e-3\n Start: N 0\n Start: N 0\n",
            3,
            "second `Start:`",
        ),
        ("Bub 0 1e-3\n Start: N 0\n 0 3000 0 0\n", 3, "z: expected"),
        ("Bub 0 1e-3\n Start: N 0\n 0 3,000 0 0 0\n", 3, "frequency"),
        ("Bub 0 1e-3\n Start: N 0\n nan 3000 0 0 0\n", 3, "the time"),
        ("Bub 0 1e-3\n Start: N 0\n End: C\n", 3, "the end"),
        ("Bub 0 1e-3\n Start: N 0\n End: Q 1\n", 3, "C collapses"),
        ("Bub 0 1e-3\n Start: N 0\n End: S 1 one\n", 3, "a child"),
        (" 0 3000 0 0 0\n", 1, "outside any bubble"),
        (" End: C 1\n", 1, "without a bubble"),
        (
            "Bub 0 1e-3\n Start: N 0\n End: C 1\nBub 0 1e-3\n",
            4,
            "line 1",
        ),
        ("hello world\n", 1, "expected `Bub`"),
    ] {
        let got = refusal(text);
        assert!(
            got.starts_with(&format!("tracks.txt:{line}: ")),
            "{text}: {got}"
        );
        assert!(got.contains(words), "{text}: {got}");
    }
    assert!(refusal("").contains("no bubbles"));
    assert!(refusal("# nothing\n").contains("no bubbles"));
    assert!(refusal(vec![b'x'; 1 << 18]).contains("65536 bytes"));
    assert!(refusal(b"Bub 0 1e-3\n\xff\xfe\n").contains("expected text"));
}

#[test]
fn any_bytes_and_any_mangled_file_are_read_or_refused() {
    let mut random = Random::new(3);
    let words = [
        "Bub", "Start:", "End:", "N", "M", "S", "C", "0", "1", "2", "-1", "1e-3", "nan", "1e400",
        "0.1", "3000", "#", "\n", "\n", "\r\n", " ", "\u{1}",
    ];
    let mut played = 0;
    for round in 0..20_000 {
        let text: Vec<u8> = if round % 2 == 0 {
            (0..random.bits() % 60)
                .flat_map(|_| {
                    format!("{} ", words[random.bits() as usize % words.len()]).into_bytes()
                })
                .collect()
        } else {
            // The good file with lines left out, doubled or moved and bytes changed.
            let mut lines: Vec<&str> = GOOD.lines().collect();
            for _ in 0..1 + random.bits() % 4 {
                let (a, b) = (
                    random.bits() as usize % lines.len(),
                    random.bits() as usize % lines.len(),
                );
                match random.bits() % 3 {
                    0 => {
                        lines.remove(a);
                    }
                    1 => lines.insert(b, lines[a]),
                    _ => lines.swap(a, b),
                }
            }
            let mut bytes = lines.join("\n").into_bytes();
            if random.bits().is_multiple_of(2) {
                let at = random.bits() as usize % bytes.len();
                bytes[at] = b"0123456789.-eNMSC: \n"[random.bits() as usize % 20];
            }
            bytes
        };
        match read(&text) {
            Ok(tracks) => {
                if tracks.end() < 1.0 && round % 20 < 2 {
                    played += 1;
                    assert!(play(tracks, false).iter().all(|x| x.is_finite()));
                }
            }
            Err(error) => assert!(error.to_string().starts_with("tracks.txt"), "{error}"),
        }
    }
    println!("{played} of the mangled files were played");
}

fn play(tracks: Tracks, alone: bool) -> Vec<f64> {
    let method = Method {
        coupling: Default::default(),
        choice: None,
        rate: 48_000.0,
    };
    let mut player = TrackPlayer::new(tracks, Ensemble::new(method, alone), 48_000.0, 1);
    let mut sound = Vec::new();
    while !player.is_over() && sound.len() < 480_000 {
        player.play(&mut sound).unwrap();
    }
    sound
}

/// The pour of docs/clouds.md.
fn stream() -> Stream {
    Stream {
        seconds: 3.0,
        rate: 600.0,
        radius: [0.5e-3, 3e-3],
        law: Law::Log,
        region: [0.06, 0.05, 0.06],
        rise: 0.25,
        life: 0.15,
        split: 0.2,
        merge: 0.2,
        step: 1e-3,
        seed: 4,
    }
}

#[test]
fn a_generated_stream_is_in_order_but_for_single_samples() {
    let mut text = Vec::new();
    let count = write_stream(&stream(), &mut text).unwrap();
    let tracks = read(&text).unwrap();
    assert_eq!(tracks.tracks.len() as u64, count);
    let odd = tracks.oddities.sentences();
    assert!(
        odd.iter().all(|line| line.contains("one sample")),
        "{odd:?}"
    );
    assert!(
        tracks
            .tracks
            .iter()
            .filter(|track| track.before.is_some())
            .count()
            > 50
    );
}

/// Mean frequency of the power, Hz.
fn centroid(sound: &[f64]) -> f64 {
    let n = sound.len().next_power_of_two();
    let mut padded = sound.to_vec();
    padded.resize(n, 0.0);
    let fft = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let mut bins = fft.make_output_vec();
    fft.process(&mut padded, &mut bins).unwrap();
    let hz = |i: usize| i as f64 * 48_000.0 / n as f64;
    let power = |i: usize| bins[i].norm_sqr();
    let range = 1..n / 2;
    range.clone().map(|i| power(i) * hz(i)).sum::<f64>() / range.map(power).sum::<f64>()
}

#[test]
fn coupling_moves_the_centroid_of_a_pour_down() {
    let mut text = Vec::new();
    write_stream(&stream(), &mut text).unwrap();
    let coupled = centroid(&play(read(&text).unwrap(), false));
    let alone = centroid(&play(read(&text).unwrap(), true));
    println!("centroid of a stream: {alone:.0} Hz alone, {coupled:.0} Hz coupled");
    assert!(coupled < 0.95 * alone);
}

#[test]
fn no_birth_death_split_or_merger_jumps() {
    // The same bubbles, all of whose pulses are over long before the many deaths and changes at the end of the file:
    // what is above 12 kHz then is no more than before.
    // Few, whose changes are dated to a millisecond, and many, to four.
    for count in [40, 200] {
        let mut text = String::new();
        for i in 0..count {
            let (x, y) = (f64::from(i % 7) * 6e-3, -f64::from(i / 7) * 6e-3);
            let end = 0.03 + 0.0005 * f64::from(i);
            text += &format!(
                "Bub {i} 0.003\n Start: N 0\n 0 1090 {x} {y} 0\n {end} 1090 {x} {y} 0.002\n End: C {end}\n"
            );
        }
        let sound = play(read(&text).unwrap(), false);
        // A sixth difference is a steep high-pass.
        let high = |range: std::ops::Range<usize>| {
            let mut work = sound[range].to_vec();
            for _ in 0..6 {
                work = work.windows(2).map(|w| w[1] - w[0]).collect();
            }
            work.iter().fold(0.0f64, |a, b| a.max(b.abs())) / 64.0
        };
        let peak = sound.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let db = 20.0 * (high(1440..2500) / peak).log10();
        println!("deaths of {count} coupled bubbles: {db:.0} dB above 12 kHz re the peak");
        assert!(db < -60.0);
    }
}
