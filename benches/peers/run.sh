#!/usr/bin/env bash
# Other estimators on the same data as ours, in one run: benches/peers/run.sh [PAGE.md]
#
# Needs cargo, g++ and python3 with venv, and the package registries for the first time; everything lands in target/peers.
# Takes some minutes on a quiet machine. The times of Python are processor time, those of the others the fastest of five runs.
set -euo pipefail
page=${1:+$(realpath "$1")}
cd "$(dirname "$0")"
target=../../target/peers
mkdir -p "$target"
target=$(cd "$target" && pwd)
# One thread each: the comparison is per core.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

[ -x "$target/venv/bin/python" ] || python3 -m venv "$target/venv"
"$target/venv/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt
CARGO_TARGET_DIR=$target cargo build --quiet --release --locked --manifest-path rust/Cargo.toml
g++ -O3 -march=native -std=c++17 -o "$target/arx_rls" arx_rls.cpp

lines=$target/lines.csv
{
    "$target/release/thetabus-peers" "$target/data"
    "$target/arx_rls" "$target/data"
    "$target/venv/bin/python" peers.py "$target/data"
} | tee "$lines"
"$target/venv/bin/python" table.py "$lines" >"${page:-$target/peers.md}"
