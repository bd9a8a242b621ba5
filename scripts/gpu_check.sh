#!/bin/sh
# Tells in a few minutes whether gpusim works on this machine's GPU, how exactly and how fast:
#
#   scripts/gpu_check.sh [WHEELS] [-o DIR] [--quick] [--adapter NAME] [--minutes N]
#
# Needs a Vulkan driver and loader and Python >= 3.11 with NumPy and SciPy; no network, no pip, no
# root. What else gpusim imports comes from WHEELS, a folder that scripts/gpu_wheels.sh has filled
# on a machine with a network (it may hold NumPy and SciPy too), unless it is installed.
# The report lies in DIR (gpu_check): a page named by the adapter, the same as JSON, three pictures.
# PYTHON=... picks the interpreter. Ends with 0 if all is well, 1 if something is wrong, 4 without
# an adapter.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
fail() { printf 'gpu_check: %s\n' "$*" >&2; exit 2; }

wheels=
case ${1:-} in
    '' | -*) ;;
    *) wheels=$1; shift; [ -d "$wheels" ] || fail "no such folder of wheels: $wheels" ;;
esac

python=
for name in ${PYTHON:-"$root/.venv/bin/python" python3 python3.13 python3.12 python3.11}; do
    if "$name" -c 'import sys; assert sys.version_info >= (3, 11)' 2>/dev/null; then
        python=$name
        break
    fi
done
[ -n "$python" ] || fail "no Python >= 3.11; set PYTHON=/path/to/python"

if [ -n "$wheels" ]; then
    site=$(mktemp -d "${TMPDIR:-/tmp}/gpusim-wheels-XXXXXX")
    trap 'rm -rf "$site"' EXIT INT TERM
    "$python" "$root/scripts/unpack_wheels.py" "$wheels" "$site"
    PYTHONPATH=$site${PYTHONPATH:+:$PYTHONPATH}
    export PYTHONPATH
fi
missing=$("$python" - <<'PYTHON'
from importlib.util import find_spec

names = "numpy scipy wgpu h5py pydantic cv2 jinja2 matplotlib meshio rich threadpoolctl tifffile typer"
print(" ".join(name for name in names.split() if find_spec(name) is None))
PYTHON
)
[ -z "$missing" ] || fail "$python lacks $missing; give a folder of wheels (scripts/gpu_wheels.sh)"
"$python" "$root/scripts/gpu_check.py" "$@"
