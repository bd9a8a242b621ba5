"""Masked arrays: masked pixels count as NaN; a masked value anywhere else is an error."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import gpusim as gs
import gpusim.fem
import gpusim.measure
import gpusim.mesh
import gpusim.optics
import gpusim.surface
from gpusim.errors import InputError
from tests.support.measure_images import Waves

MASKED = np.ma.array([[1.0, 2.0, 3.0]], mask=[[False, True, False]])
PICTURES = {"image", "images", "reference", "deformed", "left", "right", "lefts", "rights"}
MODULES = (gs, gs.measure, gs.fem, gs.mesh, gs.paint, gs.psf, gpusim.surface, gpusim.optics)
# what functions return, and tables that nobody else makes
RESULTS = {
    "Buckling", "Calibration", "Chessboard", "Codes", "Crossings", "DeflectionLine",
    "DicResult", "Displacement3D", "Dots", "EnergyHistory", "Features", "Frame", "FrameSource",
    "HarmonicResponse", "History", "LoadStep", "MappedResult", "Markers", "Matches", "Modes",
    "OperationalModes", "PointSeries",
    "Quality", "RandomResponse", "SampledKernel", "Sighting", "SlopeChanges", "Solution",
    "StereoResult", "StrainResult", "Stress", "TrackResult", "Triangulated", "Truth", "Update",
}  # fmt: skip


def public() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Every argument of the public API that takes an array."""
    seen = set()
    for module in MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if (
                not callable(thing)
                or id(thing) in seen
                or (name in RESULTS and module is not gs.paint)
            ):
                continue
            seen.add(id(thing))
            try:
                parameters = inspect.signature(thing).parameters.values()
            except ValueError:
                continue
            for parameter in parameters:
                if re.search(r"rray|Float\b", str(parameter.annotation)):
                    picture = parameter.name in PICTURES and module is gs.measure
                    if name != "Features" and not (picture and name != "difference_curve"):
                        yield name, thing, parameter.name


ARGUMENTS = {f"{name}-{key}": (thing, key) for name, thing, key in public()}


@pytest.mark.parametrize("which", list(ARGUMENTS))
def test_every_argument_that_takes_numbers_refuses_masked_ones(which: str) -> None:
    thing, key = ARGUMENTS[which]
    with pytest.raises(InputError, match=rf"\b{key}: masked; got an array with masked values"):
        thing(**{key: MASKED})


def test_there_are_many_of_them() -> None:
    assert len(ARGUMENTS) >= 60
    assert {"Model-forces", "Mesh-points", "dic-points", "Image-pixels"} <= set(ARGUMENTS)


def test_a_method_refuses_them_too() -> None:
    camera = gs.Camera(57, 33, K=[[50, 0, 28], [0, 50, 16], [0, 0, 1]])
    with pytest.raises(InputError, match=r"Camera\.project"):
        camera.project(MASKED)


def test_what_isnt_masked_passes() -> None:
    whole = np.ma.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mesh = gs.Mesh(whole, {"tet4": np.array([[0, 1, 2, 3]])})
    assert np.array_equal(mesh.points, whole.data)


def test_masked_pixels_are_left_out_as_nan_is() -> None:
    waves = Waves(3)
    y, x = np.indices((83, 121), dtype=np.float64)
    first, second = waves.at(x, y), waves.at(x - 0.4, y + 0.7)
    bad = (x > 40) & (x < 70) & (y < 30)
    first, second = (np.rint(image).astype(np.uint8) for image in (first, second))
    first[bad] = 255
    masked = gs.measure.dic(np.ma.array(first, mask=bad), second, subset=21, step=10)
    by_nan = gs.measure.dic(np.where(bad, np.nan, first), second, subset=21, step=10)
    plain = gs.measure.dic(first, second, subset=21, step=10)
    np.testing.assert_array_equal(masked.status, by_nan.status)
    np.testing.assert_array_equal(masked.displacement, by_nan.displacement)
    assert (masked.status != plain.status).any()
    assert np.abs(masked.displacement[masked.ok] - [0.4, -0.7]).max() <= 0.05
    there = gs.measure.dic(second, np.ma.array(first, mask=bad), subset=21, step=10)
    assert (there.status == gs.measure.Status.MASKED).any()
    with pytest.raises(InputError, match="NaN"):
        gs.measure.find_markers(np.ma.array(first, mask=bad), 20.0)
