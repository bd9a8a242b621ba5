"""What the peers of the render benchmark share: the problem folder, and how a run is reported.

``problem.npz``: ``corners`` (T, 3, 3) in camera axes (x right, y down, z forward, m), front sides
counter-clockwise seen from outside, ``albedo`` (T,), ``windows`` (n, 4) rows and columns; ``uv``
(T, 3, 2) and ``texture`` (rows, columns) uint8, row 0 at v = 0, for a plate with a texture;
``lamps`` (L, 3, 3) centre and two half sides, ``radiance`` (L,). ``problem.json``: width, height,
focal (px; the optical axis meets the middle of the image), lit.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np


class Problem:
    def __init__(self, folder):
        self.folder = Path(folder)
        arrays = np.load(self.folder / "problem.npz")
        for name in arrays.files:
            setattr(self, name, arrays[name])
        facts = json.loads((self.folder / "problem.json").read_text())
        self.width, self.height, self.focal = facts["width"], facts["height"], facts["focal"]
        self.lit = facts["lit"]
        self.textured = "texture" in arrays.files

    def groups(self):
        """(albedo, corners (n, 3, 3)) for each colour."""
        for value in np.unique(self.albedo):
            yield float(value), self.corners[self.albedo == value]


def main(run):
    """Call ``run(problem, options)``, a generator of (name, render); time ``render() -> (H, W)``.

    Each is rendered twice (once if slow) and the quicker one counts. The windows of the image are
    saved, and the times printed as JSON on the last line.
    """
    problem, options = Problem(sys.argv[1]), json.loads(sys.argv[2])
    variants = []
    for number, (name, render) in enumerate(run(problem, options)):
        seconds = []
        while len(seconds) < 2 and sum(seconds) < options.get("enough_s", 20.0):
            start = time.perf_counter()
            image = render()
            seconds.append(time.perf_counter() - start)
        image = np.asarray(image, np.float64)
        assert image.shape == (problem.height, problem.width), image.shape
        path = problem.folder / f"{Path(sys.argv[0]).stem}-{options.get('tag', '')}{number}.npz"
        np.savez(path, *[image[a:b, c:d] for a, b, c, d in problem.windows])
        variants.append({"name": name, "seconds": min(seconds), "windows": str(path)})
    print(json.dumps({"variants": variants, "peak_kib": 0}), flush=True)
