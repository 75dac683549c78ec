//! Tables of the audio path, computed in f64 with `libm` (the same on every host) and rounded to nearest.

use std::{env, fmt::Write as _, fs, path::Path};

fn pairs(
    out: &mut String,
    name: &str,
    doc: &str,
    kind: &str,
    values: impl Iterator<Item = [f64; 2]>,
) {
    let pairs = values.map(|[a, b]| format!("[{}, {}]", libm::round(a), libm::round(b)));
    let pairs: Vec<String> = pairs.collect();
    writeln!(
        out,
        "/// {doc}\npub static {name}: [[{kind}; 2]; {}] = [{}];",
        pairs.len(),
        pairs.join(", ")
    )
    .unwrap();
}

fn main() {
    // The multiplications of a Cortex-M4: SMLAL with SMMLA.
    println!("cargo::rustc-check-cfg=cfg(dsp)");
    let target = env::var("TARGET").expect("cargo sets TARGET");
    if target.starts_with("thumbv7em") {
        println!("cargo::rustc-cfg=dsp");
    }
    let q26 = libm::exp2(26.0);
    let q28 = libm::exp2(28.0);
    let q30 = libm::exp2(30.0);
    let q31 = libm::exp2(31.0);
    let turn = 2.0 * std::f64::consts::PI;
    let mut out = String::new();
    // A line through both ends of a stretch, as what it is at 0 and its growth to 1.
    let line = |f: &dyn Fn(f64) -> f64, from: f64, to: f64| {
        let (begin, growth) = (f(from), (f(to) - f(from)) / (to - from));
        [begin - from * growth, growth]
    };
    // Phases are from -1/2 to 1/2, and the upper half comes first. The halves are for what the product is rounded down by.
    let sine = |x: f64| libm::sin(turn * x) * q28;
    pairs(
        &mut out,
        "SINE",
        "Sine in the i-th of 1024 parts of a turn, Q28, by a line over a phase of signed Q32.",
        "i32",
        (0..1024).map(|i| {
            let from = f64::from((i + 512) % 1024 - 512) / 1024.0;
            let [begin, growth] = line(&sine, from, from + 1.0 / 1024.0);
            [begin + 0.5, growth]
        }),
    );
    pairs(
        &mut out,
        "SINE_COSINE",
        "Sine and cosine of i/1024 turn, Q30.",
        "i32",
        (0..1024).map(|i| {
            let phase = turn * f64::from(i) / 1024.0;
            [libm::sin(phase) * q30, libm::cos(phase) * q30]
        }),
    );
    let chord =
        |f: &dyn Fn(f64) -> f64, i: i32| line(f, f64::from(i) / 256.0, f64::from(i + 1) / 256.0);
    pairs(
        &mut out,
        "NEG_LOG2",
        "1 - log2(1 + x) for x in the i-th of 256 parts, Q26, by a line; never below 0. The growth is for an x of Q31, less 1.",
        "i32",
        (0..256).map(|i| {
            let [begin, growth] = chord(&|x| (1.0 - libm::log2(1.0 + x)) * q26, i);
            let growth = libm::round(2.0 * growth);
            [libm::ceil(begin + growth / 2.0 + 0.25), growth]
        }),
    );
    pairs(
        &mut out,
        "EXP2_NEG",
        "2^-x for x in the i-th of 256 parts, Q31, by a line. The fall is for an x of Q32.",
        "u32",
        (0..256).map(|i| {
            let [begin, growth] = chord(&|x| libm::exp2(-x) * q31, i);
            [begin, -growth]
        }),
    );
    let soft = |e: f64| {
        let over = (e - 0.85).max(0.0);
        e * libm::exp(-over * over / 0.002_812_5) * q26
    };
    pairs(
        &mut out,
        "ATTACK",
        "Envelope under the soft attack HF (39) in the i-th of 4096 parts from the 3352nd on, Q26, by a line over one of Q31.",
        "i32",
        (3352..4096).map(|i| {
            let [begin, growth] = line(&soft, f64::from(i) / 4096.0, f64::from(i + 1) / 4096.0);
            [begin + 0.5, 2.0 * growth]
        }),
    );
    let gain = |i: i32| libm::sqrt(2.0) * libm::sin(turn / 4.0 * f64::from(i) / 256.0) * q31;
    pairs(
        &mut out,
        "PAN",
        "Gains of the two ears at i/256 of the way from left to right, 1 in the middle, Q31.",
        "u32",
        (0..256).map(|i| [gain(256 - i), gain(i)]),
    );
    let dir = env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    fs::write(Path::new(&dir).join("tables.rs"), out).expect("OUT_DIR can be written");
    println!("cargo::rerun-if-changed=build.rs");
}
