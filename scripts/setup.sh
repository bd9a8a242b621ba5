#!/bin/sh
# Makes .venv with gpusim in it, on a machine that may have next to nothing.
#
#   scripts/setup.sh        what a user needs: gpusim and what it imports
#   scripts/setup.sh dev    also Gmsh, pytest, ruff and mypy
#
# Missing system packages (Python's venv module, a Vulkan driver) are installed with apt-get, and
# only if they are missing. PYTHON=... picks the interpreter. A second run costs a second.
set -eu
cd "$(dirname "$0")/.."
flavour=${1:-run}
venv=.venv
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$*" >&2; exit 1; }

# apt_install PACKAGE...: as root, or through sudo; otherwise says what to install and stops.
apt_install() {
    if ! command -v apt-get >/dev/null; then
        fail "missing: $*; there is no apt-get here: install the like of it, then run this again"
    elif [ "$(id -u)" -eq 0 ]; then
        as_root="env"
    elif command -v sudo >/dev/null && { [ -t 0 ] || sudo -n true 2>/dev/null; }; then
        as_root="sudo env"
    else
        fail "missing: $*; as root: apt-get install $*; then run this again"
    fi
    say "apt-get install $*"
    $as_root apt-get update -qq </dev/null
    $as_root DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" </dev/null >/dev/null
}

# find_python MODULES: the first interpreter >= 3.11 that can import MODULES, or nothing.
find_python() {
    for name in ${PYTHON:-python3 /usr/bin/python3 python3.13 python3.12 python3.11}; do
        if "$name" -c "import sys; assert sys.version_info >= (3, 11); import $1" 2>/dev/null; then
            echo "$name"
            return
        fi
    done
}

make_venv() {
    python=$(find_python "venv, ensurepip")
    if [ -z "$python" ]; then
        python=$(find_python sys)
        if [ -z "$python" ]; then
            apt_install python3 python3-venv
        else
            apt_install "$("$python" -c \
                'import sys; print("python%d.%d-venv" % sys.version_info[:2])')"
        fi
        python=$(find_python "venv, ensurepip")
    fi
    [ -n "$python" ] || fail "no Python >= 3.11 with the venv module; set PYTHON=/path/to/python"
    say "$("$python" --version) ($python) -> $venv"
    "$python" -m venv --clear "$venv"
}

# adapters: prints "NAME (BACKEND)" for every adapter that can run gpusim; fails if there is none.
adapters() {
    "$venv/bin/python" - <<'PYTHON' 2>/dev/null
import sys

import wgpu

found = [adapter.info for adapter in wgpu.gpu.enumerate_adapters_sync()]
found = [info for info in found if info["backend_type"] in ("Vulkan", "Metal", "D3D12")]
for info in found:
    print(info["device"], f"({info['backend_type']})")
sys.exit(not found)
PYTHON
}

# A venv that was moved or whose interpreter is gone doesn't run: make it anew.
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || make_venv

# What is installed is remembered, so that a second run needs no network.
wanted="$flavour $(cat pyproject.toml constraints.txt | cksum)"
sources=$(find gpusim shaders examples pyproject.toml README.md LICENSE -type f ! -name '*.pyc' |
    LC_ALL=C sort | xargs cksum | cksum)
if ! grep -qxF "$wanted" "$venv/.installed" 2>/dev/null; then
    say "installing Python packages into $venv (once; about 300 MB)"
    # The build backend first: the package itself is then built without another download.
    "$venv/bin/python" -m pip install -q -c constraints.txt hatchling
    extra=
    [ "$flavour" = run ] || extra="[$flavour,cad]"
    # two packages with OpenCV in them share a folder: the one of earlier versions goes first
    "$venv/bin/python" -m pip uninstall -q -y opencv-python-headless gpusim 2>/dev/null
    "$venv/bin/python" -m pip install -q --no-compile -c constraints.txt --no-build-isolation ".$extra"
    # in two processes and without the packages' own tests: half of the time that pip would take
    "$venv/bin/python" -m compileall -q -j 2 -x '/tests/' "$venv/lib" >/dev/null || true
    # The larger set holds the smaller one, so that `make demo` after `make test` installs nothing.
    { echo "$wanted"; echo "run ${wanted#* }"; } >"$venv/.installed"
    echo "$sources" >"$venv/.sources"
fi
# gpusim itself goes in anew only if a file of its wheel has changed.
if ! grep -qxF "$sources" "$venv/.sources" 2>/dev/null ||
    ! ls "$venv"/lib/python*/site-packages/gpusim/__init__.py >/dev/null 2>&1; then
    rm -f "$venv/.sources"
    "$venv/bin/python" -m pip install -q --no-deps --no-build-isolation --force-reinstall .
    echo "$sources" >"$venv/.sources"
fi

if ! adapters >/dev/null; then
    say "no Vulkan adapter found: installing Mesa's drivers (lavapipe runs on the CPU)"
    apt_install libvulkan1 mesa-vulkan-drivers
    adapters >/dev/null || fail "still no adapter; '$venv/bin/gpusim doctor' says more"
fi
adapters | sed 's/^/setup: adapter: /'
