#!/usr/bin/env bash
# Builds the player of web pages into OUT: dash_view.js and dash_view_bg.wasm, for `dash export --web`.
#
#   dash-view/web/build.sh OUT
#
# Needs Rust's target wasm32-unknown-unknown, and wasm-bindgen of the version in Cargo.lock; both are installed where they are
# missing. Where there is wasm-opt (Binaryen), it makes the module smaller.
set -euo pipefail
[ $# -eq 1 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-$PWD/target}

rustup target add wasm32-unknown-unknown >/dev/null 2>&1
version=$(sed -n '/^name = "wasm-bindgen"$/{n;s/version = "\(.*\)"/\1/p}' Cargo.lock)
bindgen=$target/tools/bin/wasm-bindgen
if [ "$("$bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]; then
    cargo install --quiet --root "$target/tools" --target-dir "$target/tools/build" wasm-bindgen-cli --version "$version"
fi

# Random numbers come from the browser. A profile of its own: a small module matters more than a fast one, whose work the GPU does.
export RUSTFLAGS='--cfg getrandom_backend="wasm_js"'
cargo rustc --profile player --package dash-view --lib --target wasm32-unknown-unknown \
    --no-default-features --features wgpu --crate-type cdylib
"$bindgen" --target no-modules --no-typescript --remove-name-section --out-dir "$out" \
    "$target/wasm32-unknown-unknown/player/dash_view.wasm"
if command -v wasm-opt >/dev/null; then
    wasm-opt -Oz --all-features -o "$out/dash_view_bg.wasm" "$out/dash_view_bg.wasm"
fi
ls -l "$out"/dash_view*
