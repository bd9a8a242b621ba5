"""Modes, steady vibrations and motions in time of a scene's bodies, as they are stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.motion import Course, Oscillation, Transient
from gpusim.scene import Scene
from gpusim.scene.description.model import AnalysisTable, OscillationTable, TransientTable
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.fem import Record

VIBRATION = "solution/vibration.npz"
Stored = Mapping[str, npt.NDArray[Any]]
_COURSE = ("times", "values", "rates", "accelerations")
_OSCILLATION = ("amplitudes", "frequencies", "rest")


def vibration_arrays(motion: Oscillation | Transient, body: int) -> dict[str, npt.NDArray[Any]]:
    """What ``np.savez`` keeps of a motion of a ``body`` (its number)."""
    if isinstance(motion, Oscillation):
        known = {name: getattr(motion, name) for name in _OSCILLATION}
    else:
        known = {name: getattr(motion.course, name) for name in _COURSE} | {"shapes": motion.shapes}
    return {f"{name}{body}": values for name, values in known.items() if values is not None}


def stored_vibration(
    stored: Stored, body: int, name: str, analysis: AnalysisTable
) -> Oscillation | Transient | None:
    """The motion of a body of that ``name``, as an ``analysis`` shows it; None if it has none.

    Raises InputError where there is no such mode, KeyError or ValueError for damage.
    """
    names = (*_COURSE, "shapes", *_OSCILLATION)
    known = {key: stored[f"{key}{body}"] for key in names if f"{key}{body}" in stored}
    for key, values in known.items():
        if not np.isfinite(values).all():
            raise ValueError(f"{key}: values that aren't finite")
    if "times" in known:
        shapes = known.pop("shapes", None)
        return Transient(Course(**known), shapes)
    if "amplitudes" not in known or not isinstance(analysis, OscillationTable):
        return None
    amplitudes, shown = known["amplitudes"], analysis.shown
    what, most = f"analysis.modes: body {name!r}", len(amplitudes)
    require(max(shown) <= most, what, max(shown), f"at most {most}, as many as were found")
    chosen = np.array(shown) - 1
    frequencies = known["frequencies"][chosen]
    # modes have a greatest displacement of 1, vibrations their own
    scale = getattr(analysis, "amplitude", 1.0)
    return Oscillation(shown, scale * amplitudes[chosen], frequencies, known["rest"])


def ground_of(scene: Scene) -> Record | None:
    """Accelerations (R, 3) m/s2 of the ground; None where it rests. Raises InputError."""
    from gpusim import fem  # who reads a motion from its file needs no solver

    table = scene.analysis.base_motion if isinstance(scene.analysis, TransientTable) else None
    if table is None:
        return None
    record = fem.read_record(scene.input(table.path).path)
    what, columns = f"analysis.base_motion: {table.path}", 1 + record.values.shape[1]
    require(columns == 2, what, f"{columns} columns", "time, and one acceleration along direction")
    along = np.array(table.direction) / np.linalg.norm(table.direction)
    return fem.Record(record.times, record.values * along)
