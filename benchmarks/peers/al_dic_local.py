"""al-dic's local mode on two pictures: ``python al_dic_local.py FOLDER``; prints JSON.

FOLDER as of ``pyvale_dic.py``. Knows nothing of gpusim.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
from al_dic.core.config import dicpara_default
from al_dic.core.data_structures import GridxyROIRange
from al_dic.core.pipeline import run_aldic
from pyvale_dic import errors


def main(folder):
    meta = json.loads((folder / "meta.json").read_text())
    images = [np.load(folder / f"{n}.npy").astype(np.float64) for n in ("reference", "deformed")]
    masks = [np.ones(image.shape) for image in images]
    height, width = images[0].shape
    half = meta["subset"] // 2
    para = dicpara_default(
        winsize=meta["subset"] - 1,
        winstepsize=meta["step"],
        use_masks=False,
        use_global_step=False,
        size_of_fft_search_region=meta["search_px"],
        gridxy_roi_range=GridxyROIRange(
            gridx=(half, width - 1 - half), gridy=(half, height - 1 - half)
        ),
    )
    best = None
    for _ in range(meta["repeats"] + 1):  # the first one compiles
        wall, cpu = time.perf_counter(), time.process_time()
        result = run_aldic(para, images, masks, compute_strain=False)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        points = result.dic_mesh.coordinates_fem
        moved = np.asarray(result.result_disp[0].U).reshape(-1, 2)
        if best is None or cpu < best["cpu"]:
            best = {"wall": wall, "cpu": cpu, "points": len(points)}
            best |= errors(points, moved, meta)
    print(json.dumps(best))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
