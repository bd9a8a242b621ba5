"""pyvale's compiled DIC on two pictures: ``python pyvale_dic.py FOLDER``; prints JSON.

FOLDER holds reference.npy and deformed.npy (uint8) and meta.json with subset, step and the known
affine field. Knows nothing of gpusim.
"""

import json
import sys
import tempfile
import time
import types
from pathlib import Path

import numpy as np

try:
    import pandas  # noqa: F401 - pyvale imports it, its DIC doesn't use it
except ImportError:
    sys.modules["pandas"] = types.ModuleType("pandas")
    sys.modules["pandas"].DataFrame = object

from pyvale import dic


def main(folder):
    meta = json.loads((folder / "meta.json").read_text())
    reference, deformed = (np.load(folder / f"{n}.npy") for n in ("reference", "deformed"))
    mask = np.ones(reference.shape, dtype=bool)
    seed = [reference.shape[1] // 2, reference.shape[0] // 2]
    if "box" in meta:  # pixels included; as pyvale's example of these pictures has it
        x0, y0, x1, y1 = meta["box"]
        mask[:] = False
        mask[y0 : y1 + 1, x0 : x1 + 1] = True
        seed = [x1 - reference.shape[1] // 10, (y0 + y1) // 2]
    best = None
    for _ in range(meta["repeats"]):
        with tempfile.TemporaryDirectory() as out:
            wall, cpu = time.perf_counter(), time.process_time()
            dic.calculate_2d(
                reference=reference,
                deformed=deformed[None],
                roi_mask=mask,
                seed=seed,
                subset_size=meta["subset"],
                subset_step=meta["step"],
                max_displacement=meta["search_px"],
                precision=meta["precision"],
                shape_function="QUAD" if meta.get("shape") == "quadratic" else "AFFINE",
                image_filter_kernel=1,
                output_basepath=out,
                print_level=0,
            )
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            text = next(Path(out).glob("*.csv")).read_text().splitlines()[1:]
        rows = [[float(field) for field in line.split(",")[:4]] for line in text if line]
        points = np.array(rows)[:, :2]
        moved = np.array(rows)[:, 2:4]
        if best is None or cpu < best["cpu"]:
            best = {"wall": wall, "cpu": cpu, "points": len(rows)}
            best |= errors(points, moved, meta)
    print(json.dumps(best))


def errors(points, moved, meta):
    """RMS over both components where both codes can measure: a margin from the border."""
    if "star" in meta:
        error = moved[np.isfinite(moved).all(axis=1), 1] - meta["peak"]
        return {"rms": float(np.sqrt((error**2).mean()))}
    centre, margin = np.array(meta["centre"]), meta["margin"]
    inner = ((points >= margin) & (points <= 2 * centre - margin)).all(axis=1)
    truth = (points - centre) @ np.array(meta["gradient"]).T + meta["shift"]
    error = (moved - truth)[inner]
    error = error[np.isfinite(error).all(axis=1)]
    return {"rms": float(np.sqrt((error**2).mean())), "inner": len(error)}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
