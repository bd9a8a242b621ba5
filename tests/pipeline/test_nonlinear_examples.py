"""The examples at large displacements: what their bodies do, and that it is measured."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from tests.support.elastica import Strip, pulled_ring

SMALL = {"camera": [], "measure": [], "output.vtu": True, "output.fields": False}
"""Without pictures."""


def fields(out: Path, frame: int, body: str) -> meshio.Mesh:
    return meshio.read(out / "solution" / f"{body}-{frame:04d}.vtu")


def test_the_ring_is_pulled_as_the_elastica_says(checkout: Path, tmp_path: Path) -> None:
    last = {"analysis.load_factors": [0.0, 1.0]}
    gs.run(
        gs.load_scene(checkout / "examples" / "ring.toml", SMALL | last), tmp_path, backend="numpy"
    )
    grid = fields(tmp_path, 1, "ring")
    middle = 1e3 * np.hypot(grid.points[:, 0], grid.points[:, 2])
    x, z = 1e3 * grid.points[:, [0, 2]].T
    radial = np.isclose(middle, 50.0, atol=1e-3)
    u = 1e3 * grid.point_data["u"]
    hook = u[radial & np.isclose(x, 0.0, atol=1e-6) & (z < 0.0), 2].mean()
    pin = u[radial & np.isclose(x, 0.0, atol=1e-6) & (z > 0.0), 2].mean()
    sides = u[radial & np.isclose(z, 0.0, atol=1e-6) & (x > 0.0), 0].mean()
    out, inwards = pulled_ring(Strip(100.0 * np.pi, 2.0, 1.0, 2.5e3, curvature=-0.02), 2.0)
    assert pin - hook == pytest.approx(2.0 * out, rel=2e-3)
    assert sides == pytest.approx(inwards, rel=2.5e-3)


def test_the_coil_is_the_arc_that_timoshenko_says(checkout: Path, tmp_path: Path) -> None:
    last = {"analysis.load_factors": [0.0, 1.0]}
    gs.run(
        gs.load_scene(checkout / "examples" / "coil.toml", SMALL | last), tmp_path, backend="numpy"
    )
    grid = fields(tmp_path, 1, "strip")
    p = 1e3 * grid.points
    line = np.flatnonzero(np.isclose(p[:, 1], 1.0) & np.isclose(p[:, 2], 0.2, atol=1e-6))
    line = line[np.argsort(p[line, 0])]
    x, _, z = (p + 1e3 * grid.point_data["u"])[line].T
    angle = np.unwrap(np.arctan2(np.diff(z), np.diff(x)))
    inner = slice(len(angle) // 5, -len(angle) // 5)  # free ends bend a little more
    turn = np.polyfit(0.5 * (p[line, 0][1:] + p[line, 0][:-1])[inner], angle[inner], 1)[0]
    hot = 0.4 * (1.0 + 0.5 * (26e-6 + 5e-6) * 400.0)
    assert turn == pytest.approx(1.5 * 21e-6 * 400.0 / hot, rel=2e-3)


def test_the_plate_yields(checkout: Path, tmp_path: Path) -> None:
    """Over the notched section's area the mean stress reaches what slip lines allow: the yield
    stress times at most 1.15 in a thin plate, and what has hardened."""
    steps = {
        "analysis.load_factors": [0.0, 0.125, 0.3, 0.5],
        "body.plate.mesh.divisions": [32, 10, 1],
    }
    scene = gs.load_scene(checkout / "examples" / "tensile.toml", SMALL | steps)
    report = gs.run(scene, tmp_path, backend="numpy")
    assert report.mechanics is not None and report.warnings == ()
    held = {one.name: one.force[0] for one in report.mechanics.reactions}
    assert held["crosshead"] == pytest.approx(-held["grip"], rel=1e-6)
    assert 250.0 < held["crosshead"] / (18.0 * 3.0) < 1.15 * 335.0
    plastic = fields(tmp_path, 3, "plate").point_data["plastic_strain"]
    assert plastic.max() > 0.02 and plastic.min() >= 0.0


def test_markers_round_a_ring_are_followed(device: Device, checkout: Path, tmp_path: Path) -> None:
    """The straight line between two of them isn't on its surface."""
    few = {"analysis.load_factors": [0.0, 0.1], "output.fields": False}
    report = gs.run(gs.load_scene(checkout / "examples" / "ring.toml", few), tmp_path)
    hook = report.measurements[0]
    assert abs(hook.error) <= 2e-4 * hook.truth and report.warnings == ()
    table = np.genfromtxt(tmp_path / "measure" / "stretch.csv", delimiter=",", names=True)
    assert np.abs(table["measured_x_mm"] - table["true_x_mm"]).max() <= 2e-3
    side = report.series[0]
    middle = np.interp(np.sqrt(2.0) * 50.0, side.x, side.y_truth)
    assert middle == pytest.approx(table["true_x_mm"].min(), rel=1e-3)


@pytest.mark.slow
def test_they_are_measured(device: Device, checkout: Path, tmp_path: Path) -> None:
    for name in ("ring", "coil"):
        report = gs.run(gs.load_scene(checkout / "examples" / f"{name}.toml"), tmp_path / name)
        tip = report.measurements[0]
        assert abs(tip.error) <= 2e-4 * tip.truth and report.warnings == ()
