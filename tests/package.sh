#!/usr/bin/env bash
# Packs the crates as the registry would get them, and checks what was packed in a workspace of its own, where profile
# and compiled dependencies are those of this one. `--publish` has cargo go through all steps of publishing but the upload;
# it compiles the packed crates in its development profile, so here with the smallest backend alone.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "${1:-}" = --publish ]; then
    exec cargo publish --dry-run --workspace --exclude dash --no-default-features --features flex
fi
cargo package --no-verify --workspace --exclude dash "$@"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
{
    printf '[workspace]\nmembers = ["dash-*"]\nresolver = "3"\n\n'
    sed -n '/^\[profile/,/^$/p' Cargo.toml
    echo '[patch.crates-io]'
} > "$scratch/Cargo.toml"
for crate in dash-kernels dash-model dash-view dash-train dash-cli; do
    # With today's times: packed files have one time, and cargo would take what it compiled of an older package for this.
    tar -xzmf "${CARGO_TARGET_DIR:-target}/package/$crate-$version.crate" -C "$scratch"
    echo "$crate = { path = \"$crate-$version\" }" >> "$scratch/Cargo.toml"
done
cp Cargo.lock "$scratch"
cargo check --release --offline --all-targets --manifest-path "$scratch/Cargo.toml"
