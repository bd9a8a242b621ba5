"""Measurements: correlation, markers and calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import gpusim as gs
from benchmarks.faces import camera_of
from benchmarks.identical_cases.arrays import Arrays, Case, fields, radiance_of
from benchmarks.identical_cases.images import BROWN, PAINTS, tilted
from gpusim import measure
from gpusim.measure.correlation.subset_filter import filtered_by_subsets


def waves(shift: tuple[float, float], strain: float = 0.0) -> npt.NDArray[np.uint8]:
    """A random picture (180, 200) of plane waves, moved and stretched in closed form."""
    rng = np.random.default_rng(9)
    vectors, phases = rng.normal(0.0, 0.6, (60, 2)), rng.uniform(0.0, 2.0 * np.pi, 60)
    y, x = np.indices((180, 200), dtype=np.float64)
    x, y = (1.0 - strain) * x - shift[0], y - 0.6 * strain * x - shift[1]
    total = sum(np.sin(u * x + v * y + p) for (u, v), p in zip(vectors, phases, strict=True))
    return np.clip(np.rint(128.0 + 9.0 * total), 0, 255).astype(np.uint8)


def picture(name: str) -> npt.NDArray[np.uint8]:
    """A paint as albedo in 8 bit."""
    surface, camera = tilted(PAINTS[name]())
    values = radiance_of(gs.render([surface], camera, background=0.3))["radiance"]
    return np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)


def correlated(backend: str) -> Arrays:
    """Image correlation of a pair, and strains."""
    first, second = waves((0.0, 0.0)), waves((0.37, -0.21), 0.004)
    result = measure.dic(first, second, subset=21, step=12, backend=backend)
    found = fields(result, "points", "displacement", "gradient", "zncc", "sigma", "status")
    return {**found, **fields(measure.strain(result), "tensor", "residual")}


def gauges() -> Arrays:
    """What an extensometer and a strain gauge make of displacements."""
    first, second = waves((0.0, 0.0)), waves((0.37, -0.21), 0.004)
    result = measure.dic(first, second, subset=21, step=12, backend="numpy")
    ends = result.points[[0, -1]], result.displacement[[0, -1]]
    strain = measure.gauge(result.points, result.points, result.displacement, "hencky")
    return {"extensometer": np.array(measure.extensometer(*ends)), "gauge": strain}


def levelled() -> Arrays:
    """A field as subsets see it."""
    picture, (row, column) = waves((0.0, 0.0)), np.indices((180, 200))
    field = np.stack([np.sin(column / 9.0), np.cos(row / 7.0)], axis=2)
    points = measure.grid_points(picture.shape, subset=21, step=12)
    found = filtered_by_subsets(picture, points, [field], subset=21, shape="quadratic")
    return fields(found, "displacement", "slope", "contrast", "spread")


def tracked() -> Arrays:
    """A few points followed."""
    points = np.array([[60.0, 50.0], [120.5, 70.25], [90.0, 130.0]])
    return vars(measure.track(waves((0.0, 0.0)), waves((1.37, -0.71)), points, subset=25))


def targets() -> Arrays:
    """Markers, dots and codes."""
    markers = measure.find_markers(picture("markers"), (20.0, 50.0))
    return {
        **fields(markers, "points", "size", "angle", "contrast", "residual", "status"),
        "dots": measure.find_dots(picture("dots"), (5.0, 12.0)).points,
        "codes": measure.find_aruco(picture("aruco")).corners,
    }


def calibrated() -> Arrays:
    """A camera from seven images of a chessboard."""
    board = measure.Chessboard(9, 8, 0.05)
    paint = gs.paint.Checker(0.05, 9, 8, (0.1, 0.1), 0.9, 0.05, 0.8)
    flat = np.array([[0.0, 0.0, 0.0], [0.65, 0.0, 0.0], [0.65, 0.0, 0.6], [0.0, 0.0, 0.6]])
    camera = replace(camera_of("board", 480), distortion=BROWN)
    rng, sightings = np.random.default_rng(8), []
    for _ in range(7):
        turn = Rotation.from_euler("xyz", rng.uniform(-25.0, 25.0, 3), degrees=True).as_matrix()
        points = (flat - [0.325, 0.0, 0.3]) @ turn.T + rng.uniform(-0.05, 0.05, 3)
        surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint, reference=flat)
        values = radiance_of(gs.render([surface], camera, background=0.4))["radiance"]
        image = np.rint(255.0 * values).astype(np.uint8)
        sightings.append(measure.find_chessboard(image, board))
    found = measure.calibrate(sightings, lens="brown")
    lens = fields(found.cameras[0], "K", "distortion")
    return {**lens, **fields(found, "rms", "view_poses", "covariance")}


CASES: dict[str, Case] = {
    "measure/dic": partial(correlated, "gpu"),
    "measure/dic-numpy": partial(correlated, "numpy"),
    "measure/gauges": gauges,
    "measure/levelled": levelled,
    "measure/track": tracked,
    "measure/targets": targets,
    "measure/calibration": calibrated,
}
