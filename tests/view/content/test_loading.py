"""Runs of bodies at large displacements, as a window loads them."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export.field_catalogue import BODY
from gpusim.motion import Stepped
from gpusim.view.content.background_solver import _solve
from gpusim.view.content.content import Content
from gpusim.view.content.field_values import field_names, field_values
from gpusim.view.content.loading import load_content, load_solution
from tests.pipeline.stages.test_equilibria import METAL, PULLED
from tests.pipeline.stages.test_mechanics import displacement, fields, scene


@pytest.fixture(scope="module")
def yielded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of a bar that is pulled until it yields, and back."""
    folder = tmp_path_factory.mktemp("yielded")
    made = scene(material=METAL, support=PULLED, load=[], stress=True, factors=[0.0, 1.0, 0.9])
    gs.run(made, folder, backend="numpy")
    return folder


def shown(content: Content, name: str, frame: int) -> float:
    return float(np.abs(field_values(content, name, frame).values[0]).max())


def test_a_window_shows_load_steps_as_they_were_solved(yielded: Path) -> None:
    content = load_content(yielded)
    assert content.objects is not None and isinstance(content.objects.motions[0], Stepped)
    assert yielded / "solution" / "steps.npz" in content.files
    for frame in range(3):
        np.testing.assert_array_equal(content.displacement(0, frame), displacement(yielded, frame))
    assert "plastic_strain" in field_names(content)
    for name in (one for one in field_names(content) if "truth" not in one):
        assert np.isfinite(field_values(content, name, 2).values[0]).all()
    for name, array, factor in (("von_mises", "von_mises", 1e-6),
                                ("plastic_strain", "plastic_strain", 1e3)):  # fmt: skip
        expected = factor * fields(yielded, 2).point_data[array].max()
        assert shown(content, name, 2) == pytest.approx(expected)
    # no stress of a linear body that moves as far: 1 mm of 240 is 833 MPa
    assert shown(content, "von_mises", 2) < 300.0
    content.stresses = None
    assert field_names(content) == [name for name in BODY if name.startswith("displacement")]
    again = load_content(yielded, earlier=content)
    np.testing.assert_array_equal(again.displacement(0, 2), content.displacement(0, 2))


def test_a_window_solves_them_itself(yielded: Path, tmp_path: Path) -> None:
    content = load_content(yielded / "scene.toml")
    assert content.unloaded
    _solve(content.scene, tmp_path, lambda share, text: None)
    load_solution(content, tmp_path / "solution")
    u = displacement(yielded, 2)
    np.testing.assert_allclose(content.displacement(0, 2), u, rtol=0, atol=1e-8 * np.abs(u).max())


def test_steps_of_another_scene_are_refused(yielded: Path, tmp_path: Path) -> None:
    copytree(yielded, tmp_path / "out")
    path = tmp_path / "out" / "solution" / "steps.npz"
    with np.load(path) as stored:
        arrays = dict(stored)
    np.savez(path, **{**arrays, "states0": arrays["states0"] * 2.0})
    with pytest.raises(InputError, match="damaged, or of another scene; got load steps"):
        load_content(tmp_path / "out")
