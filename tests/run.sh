#!/bin/sh
# The whole suite, on a fresh machine too: needs cargo and, for the first build, the crates.io registry.
set -eu
cd "$(dirname "$0")/.."

step() { printf '\n== %s\n' "$*"; "$@"; }

# The firmware is built for a board; its target is added where it is missing.
target=thumbv7em-none-eabihf
if [ ! -d "$(rustc --print target-libdir --target "$target")" ]; then
    rustup target add "$target"
fi

step cargo fmt --all --check
step cargo clippy --all-targets --features freshet-host/flash -- --deny warnings
RUSTDOCFLAGS='--deny warnings' step cargo doc --no-deps
# Without logs, on the board with the least flash; the builds below are what the emulator boots.
step cargo field-f411
for board in f407 f411 h743; do
    step cargo clippy --profile firmware --package freshet-firmware --target "$target" \
        --no-default-features --features "$board,rtt,usb" -- --deny warnings
    step cargo "build-$board"
done
step cargo test
# The same samples from an optimised build and from one as a debugger wants it.
step cargo test --package freshet-builds --release
step cargo test --package freshet-builds --profile plain
# The firmware as it is flashed, in an emulated board.
emulator="--manifest-path emulated-board/Cargo.toml"
step cargo fmt $emulator --check
step cargo clippy $emulator --ignore-rust-version --all-targets -- --deny warnings
step cargo test $emulator --ignore-rust-version
