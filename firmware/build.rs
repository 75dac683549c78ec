//! Puts the board's memory map where the linker finds it, and the built-in scenes as a bank into flash.

use std::{env, error::Error, fs, path::Path};

/// The scene of a new board.
const BOOT_SCENE: &str = "brook";
const BOARDS: [&str; 3] = ["f407", "f411", "h743"];

fn main() -> Result<(), Box<dyn Error>> {
    let out = env::var("OUT_DIR")?;
    let out = Path::new(&out);
    let chosen: Vec<&str> = BOARDS
        .into_iter()
        .filter(|board| env::var(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_ok())
        .collect();
    let [board] = chosen[..] else {
        return Err(
            format!("expected one board of {BOARDS:?} as a feature, got {chosen:?}").into(),
        );
    };
    // The memory.x at the top of the workspace includes this one.
    fs::copy(format!("src/board/{board}.x"), out.join("board.x"))?;
    fs::write(
        out.join("scenes.bank"),
        freshet_host::bank::built_in(BOOT_SCENE, None).map_err(|error| format!("{error:#}"))?,
    )?;
    println!("cargo::rustc-link-search={}", out.display());
    // Segments need no pages on a chip: the file holds what is flashed, and nothing between.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // By this symbol `freshet flash` knows whose firmware it is.
    println!("cargo::rustc-link-arg-bins=--defsym=__freshet_board_{board}=0");
    if env::var("CARGO_FEATURE_RTT").is_ok() {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
    println!("cargo::rerun-if-changed=src/board/{board}.x");
    println!("cargo::rerun-if-changed=build.rs");
    Ok(())
}
