"""A small scene with shadows of every kind of lamp, for the twin checks and tests."""

from __future__ import annotations

import numpy as np

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SpotLight, SunLight
from gpusim.surface.paint import Checker, Plain
from gpusim.surface.surface import Surface

__all__ = ["block", "shadow_scene"]


def block(
    centre: tuple[float, float, float], half: tuple[float, float, float], albedo: float
) -> Surface:
    """A closed box of bare metal."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    faces = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    )
    points = np.array(centre) + signs * half
    return Surface(points, faces, paint=Plain(albedo, 0.45, 1.0), name="block")


def shadow_scene() -> tuple[list[Surface], Camera, list[Light]]:
    """A box on a table, a plate in the air, and a lamp of each kind."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    table = np.concatenate([1.1 * corners, np.zeros((4, 1))], axis=1)
    plate = np.concatenate([0.17 * corners + [0.3, 0.25], np.full((4, 1), 0.31)], axis=1)
    face = np.array([[0, 1, 2, 3]])
    surfaces = [
        Surface(table, face, paint=Checker(0.23, origin=(0.05, 0.11)), name="table"),
        Surface(plate, face, paint=Plain(0.7, 0.6), name="plate"),
        block((-0.15, -0.05, 0.11), (0.13, 0.08, 0.11), 0.6),
    ]
    camera = Camera.from_lens((36.0, 24.0), 30.0, (119, 83), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
    lights: list[Light] = [
        AreaLight((-0.9, -0.4, 0.9), (0.0, 0.0, 0.1), (0.22, 0.13), 8.0),
        AreaLight((0.2, 0.9, 0.8), (0.0, 0.0, 0.0), (0.2, 0.2), 4.0, shape="ellipse"),
        PointLight((0.8, -0.6, 0.9), 6.0),
        SpotLight((-0.2, -0.8, 1.1), (0.0, 0.1, 0.0), 3.0, cone=0.6),
        SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05),
    ]
    return surfaces, camera, lights
