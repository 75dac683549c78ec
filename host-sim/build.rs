//! The scenes that travel with the command: every TOML in `scenes/`, in the order of their names.

use std::{env, fmt::Write as _, fs, path::Path};

fn main() {
    let dir = Path::new(&env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("../scenes");
    let mut names: Vec<String> = fs::read_dir(&dir)
        .expect("scenes/ can be read")
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter_map(|name| Some(name.strip_suffix(".toml")?.to_owned()))
        .collect();
    names.sort();
    let mut out = String::from(
        "/// Name and text of every scene.\npub static SCENES: &[(&str, &str)] = &[\n",
    );
    for name in names {
        let path = dir.join(format!("{name}.toml"));
        writeln!(out, "    ({name:?}, include_str!({path:?})),").expect("a String takes it");
    }
    out.push_str("];\n");
    let target = Path::new(&env::var("OUT_DIR").expect("cargo sets it")).join("scenes.rs");
    fs::write(target, out).expect("OUT_DIR can be written");
    println!("cargo::rerun-if-changed={}", dir.display());
}
