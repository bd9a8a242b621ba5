"""A small scene for the twin checks: boxes, a bent open sheet, and a lamp of each kind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.light_space import LightSpace, light_spaces
from gpusim.optics.shadow.occluders import Occluders, relative_points
from gpusim.optics.shadow.receivers import PixelReceivers, Receivers
from gpusim.optics.shadow.single_layer import wound_once
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface
from gpusim.twin_checks.shadow_scene import block, shadow_scene

__all__ = ["probe_pieces", "probe_pixels", "probe_points", "probe_spaces"]

Array = npt.NDArray[np.float64]


@cache
def _scene() -> tuple[list[Surface], Camera, list[Light]]:
    surfaces, _, lights = shadow_scene()
    x, y = np.meshgrid(np.linspace(0.35, 0.7, 6), np.linspace(-0.3, 0.2, 5), indexing="ij")
    z = 0.15 + 0.05 * np.sin(9.0 * x) * np.cos(7.0 * y)
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    sheet = Surface(points, quads.reshape(-1, 4).astype(np.int32), paint=Plain(0.6), name="sheet")
    more = [sheet, block((-0.55, 0.3, 0.2), (0.1, 0.07, 0.1), 0.5)]
    small = Camera.from_lens((36.0, 24.0), 30.0, (61, 43), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
    return [*surfaces, *more], small, lights


@cache
def probe_points() -> npt.NDArray[np.float32]:
    """(V, 3): the vertices relative to the eye."""
    surfaces, camera, _ = _scene()
    return relative_points(surfaces, camera.eye)


@cache
def _spaces() -> list[LightSpace]:
    surfaces, camera, lights = _scene()
    spaces = light_spaces(lamps_of(lights), probe_points(), camera.eye)
    return [replace(v, sheets=wound_once(v, surfaces, camera.eye)) for v in spaces]


@cache
def _occluders() -> Occluders:
    return Occluders.of(_scene()[0])


def probe_spaces() -> list[tuple[Occluders, npt.NDArray[np.float32], LightSpace]]:
    """The occluders, their vertices, and each light space; one of them in the midst of these."""
    middle = light_spaces(
        [v.lamp for v in _spaces()][2:3], probe_points(), np.array([0.8, -0.5, 0.4])
    )
    return [(_occluders(), probe_points(), space) for space in [*_spaces(), *middle]]


@cache
def probe_pixels() -> tuple[Occluders, list[LightSpace], PixelReceivers]:
    """What a camera sees of it."""
    surfaces, camera, _ = _scene()
    view = look(surfaces, camera, lit=True)
    ids = visibility_twin(view)
    return _occluders(), _spaces(), PixelReceivers.of(view, ids, _occluders())


@cache
def probe_pieces() -> tuple[Occluders, list[LightSpace], Receivers]:
    """Pieces of pixels on the table, some of which lie close to what stands there."""
    random = np.random.default_rng(5)
    _, camera, _ = _scene()
    at = np.column_stack([random.uniform(-0.9, 0.9, (400, 2)), np.zeros(400)]) - camera.eye
    normal = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
    turn = random.uniform(0.0, 2.0 * np.pi, 400)
    size = random.uniform(1e-3, 2e-2, (2, 400, 1))
    across = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    down = np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn])
    on = np.full(400, -1)
    return _occluders(), _spaces(), Receivers(at, normal, size[0] * across, size[1] * down, on)
