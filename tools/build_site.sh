#!/usr/bin/env bash
# build_site.sh PYTHON FOLDER   builds the documentation's site in a folder, runs its notebooks, and writes
# elliptude.1 beside the pages, for man. Needs no network; a warning fails.
set -euo pipefail
python=$(realpath --no-symlinks "$1") site=$(realpath --canonicalize-missing "$2")
cd "$(dirname "$0")/.."
work=$site.work
rm -rf "$site"
# The kernels of notebooks read no settings of this user, and do not warn that they speak over TCP.
export IPYTHONDIR=$work/ipython
mkdir -p "$IPYTHONDIR/profile_default"
echo 'c.IPKernelApp.log_level = "ERROR"' >"$IPYTHONDIR/profile_default/ipython_kernel_config.py"
"$python" -m sphinx --builder html --fail-on-warning --keep-going --jobs auto --quiet --fresh-env \
    --doctree-dir "$work/doctrees" --conf-dir docs/site . "$site"
# The manual page of the command line, from what has been read already; in it, links between pages lead nowhere.
"$python" -m sphinx --builder man --fail-on-warning --quiet --doctree-dir "$work/doctrees" --conf-dir docs/site . "$work/man"
sed -E 's/ \\%<(#[^>]*)?>//g' "$work/man/elliptude.1" >"$site/elliptude.1"
