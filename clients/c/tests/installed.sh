#!/bin/sh
# Installs the library into a directory of its own and builds with it as a user does, by CMake and by pkg-config: clients/c/tests/installed.sh [CMAKE]
set -eu
cmake=${1:-cmake}
cd "$(dirname "$0")/../../.."
work=$(mktemp -d)
domain=installed-$$
trap 'rm -rf "$work" "${XDG_RUNTIME_DIR:-/nowhere}/thetabus-$domain" "/tmp/thetabus-$(id -u)-$domain"; rm -f /dev/shm/thetabus_"$(id -u)"_"$domain"_*' EXIT
version=$(sed -n 's/^version = "\(.*\)"/\1/p' clients/c/Cargo.toml | head -1)
clients/c/install.sh "$work/prefix"

expect() {
    said=$("$@" "$domain")
    [ "$said" = "$version" ] || { echo "$1 says $said, expected $version" >&2; exit 1; }
}

"$cmake" -S clients/c/tests/installed -B "$work/cmake" -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_BUILD_TYPE=Release
"$cmake" --build "$work/cmake"
expect "$work/cmake/shared_c"
expect "$work/cmake/static_c"

export PKG_CONFIG_PATH="$work/prefix/lib/pkgconfig"
[ "$(pkg-config --modversion thetabus)" = "$version" ]
# The words are to be split.
# shellcheck disable=SC2046
cc clients/c/tests/installed/version.c $(pkg-config --cflags --libs thetabus) -o "$work/shared"
LD_LIBRARY_PATH=$work/prefix/lib expect "$work/shared"
c++ -std=c++17 clients/c/examples/subscribe.cpp $(pkg-config --cflags --libs thetabus) -o "$work/shared_cpp"
# Without the shared library beside it the linker takes the static one, which needs what --static adds.
mkdir "$work/static" && cp "$work/prefix/lib/libthetabus_c.a" "$work/static"
cc clients/c/tests/installed/version.c -L"$work/static" $(pkg-config --cflags --static --libs-only-l thetabus) -o "$work/static_c"
expect "$work/static_c"
ls -l "$work/prefix/lib" | awk '/libthetabus/ { printf "%s: %.1f MB\n", $NF, $5 / 1e6 }'
