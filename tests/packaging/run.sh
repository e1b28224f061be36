#!/usr/bin/env bash
# Builds and installs elliptude in every way that a user may, and uses each from a project outside its tree:
# an installed copy, a subdirectory, and a wheel made from the sdist without the system's Eigen.
# Needs the network (PyPI) for the last. Run from anywhere.
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

version=$(sed -n 's/^#define ELLIPTUDE_VERSION_[A-Z]* //p' "$source_dir/cpp/include/elliptude/version.hpp" | paste -sd .)
# Where Debian's libeigen3-dev has its CMake package, and a self-built Eigen may have it.
no_system_eigen='-DCMAKE_IGNORE_PATH=/usr/share/eigen3/cmake;/usr/local/share/eigen3/cmake'
passed=0

fail() {
    echo "FAILED: $1" >&2
    exit 1
}

passes() {
    echo "passed: $1"
    passed=$((passed + 1))
}

# consume NAME CMAKE_OPTION...: configure, build and run the consumer; it must print the version.
consume() {
    local name=$1
    shift
    # A user has no doctest.
    cmake -S "$source_dir/tests/packaging/consumer" -B "consumer-$name" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_DISABLE_FIND_PACKAGE_doctest=ON "$@" >"$name.log" 2>&1 || { cat "$name.log"; fail "$name: configure"; }
    cmake --build "consumer-$name" >"$name.log" 2>&1 || { cat "$name.log"; fail "$name: build"; }
    [ "$("consumer-$name/consumer")" = "$version" ] || fail "$name: run"
    passes "consumer, $name"
}

echo "elliptude $version"

# --- C++ ---
cmake -S "$source_dir" -B build -DELLIPTUDE_BUILD_TESTS=OFF -DELLIPTUDE_BUILD_EXAMPLES=OFF >/dev/null
cmake --install build --prefix "$work/first" >/dev/null
mv first moved # an installed copy may be moved
consume find_package -DCMAKE_PREFIX_PATH="$work/moved"
consume add_subdirectory -DELLIPTUDE_SOURCE="$source_dir"
consume FetchContent -DELLIPTUDE_FETCHED=ON -DFETCHCONTENT_SOURCE_DIR_ELLIPTUDE="$source_dir"

# compiled PROGRAM: a program that pkg-config's flags have made prints the version.
compiled() {
    [ "$("./$1")" = "$version" ] || fail "pkg-config, $1: run"
    passes "pkg-config, $1"
}
export PKG_CONFIG_PATH="$work/moved/share/pkgconfig"
[ "$(pkg-config --modversion elliptude)" = "$version" ] || fail "pkg-config: version"
# The flags are several words.
# shellcheck disable=SC2046
c++ -std=c++17 "$source_dir/tests/packaging/consumer/main.cpp" $(pkg-config --cflags --libs elliptude) -o headers ||
    fail "pkg-config, headers: compile"
compiled headers

# --- the C library ---
cmake -S "$source_dir" -B build-c -DELLIPTUDE_BUILD_TESTS=OFF -DELLIPTUDE_BUILD_EXAMPLES=OFF -DELLIPTUDE_C_INTERFACE=ON \
    -DCMAKE_INSTALL_LIBDIR=lib >/dev/null
cmake --build build-c >c.log 2>&1 || { cat c.log; fail "the C library"; }
cmake --install build-c --prefix "$work/first-c" >/dev/null
mv first-c moved-c
# Neither the heap, exceptions and locks, nor anything else of a C++ library.
cmake -DNM=nm -P "$source_dir/tests/cpp/freestanding/check_symbols.cmake" -- moved-c/lib/libelliptude.a || fail "symbols of the C library"
if nm -u moved-c/lib/libelliptude.a | grep -E ' _Z'; then
    fail "the C library needs a C++ library"
fi
passes "symbols of the C library"
# Where there is no Eigen.
cmake -S "$source_dir/tests/packaging/consumer_c" -B consumer-c -DCMAKE_PREFIX_PATH="$work/moved-c" "$no_system_eigen" >c.log 2>&1 ||
    { cat c.log; fail "consumer in C: configure"; }
cmake --build consumer-c >c.log 2>&1 || { cat c.log; fail "consumer in C: build"; }
[ "$(consumer-c/consumer)" = "$version" ] || fail "consumer in C: run"
passes "consumer in C, find_package"
export PKG_CONFIG_PATH="$work/moved-c/lib/pkgconfig"
# shellcheck disable=SC2046
cc -std=c99 "$source_dir/tests/packaging/consumer_c/main.c" $(pkg-config --cflags --libs elliptude-c) -o library ||
    fail "pkg-config, library: compile"
compiled library
unset PKG_CONFIG_PATH

# --- the sdist ---
"${PYTHON:-python3}" -m venv tools
tools/bin/pip install --quiet build
tools/bin/python -m build --sdist --outdir dist "$source_dir" >sdist.log 2>&1 || { cat sdist.log; fail "sdist"; }
sdist=dist/elliptude-$version.tar.gz
if tar -tzf "$sdist" | grep -E '/(build|dist|\.venv|__pycache__|\.[a-z]+_cache)/|\.(so|o|pyc)$'; then
    fail "the sdist holds generated files"
fi
passes "sdist"

# --- a wheel of it, with PyPI's Eigen ---
# Whether it is built, not how well: compiled without optimisation it takes half as long. Symbols tell the code for AVX from the rest.
CMAKE_ARGS="$no_system_eigen -DCMAKE_CXX_FLAGS_RELEASE=-O0" tools/bin/pip wheel --verbose --no-deps --wheel-dir wheels \
    --config-settings=install.strip=false "$sdist" >wheel.log 2>&1 || { cat wheel.log; fail "pip wheel of the sdist"; }
grep -q 'elliptude: Eigen .*cmeel.prefix' wheel.log || fail "pip wheel took another Eigen than PyPI's"
wheel=$(echo wheels/elliptude-"$version"-*.whl)
"${PYTHON:-python3}" -m venv empty
empty/bin/pip install --quiet "$wheel[cpp]" >install.log 2>&1 || { cat install.log; fail "pip install of the wheel"; }
[ "$(empty/bin/python -c 'import elliptude; print(elliptude.__version__)')" = "$version" ] || fail "import elliptude"
[ "$(empty/bin/python -m elliptude --version)" = "$version" ] || fail "python -m elliptude --version"
[ -f "$(empty/bin/python -m elliptude --includedir)/elliptude/version.hpp" ] || fail "python -m elliptude --includedir"
if empty/bin/elliptude scenarios 2>without_extra.log; then
    fail "elliptude scenarios without the extra"
fi
grep -qF "pip install 'elliptude[cli]'" without_extra.log || fail "elliptude without the extra does not say what it needs"
passes "wheel from the sdist, Eigen from PyPI"

# --- the same with the command line, where there is no compiler ---
PIP_CACHE_DIR=$(tools/bin/pip cache dir) "$source_dir/tests/packaging/wheel.sh" "$wheel" alone >alone.log 2>&1 ||
    { cat alone.log; fail "a first result"; }
passes "a first result without a compiler: $(tail -n 1 alone.log)"

# --- C++ from the wheel, with PyPI's Eigen, which lies beside it ---
cmakedir=$(empty/bin/python -m elliptude --cmakedir)
consume wheel -Delliptude_DIR="$cmakedir" "$no_system_eigen"
grep -q '^Eigen3_DIR:.*cmeel.prefix' consumer-wheel/CMakeCache.txt || fail "the consumer took another Eigen than PyPI's"

echo "$passed passed, 0 failed"
