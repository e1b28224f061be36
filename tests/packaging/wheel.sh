#!/usr/bin/env bash
# wheel.sh WHEEL FOLDER: installs a wheel with the command line into a new virtual environment, FOLDER, where no program but Python's own
# is found, thus no compiler, and where nothing else may be compiled; then gets a first result. Says how long that took.
# ELLIPTUDE_WHEEL_SECONDS: fails if it takes longer. PYTHON: the one that the wheel is for. PIP_CACHE_DIR: what pip has downloaded
# before; nothing if it is not set. Needs the network (PyPI).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
wheel=$(realpath "$1")
mkdir "$2"
folder=$(cd "$2" && pwd)

# A wheel is for the oldest processor of its kind. What x86-64 does not promise is AVX, whose instructions begin with v, and what SSE3
# to SSE4.2 brought, of which these are the ones that compilers like to use. Functions for AVX2 and AVX-512, which run where the
# processor has that, bear its name; a wheel without symbols does not say which they are, and is not looked at.
newer='\b(v[a-z0-9]+ .*%[xyz]mm|haddp[sd]|pshufb|round[sp][sd]|blendvp[sd]|ptest|popcnt|crc32)'
unzipped=$folder/unzipped
"${PYTHON:-python3}" -m zipfile -e "$wheel" "$unzipped"
for module in "$unzipped"/elliptude/_*.so; do
    [[ ${module##*/} == *x86_64* ]] || continue
    objdump -d --no-show-raw-insn "$module" >"$folder/instructions"
    grep -q '%xmm0' "$folder/instructions"
    if [[ $module == */_core.* ]] && ! grep -q '^[0-9a-f]* <.*move_avx2' "$folder/instructions"; then
        echo "${module##*/} has no symbols: its instructions are not looked at"
        continue
    fi
    awk '/^[0-9a-f]+ </ { is_kernel = /avx2|avx512/ } !is_kernel' "$folder/instructions" >"$folder/for_all"
    if grep -E "$newer" "$folder/for_all" >"$folder/newer"; then
        echo "$module has instructions that an x86-64 may lack, among them:" >&2
        head -n 3 "$folder/newer" >&2
        exit 1
    fi
done

began=$EPOCHREALTIME
"${PYTHON:-python3}" -m venv "$folder"
alone=(env -i "PATH=$folder/bin" "HOME=$folder" "LC_ALL=C.UTF-8" ${PIP_CACHE_DIR:+"PIP_CACHE_DIR=$PIP_CACHE_DIR"})
for compiler in cc c++ gcc g++ clang cmake; do
    if "${alone[@]}" "$folder/bin/python" -c "import shutil, sys; sys.exit(shutil.which('$compiler') is None)"; then
        echo "there is a $compiler" >&2
        exit 1
    fi
done
"${alone[@]}" "$folder/bin/python" -m pip install --quiet --disable-pip-version-check --only-binary :all: "${wheel}[cli]"
installed=$EPOCHREALTIME
"${alone[@]}" "$folder/bin/python" "$here/first_result.py"
ended=$EPOCHREALTIME

seconds=$(awk "BEGIN { printf \"%.1f\", $ended - $began }")
awk "BEGIN { printf \"installed in %.1f s, first result in %.1f s\\n\", $installed - $began, $ended - $installed }"
limit=${ELLIPTUDE_WHEEL_SECONDS:-}
if [ -n "$limit" ] && awk "BEGIN { exit !($seconds > $limit) }"; then
    echo "$seconds s is more than $limit s" >&2
    exit 1
fi
