#!/usr/bin/env bash
# Builds the release archive for this machine's system: `dash` (flex, ndarray, wgpu), README and licences.
set -euo pipefail
cd "$(dirname "$0")/.."

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
system=$(rustc -vV | sed -n 's/^host: //p')
target=${CARGO_TARGET_DIR:-target}
name=dash-$version-$system
stage=$target/dist/$name

# The player of web pages is part of the program.
dash-view/web/build.sh "$target/player"
DASH_PLAYER=$(cd "$target/player" && pwd)
export DASH_PLAYER
cargo build --release --locked -p dash-cli --bin dash --features player
rm -rf "$stage" && mkdir -p "$stage"
program=$target/release/dash
[ -f "$program" ] || program=$program.exe
cp "$program" README.md LICENSE-MIT LICENSE-APACHE "$stage"
# Half of the file is names of functions. Windows keeps them in a file of their own.
case $system in *windows*) ;; *) strip "$stage/dash" ;; esac

# The licences of everything that is linked in.
cargo tree --locked -p dash-cli -e normal --prefix none -f '{p}|{l}' | grep -v '(/' |
    sed 's/ ([^)]*)//g' | sort -u | while IFS='|' read -r package licence; do
        printf '\n======== %s: %s\n' "$package" "$licence"
        find "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*/"${package/ v/-}" -maxdepth 2 -type f \
            \( -iname 'licen[cs]e*' -o -iname 'copying*' -o -iname 'notice*' -o -iname '[ou]fl.txt' \) \
            ! -name '*.rs' -exec cat {} +
    done > "$stage/THIRD-PARTY-LICENSES.txt"

tar -C "$target/dist" -czf "$target/dist/$name.tar.gz" "$name"
echo "$target/dist/$name.tar.gz"
