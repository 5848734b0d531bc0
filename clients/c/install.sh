#!/bin/sh
# Builds the library for C and C++ and installs it: clients/c/install.sh PREFIX
set -eu
prefix=${1:?"usage: install.sh PREFIX"}
mkdir -p "$prefix"
prefix=$(cd "$prefix" && pwd)
cd "$(dirname "$0")/../.."
cargo build --locked --profile client -p thetabus-c
built=${CARGO_TARGET_DIR:-target}/client
version=$(sed -n 's/^version = "\(.*\)"/\1/p' clients/c/Cargo.toml | head -1)
mkdir -p "$prefix/include" "$prefix/lib/pkgconfig" "$prefix/lib/cmake/thetabus"
cp clients/c/include/thetabus.h clients/c/include/thetabus.hpp "$prefix/include/"
cp "$built/libthetabus_c.so" "$built/libthetabus_c.a" "$prefix/lib/"
cp clients/c/cmake/thetabus-config.cmake "$prefix/lib/cmake/thetabus/"
sed -e "s|@version@|$version|" clients/c/cmake/thetabus-config-version.cmake > "$prefix/lib/cmake/thetabus/thetabus-config-version.cmake"
sed -e "s|@prefix@|$prefix|" -e "s|@version@|$version|" clients/c/thetabus.pc.in > "$prefix/lib/pkgconfig/thetabus.pc"
