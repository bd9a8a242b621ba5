"""A data set of 500 pairs, opened by other people's readers: ``python -m benchmarks.dataset
[--write]``.

A bar is pulled by 10 loads before 50 cameras each. It stays on rollers, so that its displacement is
known in closed form; flow is compared with what textbook formulas of the cameras make of that.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import pyarrow.dataset

import gpusim as gs
from gpusim.studies import load_study, samples_of
from gpusim.studies.dataset import write_dataset
from gpusim.studies.rows import read_rows
from tests.support.flow_readers import read_flo
from tests.support.stretched_bar import PlainCamera, true_flow, true_forward_flow, write_study

RESULTS = Path(__file__).parent / "results" / "dataset.md"
LOADS = (-30.0, -20.0, -10.0, -5.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
STUDY = f"""
samples = 50
[[parameter]]
key = "body.bar.load.pull.traction_MPa.0"
list = {list(LOADS)}
name = "traction"
[[parameter]]
key = "camera.front.position_mm.0"
uniform = [-30.0, 90.0]
name = "x"
[[parameter]]
key = "camera.front.position_mm.2"
uniform = [-10.0, 60.0]
name = "z"
[dataset]
labels = ["forward_flow", "flow", "keypoints", "poses"]
"""
LABELS: dict[str, Callable[[PlainCamera, float], Any]] = {
    "forward_flow": true_forward_flow, "flow": true_flow,
}  # fmt: skip


def label_errors(dataset: Path) -> tuple[float, float, float, int]:
    """Of all items the largest error px and its RMS; the longest flow px; how many differ between
    OpenCV's reader and that of plain NumPy."""
    worst, squares, count, longest, other = 0.0, 0.0, 0, 0.0, 0
    for line in pyarrow.dataset.dataset(dataset / "manifest.parquet").to_table().to_pylist():
        camera = PlainCamera(position=(line["parameter.x"], -300.0, line["parameter.z"]))
        for label, truth in LABELS.items():
            path = dataset / line["split"] / f"{line['item']}.1.{label}.flo"
            found, wanted = read_flo(path.read_bytes()), truth(camera, line["parameter.traction"])
            known = np.isfinite(wanted) & np.isfinite(found)
            error = (found - wanted)[known]
            worst, squares = max(worst, float(np.abs(error).max())), squares + float(error @ error)
            count += error.size
            longest = max(longest, float(np.abs(found[known]).max()))
            other += not np.array_equal(cv2.readOpticalFlow(str(path))[known], found[known])
    return worst, (squares / count) ** 0.5, longest, other


def measured(folder: Path) -> list[tuple[str, str]]:
    """What is told, and how much it is."""
    out = folder / "OUT"
    path = write_study(folder, STUDY)
    start = time.process_time()
    gs.study(path, out)
    whole = time.process_time() - start
    dataset = out / "dataset"
    study = load_study(path)
    samples = samples_of(study)
    rows = read_rows(out, samples)
    (out / "dataset").rename(folder / "first")
    seconds = []
    for _ in range(2):  # written, and found written
        start = time.process_time()
        write_dataset(study, samples, rows, out)
        seconds.append(time.process_time() - start)
    files = [one for one in dataset.rglob("*") if one.is_file()]
    lines = pyarrow.dataset.dataset(dataset / "manifest.parquet").to_table().to_pylist()
    splits = Counter(line["split"] for line in lines)
    structures = {(line["structure"], line["split"]) for line in lines}
    worst, rms, longest, other = label_errors(dataset)
    solves = sum(row["made"].get("solve", 0) for row in rows.values())
    pictures = [cv2.imread(str(one), cv2.IMREAD_UNCHANGED) for one in files if one.suffix == ".png"]
    counts = ", ".join(f"{count} {name}" for name, count in splits.items())
    return [
        ("pairs", f"{len(lines)}: {counts}"),
        ("structures, solves", f"{len({one for one, _ in structures})}, {solves}"),
        ("structures in two splits", f"{len(structures) - len({one for one, _ in structures})}"),
        ("largest error of a label", f"{worst:.1e} px of up to {longest:.1f} px"),
        ("RMS error of labels", f"{rms:.1e} px"),
        ("files that OpenCV reads otherwise than NumPy", f"{other} of {2 * len(lines)}"),
        ("pictures that OpenCV reads", f"{sum(one is not None for one in pictures)}"),
        ("study and data set", f"{whole:.0f} s of processor time"),
        ("data set alone", f"{1e3 * seconds[0] / len(lines):.1f} ms a pair"),
        ("found written", f"{1e3 * seconds[1] / len(lines):.1f} ms a pair"),
        ("files, bytes", f"{len(files)}, {sum(one.stat().st_size for one in files) / 1e6:.0f} MB"),
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"into {RESULTS.name}")
    parser.add_argument("--keep", type=Path, help="a folder for the data set")
    options = parser.parse_args()
    with TemporaryDirectory() as scratch:
        rows = measured(options.keep or Path(scratch))
    text = (
        "# A data set of 500 pairs\n\nPictures of 96 x 48 px; `python -m benchmarks.dataset`.\n\n"
    )
    text += "| | |\n|---|---|\n" + "".join(f"| {name} | {value} |\n" for name, value in rows)
    print(text)
    if options.write:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
