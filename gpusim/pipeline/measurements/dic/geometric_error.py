"""Errors that are known without any matching: of calibration, scale, lens, and motion out of the
plane.

A *reading* is what a measurement would make of points if matching found them where they really are
in the pictures. A part of the error is the difference of two readings; what alone makes a reading
differ from the truth is a cause.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.field_columns import strain_components
from gpusim.pipeline.measurements.dic.rig import Rig
from gpusim.pipeline.measurements.results import MM

CALIBRATION = "calibration"
ROUNDING = 1e-9
"""mm, over all points."""
Reading = tuple[Float, Float]
"""Places (M, K) mm, and displacements (M, K) mm."""
Strain = Callable[[Float, Float], Float]
"""Strains (M, 2, 2) of places and displacements."""


@dataclass(frozen=True)
class GeometricErrors:
    """Errors (M, Q) of displacements and strains that no match has made: ``parts``, which add up,
    and what each of the ``causes`` of the part "calibration" does alone."""

    parts: Mapping[str, Float] = field(default_factory=dict)
    causes: Mapping[str, Float] = field(default_factory=dict)


def errors_of_one(
    camera: Camera, position: Float, moved: Float, mapping: Callable[[Float], Float], axes: Float,
    on_plane: bool, strain: Strain | None,
) -> GeometricErrors:  # fmt: skip
    """What makes the reading of one ``camera`` wrong, of points at a ``position`` that ``moved``,
    (M, 3) m.

    ``mapping``: of its pixels to mm along ``axes`` (2, 3); ``on_plane``: it undoes the lens.
    """

    def read(lens: Camera, motion: Float) -> Float:
        before, after = (mapping(lens.project(position + s)) for s in (0.0 * motion, motion))
        return _values((before, after - before), strain)

    ideal = camera if on_plane else camera.without_distortion()
    readings = {
        "truth": _values((MM * position @ axes.T, MM * moved @ axes.T), strain),
        CALIBRATION if on_plane else "scale and perspective": read(ideal, moved @ axes.T @ axes),
        "out-of-plane motion": read(ideal, moved),
    }
    if not on_plane:
        readings["distortion"] = read(camera, moved)
    steps = pairwise(readings.items())
    return GeometricErrors({name: reading - before for (_, before), (name, reading) in steps})


def errors_of_pair(
    true: Rig, calibrated: Rig, seen: Sequence[Float], place: Float, strain: Strain | None
) -> GeometricErrors:
    """What makes the reading of a pair wrong, of points ``seen`` (2, M, 2) px before and after they
    moved, laid on their true ``place`` (M, 3) mm: the ``calibrated`` rig in place of the ``true``
    one. Its causes are the groups of parameters, each wrong alone."""

    def read(rig: Rig) -> Float:
        before, after = (measure.triangulate(rig, pixels).points for pixels in seen)
        laid = measure.align(before, place)
        return _values((laid.apply(before), (after - before) @ laid.rotation.T), strain)

    truth, causes = read(true), dict[str, Float]()
    for number in (0, 1):
        for name, changed in _wrong(true[number], calibrated[number]).items():
            error = read((changed, true[1]) if number == 0 else (true[0], changed)) - truth
            if np.nansum(np.abs(error)) > ROUNDING:
                causes[name] = error
    return GeometricErrors({CALIBRATION: read(calibrated) - truth}, causes)


def _values(reading: Reading, strain: Strain | None) -> Float:
    """Displacements and, if any are measured, strains, (M, Q)."""
    places, moved = reading
    if strain is None:
        return moved
    return np.column_stack([moved, strain_components(strain(places, moved))])


def _wrong(
    true: measure.CalibratedCamera, found: measure.CalibratedCamera
) -> dict[str, measure.CalibratedCamera]:
    """The true camera with each group of parameters as it was found, by what is wrong with it."""
    of = f"of camera {true.name}"
    result = {f"distortion {of}": replace(true, distortion=found.distortion)}
    for name, columns in (("focal length", [0, 1]), ("principal point", [2, 2])):
        K = true.K.copy()
        K[[0, 1], columns] = found.K[[0, 1], columns]
        x, y = (K - true.K)[[0, 1], columns]
        result[f"{name} {of}, off by ({x:+.3g}, {y:+.3g}) px"] = replace(true, K=K)
    for name, columns in (("orientation", [0, 1, 2]), ("position", [3])):
        pose = true.camera_from_rig.copy()
        pose[:3, columns] = found.camera_from_rig[:3, columns]
        off = np.linalg.norm(pose - true.camera_from_rig)
        # a turn by a small angle changes its matrix by sqrt(2) times that
        size = f"{np.degrees(off / np.sqrt(2.0)):.2g} deg" if name[0] == "o" else f"{off:.2g} mm"
        result[f"{name} {of}, off by {size}"] = replace(true, camera_from_rig=pose)
    return result
