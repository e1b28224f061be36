#!/usr/bin/env bash
# install_system_packages.sh PURPOSE...   with PURPOSE one of: test bench peers lint clang browser shells packaging aarch64 flight
# Installs the Debian packages which those purposes need and this machine lacks; where it may not, says which they are.
set -euo pipefail
python=${PYTHON:-python3}

missing=()
need_command() { "$1" --version >/dev/null 2>&1 || missing+=("$2"); }
need_package() { dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null | grep -qx installed || missing+=("$1"); }
need_python() { "$python" -c "$1" >/dev/null 2>&1 || missing+=("$2"); }

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "elliptude needs Python 3.11 or newer; '$python' is not. Name another one with: make PYTHON=..." >&2
    exit 1
fi

for purpose in "$@"; do
    case $purpose in
        test)
            need_command c++ g++
            need_command cmake cmake
            need_command ninja ninja-build
            need_command ccache ccache
            need_package libeigen3-dev
            need_package doctest-dev
            need_python 'import ensurepip, venv' python3-venv
            need_python 'import pathlib, sysconfig; (pathlib.Path(sysconfig.get_path("include")) / "Python.h").stat()' \
                python3-dev
            ;;
        bench)
            need_package libbenchmark-dev
            need_command valgrind valgrind
            ;;
        peers) need_package libboost-dev ;; # odeint
        lint) need_command clang-tidy clang-tidy ;;
        clang)
            need_command clang++ clang
            need_command llvm-cov llvm # of `make coverage`
            need_package libclang-rt-dev
            ;;
        browser) need_command chromium chromium ;;
        shells)
            need_command zsh zsh
            need_command fish fish
            ;;
        packaging) need_command pkg-config pkgconf ;;
        aarch64)
            need_command aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
            need_command qemu-aarch64-static qemu-user-static
            need_command mmdebstrap mmdebstrap
            ;;
        flight)
            need_command arm-none-eabi-g++ gcc-arm-none-eabi
            need_package libnewlib-arm-none-eabi
            need_package libstdc++-arm-none-eabi-newlib
            need_command qemu-system-arm qemu-system-arm
            ;;
        *)
            echo "unknown purpose: $purpose" >&2
            exit 2
            ;;
    esac
done

if [ ${#missing[@]} -eq 0 ]; then
    exit 0
fi
if ! command -v apt-get >/dev/null; then
    # Not Debian: whether the like of these packages is there cannot be told from here; CMake will say.
    echo "This machine has no apt-get. What elliptude needs goes by these names on Debian: ${missing[*]}" >&2
    exit 0
fi
if [ "$(id -u)" -eq 0 ]; then
    as_root=(env)
elif sudo -n true 2>/dev/null; then
    as_root=(sudo -n env)
else
    echo "These Debian packages are missing: ${missing[*]}" >&2
    echo "Install them with: sudo apt-get install ${missing[*]}" >&2
    exit 1
fi
echo "Installing Debian packages: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
