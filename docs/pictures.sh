#!/bin/sh
# Draws the pictures of docs/scenes.md and the glass of docs/transfer.md anew. With pngquant on the path they become a third of the size.
set -eu
cd "$(dirname "$0")/.."
sound=$(mktemp)
trap 'rm -f "$sound"' EXIT
for scene in scenes/*.toml; do
    name=$(basename "$scene" .toml)
    case $name in
        surf) seconds=40 ;;
        *) seconds=12 ;;
    esac
    cargo freshet render "$name" --seconds "$seconds" -o "$sound" --spectrogram "docs/pictures/$name.png"
    if command -v pngquant >/dev/null; then
        pngquant --force --ext .png 48 "docs/pictures/$name.png"
    fi
done
cargo freshet vessel vessels/glass.toml --plot docs/pictures/vessel-glass.png >/dev/null
if command -v pngquant >/dev/null; then
    pngquant --force --ext .png 48 docs/pictures/vessel-glass.png
fi
