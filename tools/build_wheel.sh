#!/usr/bin/env bash
# build_wheel.sh BIN: builds dist/elliptude-*.whl for any Linux on this processor with a glibc that is not older than 2.17, as
# manylinux2014 says. BIN is the folder with the programs of the Python that it is for, with the build requirements and the extra `wheel`.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$(cd "$1" && pwd)
machine=$(uname -m)
work=build/wheel

# zig brings the headers and symbols of old versions of glibc, and a C++ library, which it links into the modules. With a target
# named it compiles for the oldest processor of its kind. What it does not have is looked for last, among the system's
# headers: Debian's Python has a header there that depends on the machine. It keeps what it compiled, its C++ library above all.
export CXX="$bin/python-zig c++ -target $machine-linux-gnu.2.17 -idirafter /usr/include"
export LDFLAGS=-s
export ZIG_GLOBAL_CACHE_DIR=$PWD/$work/zig ZIG_LOCAL_CACHE_DIR=$PWD/$work/zig

rm -rf "$work/raw"
"$bin/python" -m pip wheel --no-index --no-deps --no-build-isolation --wheel-dir "$work/raw" \
    --config-settings=build-dir="$work/cmake" --config-settings=install.strip=false .
# Fails where a module needs more than manylinux2014 has.
PATH=$bin:$PATH "$bin/auditwheel" repair --plat "manylinux2014_$machine" --wheel-dir dist "$work"/raw/*.whl
