"""Points followed over the film, modes identified from their motion, and paired with true ones."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import linear_sum_assignment

from gpusim import measure
from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.files.frame_source import FrameSource
from gpusim.measure.vibration.operational_modes import OperationalModes
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.modes.result import ModesResult
from gpusim.pipeline.measurements.modes.true_modes import TrueModes, true_modes
from gpusim.pipeline.measurements.results import PointTable
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.cameras import build_shutter
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m

FAR = 0.5
"""Relative difference of frequency, plus 1 - MAC, of modes that can't be the same."""


def measure_modes(
    spec: m.ModesTable, scene: Scene, objects: SceneObjects, sources: Sources
) -> ModesResult:
    """All frames against the first one. Raises InputError for a place that isn't seen, and what
    `gpusim.measure.identify_modes` raises."""
    motion, rate = TrueMotion(objects), scene.analysis.frame_rate
    assert rate is not None  # of the scene's faults
    points = _points(spec, ReferencePicture(spec, motion))
    pictures = [partial(sources.image, spec.camera, k) for k in range(len(objects.frames))]
    names = [f"frame {k}" for k in range(len(pictures))]
    shutter = next(build_shutter(one) for one in scene.cameras if one.name == spec.camera)
    times, line_time = (
        np.arange(len(pictures)) / rate,
        0.0 if shutter is None else shutter.line_time,
    )
    film = FrameSource(pictures, names, times, line_time=line_time)
    series = measure.point_series(film, points, method=spec.method, subset=spec.subset_px)
    try:
        found = measure.identify_modes(
            series, modes=spec.modes, band_Hz=spec.band_Hz, method=spec.identification,
            excitation=spec.excitation,
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"measure {spec.name!r}: {error}") from None
    seen = motion.seen_at(spec.camera, found.points)
    true = true_modes(motion, spec.camera, seen)
    pair, likeness = _paired(found, true)
    columns = {
        "measured_frequency_Hz": found.frequency_Hz, "true_frequency_Hz": true.frequency_Hz,
        "sigma_frequency_Hz": found.frequency_sigma_Hz, "measured_damping": found.damping,
        "true_damping": true.damping, "sigma_damping": found.damping_sigma,
        "complexity": found.complexity,
    }  # fmt: skip
    columns |= {name: _of_pairs(columns[name], pair) for name in columns if "true" in name}
    columns |= {"true_mode": np.where(pair < 0, np.nan, pair + 1), "mac": likeness}
    numbers = tuple(f"mode {k}" for k in range(1, len(pair) + 1))
    true_shapes = _of_pairs(true.shapes, pair)
    size = np.einsum("npk,npk->n", true_shapes, true_shapes)
    fitted = np.einsum("npk,npk->n", true_shapes, found.shapes) / np.where(size > 0, size, np.nan)
    return ModesResult(
        spec.name, PointTable.of("mode", numbers, {len(pictures) - 1: columns}), spec.camera,
        found.points, found.shapes, fitted[:, None, None] * true_shapes, series.times,
        series.displacement[:, series.ok], int((~series.ok).sum()), spec.modes,
    )  # fmt: skip


def _points(spec: m.ModesTable, picture: ReferencePicture) -> Float:
    """(P, 2), whole px, of places on surfaces. Raises InputError."""
    line = picture.line(spec.count)
    return picture.placed({name: point[None] for name, point in line.items()}).pixels


def _paired(found: OperationalModes, true: TrueModes) -> tuple[Long, Float]:
    """Of each mode the true one that it is, -1 for none, and their MAC, (N,)."""
    alike = measure.mac(found.shapes, true.shapes) if len(true.shapes) else np.zeros(
        (len(found.shapes), 0)
    )  # fmt: skip
    apart = np.abs(found.frequency_Hz[:, None] / np.maximum(true.frequency_Hz, 1e-300) - 1.0)
    distance = apart + 1.0 - alike
    pair = np.full(len(found.shapes), -1)
    for one, other in zip(*linear_sum_assignment(np.minimum(distance, FAR)), strict=True):
        pair[one] = other if distance[one, other] < FAR else -1
    rows = np.arange(len(pair))
    return pair, np.where(pair < 0, np.nan, np.pad(alike, ((0, 0), (0, 1)))[rows, pair])


def _of_pairs(values: Float, pair: Long) -> Float:
    """Of each mode what its true one has; NaN without one."""
    unknown = np.full((1, *values.shape[1:]), np.nan)
    return np.concatenate([values, unknown])[pair]


def _checks(spec: m.ModesTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """There is something to follow; raises InputError if not."""
    if unloaded.strict:
        if spec.camera in unloaded.blind:
            raise InputError(f"measure {spec.name!r}: {unloaded.blind[spec.camera]}")
        objects = SceneObjects(scene, (), unloaded.bodies)
        _points(spec, ReferencePicture(spec, TrueMotion(objects, unloaded.surfaces)))
    return []


register(Kind(m.ModesTable, ModesResult, measure_modes, _checks))
