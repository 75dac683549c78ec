//! Tables of the audio path, computed in f64 with `libm` (the same on every host) and rounded to nearest.

use std::{env, fmt::Write as _, fs, path::Path};

fn table(out: &mut String, name: &str, doc: &str, kind: &str, values: impl Iterator<Item = f64>) {
    let values: Vec<String> = values
        .map(|v| format!("{}", libm::round(v) as i64))
        .collect();
    writeln!(
        out,
        "/// {doc}\npub static {name}: [{kind}; {}] = [{}];",
        values.len(),
        values.join(", ")
    )
    .unwrap();
}

fn main() {
    let q26 = libm::exp2(26.0);
    let q30 = libm::exp2(30.0);
    let q31 = libm::exp2(31.0);
    let turn = 2.0 * std::f64::consts::PI;
    let mut out = String::new();
    let sine = |i: i32| libm::round(libm::sin(turn * f64::from(i) / 1024.0) * (q31 - 8.0)) as i64;
    let pairs: Vec<String> = (0..1024)
        .map(|i| format!("[{}, {}]", sine(i), 2 * (sine(i + 1) - sine(i))))
        .collect();
    writeln!(
        out,
        "/// sin of i/1024 turn, full scale 2^31 - 8, and twice its growth to the next entry.\npub static SINE: [[i32; 2]; 1024] = [{}];",
        pairs.join(", ")
    )
    .unwrap();
    table(
        &mut out,
        "LOG2",
        "log2(1 + i/256), Q26.",
        "u32",
        (0..=256).map(|i| libm::log2(1.0 + f64::from(i) / 256.0) * q26),
    );
    table(
        &mut out,
        "EXP2",
        "2^(-i/256), Q31.",
        "u32",
        (0..=256).map(|i| libm::exp2(-f64::from(i) / 256.0) * q31),
    );
    table(
        &mut out,
        "ATTACK",
        "Soft attack HF (39) over e from 0.85 to 1 in 512 steps, full scale 2^31 - 1.",
        "i32",
        (0..=512).map(|i| {
            let over = 0.15 * f64::from(i) / 512.0;
            libm::exp(-over * over / 0.002_812_5) * (q31 - 1.0)
        }),
    );
    table(
        &mut out,
        "PAN",
        "Gain of the right ear at i/256 of the way from left to right, 1 in the middle, Q30.",
        "i32",
        (0..=256).map(|i| libm::sqrt(2.0) * libm::sin(turn / 4.0 * f64::from(i) / 256.0) * q30),
    );
    let dir = env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    fs::write(Path::new(&dir).join("tables.rs"), out).expect("OUT_DIR can be written");
    println!("cargo::rerun-if-changed=build.rs");
}
