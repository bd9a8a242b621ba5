"""Scenes at coordinates of a survey: the same pictures, truth and measured values.

All examples at their own size take minutes and are marked ``hostile``; one of them is always run.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from tests.hostile.amount import share
from tests.hostile.moved_scenes import move_meshes, moved_scene

Array = npt.NDArray[np.float64]

UTM = np.array([5e5, 5.2e6, 300.0])
SMALL: dict[str, Any] = {
    "camera.side.resolution_px": [750, 300],
    "body.bar.mesh.divisions": [24, 4, 2],
    "output.truth": ["reference", "displacement", "depth", "flow", "normal"],
}
TOLERANCE = {
    "reference": 2e-8, "displacement": 5e-9, "depth": 2e-7, "flow": 2e-4, "normal": 2e-5,
    "points": 2e-9, "K": 0.0, "distortion": 0.0,
}  # fmt: skip
"""m, px, or of a unit vector: what float64 leaves of such coordinates, float32 of layers."""

FIXED = {"damaged_beam": (0.0, 1.0, 1.0)}
"""Axes along which an example is moved, where its file can't say all: notches of a beam."""

HIDDEN = 1e-4
"""Share of the pixels, beside edges, that may see another face."""


def test_a_small_scene_far_from_zero(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare(checkout / "examples" / "cantilever.toml", SMALL, tmp_path, monkeypatch)


@pytest.mark.hostile
@pytest.mark.parametrize(
    "name",
    ["strip", "lug", "bimetal", "cantilever", "crane", "damaged_beam", "crane_stereo"][: share(7)],
)
def test_every_example_far_from_zero(
    name: str, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offset = UTM * FIXED.get(name, (1.0, 1.0, 1.0))
    compare(checkout / "examples" / f"{name}.toml", {}, tmp_path, monkeypatch, offset)


def compare(
    path: Path,
    overrides: dict[str, Any],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    to: Array = UTM,
) -> None:
    """Run a scene where it is and elsewhere, and compare all that comes of it."""
    outs, reports = [], []
    for number, offset in enumerate((np.zeros(3), to)):
        with monkeypatch.context() as patched:
            move_meshes(patched, offset)
            out = folder / str(number)
            reports.append(gs.run(moved_scene(path, offset, overrides), out))
        outs.append(out)
    pictures = sorted(p.relative_to(outs[0]) for p in outs[0].rglob("images/**/*.png"))
    assert pictures
    for picture in pictures:
        here, there = (cv2.imread(str(out / picture), cv2.IMREAD_UNCHANGED) for out in outs)
        off = np.abs(here.astype(int) - there.astype(int))
        # 1e-5 of white turns a grey level where it was about to turn, and one of the 512 samples
        # of a lamp where an edge was about to hide it: at most so much of the brightest paint
        assert off.max() <= max(1, here.max() / 512), (picture, off.max())
        assert np.count_nonzero(off) <= 2e-4 * off.size, picture
    for truth in outs[0].rglob("truth.h5"):
        _compare_truth(truth, outs[1] / truth.relative_to(outs[0]), to)
    here, there = (json.loads((out / "report.json").read_text()) for out in outs)
    assert [one["name"] for one in here["measurements"]] == [
        one["name"] for one in there["measurements"]
    ]
    for one, other in zip(here["measurements"], there["measurements"], strict=True):
        for key in ("measured", "truth"):
            assert other[key] == pytest.approx(one[key], rel=1e-5, abs=2e-6), (one["name"], key)


def _compare_truth(here: Path, there: Path, offset: Array) -> None:
    with h5py.File(here) as one, h5py.File(there) as other:
        names: list[str] = []
        one.visititems(lambda name, item: names.append(name) if hasattr(item, "dtype") else None)
        for name in names:
            layer = "displacement" if "mesh/displacement" in name else name.rsplit("/", 1)[-1]
            if layer == "camera_from_world":
                continue
            want, got = one[name][...], other[name][...]
            if layer in ("reference", "points"):
                got = got - offset
            if want.dtype.kind == "i":
                assert np.count_nonzero(want != got) <= HIDDEN * want.size, name
                continue
            seen = np.isfinite(want) & np.isfinite(got)
            assert np.count_nonzero(np.isfinite(want) ^ np.isfinite(got)) <= HIDDEN * want.size
            off = np.abs(np.where(seen, got - want, 0.0))
            assert np.count_nonzero(off > TOLERANCE[layer]) <= HIDDEN * want.size, (name, off.max())
