#!/bin/sh
# Runs pytest against the gpusim that is installed in .venv, with the source folder out of the way:
# from a copy of the checkout without gpusim/ and shaders/. Arguments go to pytest. Two processes
# share the files between them, as a test seldom keeps two cores busy; -n 0 is one. BLAS has one
# thread in each: with two, NumPy's small products mostly wait for each other. Files keep their order
# (tests/conftest.py), so that no long one is begun last.
set -eu
checkout=$(cd "$(dirname "$0")/.." && pwd)
copy=$checkout/build/test
mkdir -p "$copy"
# what pytest has compiled stays: it belongs to files of one size and time
find "$copy" -type f ! -name '*.pyc' -delete
cd "$checkout"
for entry in *; do
    case $entry in
    gpusim | shaders | build | dist | out) ;;
    *) cp -Rp "$entry" "$copy" ;;
    esac
done
if [ -z "${GPUSIM_REFS:-}" ] && [ -d ../shared/refs ]; then
    GPUSIM_REFS=$(cd ../shared/refs && pwd)
    export GPUSIM_REFS
fi
export GPUSIM_EXPECT_INSTALLED=1 GPUSIM_CHECKOUT="$checkout" OPENBLAS_NUM_THREADS=1
cd "$copy"
exec "$checkout/.venv/bin/python" -P -m pytest -n 2 --dist loadfile --no-loadscope-reorder "$@"
