"""What is read off places that are exactly right: errors of calibration, scale, lens, and motion
out of the plane.

A *reading* is what a measurement would make of points if matching found them where they really are
in the pictures. Readings that have one fault after the other differ by what this fault does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.field_columns import strain_components
from gpusim.pipeline.measurements.dic.rig import Rig
from gpusim.pipeline.measurements.results import MM

CALIBRATION, CAUSE = "calibration", "calibration: "
"""Name of an error, and how names of those begin that are its causes."""
ROUNDING = 1e-9
"""mm, over all points."""
Reading = tuple[Float, Float]
"""Places (M, K) mm, and displacements (M, K) mm."""


def readings_of_one(
    camera: Camera, position: Float, moved: Float, mapping: Callable[[Float], Float], axes: Float,
    on_plane: bool,
) -> dict[str, Reading]:  # fmt: skip
    """What one ``camera`` reads of points at a ``position`` that ``moved``, (M, 3) m: the truth,
    then with one fault more each.

    ``mapping``: of its pixels to mm along ``axes`` (2, 3); ``on_plane``: it undoes the lens.
    """
    within = moved @ axes.T @ axes
    ideal = camera if on_plane else camera.without_distortion()

    def read(lens: Camera, shift: Float) -> Reading:
        before, after = (mapping(lens.project(position + s)) for s in (0.0 * shift, shift))
        return before, after - before

    found = {
        "truth": (MM * position @ axes.T, MM * moved @ axes.T),
        CALIBRATION if on_plane else "scale and perspective": read(ideal, within),
        "out-of-plane motion": read(ideal, moved),
    }
    return found if on_plane else found | {"distortion": read(camera, moved)}


def readings_of_pair(
    true: Rig, calibrated: Rig, seen: Sequence[Float], place: Float
) -> dict[str, Reading]:
    """What a pair reads of points ``seen`` (2, M, 2) px before and after they moved, laid on their
    true ``place`` (M, 3) mm: by the ``true`` rig, by the ``calibrated`` one, and by the true one
    with one wrong group of parameters."""

    def read(rig: Rig) -> Reading:
        before, after = (measure.triangulate(rig, pixels).points for pixels in seen)
        laid = measure.align(before, place)
        return laid.apply(before), (after - before) @ laid.rotation.T

    found = {"truth": read(true), CALIBRATION: read(calibrated)}
    for number in (0, 1):
        for name, changed in _wrong(true[number], calibrated[number]).items():
            rig = (changed, true[1]) if number == 0 else (true[0], changed)
            found[f"{CAUSE}{name}"] = read(rig)
    return found


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


def known_errors(
    readings: Mapping[str, Reading], strain: Callable[[Float, Float], Float] | None
) -> dict[str, Float]:
    """What each fault adds to displacements and strains, (M, Q), by its name; `CAUSE`: what such
    a part alone adds to the truth, if anything. ``strain`` (M, 2, 2): of places and displacements,
    if any is measured."""
    values = {
        name: moved
        if strain is None
        else np.column_stack([moved, strain_components(strain(places, moved))])
        for name, (places, moved) in readings.items()
    }
    errors = dict[str, Float]()
    for name, now in values.items():
        if name == "truth":
            truth = before = now
        elif name.startswith(CAUSE):
            if np.nansum(np.abs(now - truth)) > ROUNDING:
                errors[name] = now - truth
        else:
            errors[name], before = now - before, now
    return errors
