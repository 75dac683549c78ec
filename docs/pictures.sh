#!/bin/sh
# Draws the pictures of docs/scenes.md, docs/clouds.md, docs/fire.md and the glass of docs/transfer.md anew. With pngquant
# on the path they become a third of the size.
set -eu
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
sound="$work/sound.wav"
small() {
    if command -v pngquant >/dev/null; then
        pngquant --force --ext .png 48 "$1"
    fi
}
for scene in scenes/*.toml; do
    name=$(basename "$scene" .toml)
    case $name in
        surf) seconds=40 ;;
        *) seconds=12 ;;
    esac
    cargo freshet render "$name" --seconds "$seconds" -o "$sound" --spectrogram "docs/pictures/$name.png"
    small "docs/pictures/$name.png"
done

cargo freshet cloud "$work/pour.txt" --seconds 3 --rate 600 --region 60 50 60 --life 0.15 --merge 0.2 --seed 4
cargo freshet render "$work/pour.txt" -o "$sound" --spectrogram docs/pictures/cloud-coupled.png
cargo freshet render "$work/pour.txt" --uncoupled -o "$sound" --spectrogram docs/pictures/cloud-uncoupled.png
cargo freshet cloud "$work/c.csv" --count 128 --ball 40
cargo freshet modes "$work/c.csv" --plot docs/pictures/modes.png
for picture in cloud-coupled cloud-uncoupled modes; do
    small "docs/pictures/$picture.png"
done
cargo freshet vessel vessels/glass.toml --plot docs/pictures/vessel-glass.png >/dev/null
small docs/pictures/vessel-glass.png
cargo freshet bake fires/campfire.toml -o "$work/campfire.texture" --slice docs/pictures/fire-slice.png \
    --energy docs/pictures/fire-energy.png --spectrogram docs/pictures/fire-rows.png
for picture in fire-slice fire-energy fire-rows; do
    small "docs/pictures/$picture.png"
done
