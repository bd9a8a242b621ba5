"""The first frame of a new process, with an empty cache of the driver and with a full one.

``python -m benchmarks.first_frame [--case crane-lit] [--size small]``
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile

from gpusim.bench.image_cases import IMAGE_CASES, SIZES

FRAME = """
import json, sys, time
import gpusim as gs
from gpusim.bench.image_cases import IMAGE_CASES
case = IMAGE_CASES[sys.argv[1]](sys.argv[2])
device = gs.Device()
seconds = []
for _ in range(2):
    wall, processor = time.perf_counter(), time.process_time()
    gs.render(case.surfaces, case.camera, list(case.lights) or None, device=device).release()
    device.sync()
    seconds.append((time.perf_counter() - wall, time.process_time() - processor))
print(json.dumps(seconds))
"""


def frames(case: str, size: str, cache: str) -> list[tuple[float, float]]:
    """Seconds and processor seconds of the first and the second frame of a process."""
    environment = {**os.environ, "MESA_SHADER_CACHE_DIR": cache}
    environment.pop("MESA_SHADER_CACHE_DISABLE", None)
    done = subprocess.run(
        [sys.executable, "-c", FRAME, case, size],
        env=environment, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return [(wall, processor) for wall, processor in json.loads(done.stdout.splitlines()[-1])]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", choices=sorted(IMAGE_CASES), default="crane-lit")
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--repeats", type=int, default=1, help="processes of each kind")
    arguments = parser.parse_args()
    print(f"{arguments.case}, {arguments.size}: s (processor s)")
    for _ in range(arguments.repeats):
        with tempfile.TemporaryDirectory() as cache:
            for state in ("empty", "full"):
                first, second = frames(arguments.case, arguments.size, cache)
                print(
                    f"cache {state:5}: first frame {first[0]:6.2f} ({first[1]:.2f}), "
                    f"second {second[0]:.2f} ({second[1]:.2f})"
                )


if __name__ == "__main__":
    main()
