#!/usr/bin/env bash
# aarch64_python.sh FOLDER: makes FOLDER/python, which is Debian's Python for aarch64 in QEMU. The processor is a Cortex-A53, which has
# what every aarch64 has and no more. Environments made with it run so, too, and so do the programs in them.
# Needs qemu-user-static, mmdebstrap and the network (Debian).
set -euo pipefail
mkdir -p "$1"
folder=$(cd "$1" && pwd)
qemu=$(command -v qemu-aarch64-static)
release=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)

rm -rf "$folder/root"
mmdebstrap --quiet --architectures=arm64 --variant=extract --include=python3-venv,libstdc++6 "$release" "$folder/root"
cat >"$folder/python" <<EOF
#!/bin/sh
exec $qemu -cpu cortex-a53 -0 "\$0" -L "$folder/root" "$folder/root/usr/bin/python3" "\$@"
EOF
chmod +x "$folder/python"
