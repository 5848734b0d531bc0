#!/usr/bin/env bash
# Other estimators on the same data as thetabus, in one run: benches/peers/run.sh [PAGE.md]
#
# Needs cargo, g++ and python3 with venv, and the package registries for the first time; everything
# lands in target/peers. Takes 3 minutes on a quiet machine after the build. Writes PAGE.md, or
# target/peers/peers.md.
set -euo pipefail
page=${1:+$(realpath "$1")}
cd "$(dirname "$0")"
mkdir -p ../../target/peers
target=$(cd ../../target/peers && pwd)
# One thread each: the comparison is per core.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

[ -x "$target/venv/bin/python" ] || python3 -m venv "$target/venv"
"$target/venv/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt
# What thetabus depends on, in the versions of the product.
cp ../../Cargo.lock rust/Cargo.lock
CARGO_TARGET_DIR=$target cargo build --quiet --release --manifest-path rust/Cargo.toml
g++ -O3 -march=native -std=c++17 -o "$target/arx_rls" arx_rls.cpp

lines=$target/lines.csv
{
    "$target/release/thetabus-peers" "$target/data"
    "$target/arx_rls" "$target/data"
    "$target/venv/bin/python" -W ignore peers.py "$target/data"
} | tee "$lines"
"$target/venv/bin/python" table.py "$lines" >"${page:-$target/peers.md}"
