"""The whole pipeline on quadratic cells: what cameras see are the pieces of curved faces."""

from __future__ import annotations

from pathlib import Path

import h5py
import meshio

import gpusim as gs
from gpusim.pipeline import run

SMALL = {
    "camera.side.resolution_px": [900, 360],
    "output.truth": ["reference", "displacement", "element"],
    "output.vtu": True,
    "output.stl": True,
}


def test_a_bar_of_quadratic_cells(checkout: Path, tmp_path: Path) -> None:
    change = {**SMALL, "body.bar.mesh.cells": "hex20", "body.bar.mesh.divisions": [24, 2, 2]}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", change)
    report = run(scene, tmp_path / "out")
    tip = report.measurements[0]
    inertia = 20.0 * 10.0**3 / 12.0
    theory = 50.0 * 234.0**2 * (3 * 240.0 - 234.0) / (6.0 * 70e3 * inertia)
    assert abs(tip.truth - theory) <= 0.02 * theory
    assert abs(tip.error) <= 1e-3 * tip.truth
    mesh = meshio.read(tmp_path / "out" / "solution" / "bar-0001.vtu")
    assert [block.type for block in mesh.cells] == ["hexahedron20"]
    with h5py.File(tmp_path / "out" / "truth.h5") as file:
        frame = file["camera/side/frame/0001"]
        element, reference = frame["element"][:], frame["reference"][:].astype(float)
    seen = element >= 0
    assert seen.sum() > 10_000
    # every pixel's point lies in the box around the cell that it names, to 1/300 of a pixel
    nodes = mesh.points[mesh.cells[0].data[element[seen]]]
    slack = 1e-6
    assert (reference[seen] >= nodes.min(axis=1) - slack).all()
    assert (reference[seen] <= nodes.max(axis=1) + slack).all()
