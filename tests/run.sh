#!/bin/sh
# The whole suite, on a fresh machine too: needs cargo and, for the first build, the crates.io registry.
set -eu
cd "$(dirname "$0")/.."

step() { printf '\n== %s\n' "$*"; "$@"; }

# The core has to build for a board; its target is added where it is missing.
target=thumbv7em-none-eabihf
if [ ! -d "$(rustc --print target-libdir --target "$target")" ]; then
    rustup target add "$target"
fi

step cargo fmt --all --check
step cargo clippy --workspace --all-targets -- --deny warnings
RUSTDOCFLAGS='--deny warnings' step cargo doc --workspace --no-deps
step cargo build --release --package freshet --target "$target"
step cargo test --workspace
# The same samples from an optimised build and from one as a debugger wants it.
step cargo test --release --test identical
step cargo test --profile plain --test identical
