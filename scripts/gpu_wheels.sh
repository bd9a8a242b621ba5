#!/bin/sh
# Fills a folder with the wheels that scripts/gpu_check.sh needs on a machine without a network:
#
#   scripts/gpu_wheels.sh FOLDER [VERSION...]
#
# VERSION: of Python there, such as 3.12 (several are fine); without it that of this machine.
# ARCH=aarch64 for another processor; the wheels are those for Linux.
set -eu
cd "$(dirname "$0")/.."
folder=${1:?usage: scripts/gpu_wheels.sh FOLDER [VERSION...]}
shift
python=${PYTHON:-python3}
arch=${ARCH:-$(uname -m)}
export PIP_DISABLE_PIP_VERSION_CHECK=1

[ $# -gt 0 ] || set -- "$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')"
mkdir -p "$folder"
wanted=$(mktemp)
trap 'rm -f "$wanted"' EXIT
"$python" - >"$wanted" <<'PYTHON'
import tomllib

with open("pyproject.toml", "rb") as file:
    print("\n".join(tomllib.load(file)["project"]["dependencies"]))
PYTHON
platforms=
for glibc in 5 12 17 24 27 28 31 34; do
    platforms="$platforms --platform manylinux_2_${glibc}_$arch"
done
platforms="$platforms --platform manylinux2014_$arch --platform manylinux1_$arch"
for version in "$@"; do
    # shellcheck disable=SC2086
    "$python" -m pip download -q --only-binary=:all: --python-version "$version" \
        --implementation cp $platforms -c constraints.txt -d "$folder" -r "$wanted"
    echo "Python $version: $(ls "$folder" | wc -l) wheels in $folder"
done
