#!/usr/bin/env bash
# build_wheel.sh BIN [MACHINE]: builds dist/elliptude-*.whl for any Linux with a glibc that is not older than 2.17, as manylinux2014 says,
# on this kind of processor, or on MACHINE as `uname -m` names it there, such as aarch64. BIN is the folder with the programs of the
# Python that it is for, with the build requirements and the extra `wheel`.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$(cd "$1" && pwd)
here=$(uname -m)
machine=${2:-$here}
work=build/wheel/$machine

# zig brings the headers and symbols of old versions of glibc, and a C++ library, which it links into the modules. With a target
# named it compiles for the oldest processor of its kind. What it does not have is looked for last, among the system's
# headers: Debian's Python has a header there that depends on the machine. It keeps what it compiled, its C++ library above all.
export CXX="$bin/python-zig c++ -target $machine-linux-gnu.2.17 -idirafter $PWD/$work/include -idirafter /usr/include"
export LDFLAGS=-s
export ZIG_GLOBAL_CACHE_DIR=$PWD/build/wheel/zig ZIG_LOCAL_CACHE_DIR=$PWD/build/wheel/zig

# For another machine CMake, pybind11 and scikit-build-core are told its name. Python's headers are this machine's: pyconfig.h differs
# only in what no other public header reads (CONTRIBUTING.md).
settings=()
platform=manylinux2014_$machine
if [ "$machine" != "$here" ]; then
    read -r python suffix < <("$bin/python" -c 'import sysconfig
print("python" + sysconfig.get_python_version(), sysconfig.get_config_var("EXT_SUFFIX"))')
    mkdir -p "$work/include/$machine-linux-gnu"
    ln -sfn "/usr/include/$here-linux-gnu/$python" "$work/include/$machine-linux-gnu/$python"
    export _PYTHON_HOST_PLATFORM=linux-$machine SETUPTOOLS_EXT_SUFFIX=${suffix/$here/$machine}
    for definition in CMAKE_SYSTEM_NAME=Linux CMAKE_SYSTEM_PROCESSOR="$machine" PYTHON_MODULE_EXTENSION="$SETUPTOOLS_EXT_SUFFIX"; do
        settings+=("--config-settings=cmake.define.$definition")
    done
    platform=auto # auditwheel knows by name the platforms of this machine only
fi

rm -rf "$work/raw" "$work/tagged"
"$bin/python" -m pip wheel --no-index --no-deps --no-build-isolation --wheel-dir "$work/raw" \
    --config-settings=build-dir="$work/cmake" --config-settings=install.strip=false "${settings[@]}" .
# Fails where a module needs more than manylinux2014 has.
PATH=$bin:$PATH "$bin/auditwheel" repair --plat "$platform" --wheel-dir "$work/tagged" "$work"/raw/*.whl
mkdir -p dist
mv "$work/tagged"/*manylinux2014_"$machine"*.whl dist/
