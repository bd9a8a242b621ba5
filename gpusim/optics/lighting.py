"""The light of a view: emitters, surroundings and shadows, as the shaders read them and in NumPy.

Twin of ``shaders/common/light.wgsl``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu.buffer import F32_MAX
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import closest_points, emitters, irradiance, lamps_of
from gpusim.optics.light import AmbientLight, Light
from gpusim.optics.shadow_tiles import ShadowTiles
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = ["MOST_EMITTERS", "Lighting", "ambient"]

Array = npt.NDArray[np.float64]
MOST_EMITTERS = 256


def ambient(lights: Sequence[Light]) -> float:
    """Irradiance that every face receives from even surroundings."""
    return float(np.pi * sum(v.radiance for v in lights if isinstance(v, AmbientLight)))


@dataclass(frozen=True, eq=False)
class Lighting:
    """What lights a view; positions are relative to the camera's eye.

    ``emitters`` (E, 12): see `gpusim.optics.emitters.emitters`. ``ambient``: irradiance from
    everywhere. ``shadows``: None where nothing in view is hidden from any lamp.
    """

    emitters: Array
    ambient: float
    shadows: ShadowTiles | None

    @staticmethod
    def build(
        view: View, lights: Sequence[Light] | None, surfaces: Sequence[Surface] = ()
    ) -> Lighting:
        """Reduce ``lights`` for ``view``; ``surfaces`` may hide them.

        Raises
        ------
        InputError
            More emitting points than a shader takes, or numbers beyond float32.
        """
        lights = lights or []
        T = view.camera.camera_from_world
        world = (view.corners[:, :, :3] - T[:3, 3]) @ T[:3, :3]
        rows = emitters(lights, closest_points(lights, world))
        if len(rows) > MOST_EMITTERS:
            raise InputError(
                f"render lights; got {len(rows)} emitting points; expected at most "
                f"{MOST_EMITTERS}: use fewer lamps, or smaller ones farther away"
            )
        rows[:, :3] -= rows[:, 8:9] * view.camera.eye
        if not np.abs(rows).max(initial=0.0) <= F32_MAX:
            raise InputError(
                f"render lights; got values up to {np.abs(rows).max():.3g}; expected positions "
                f"and intensities below {F32_MAX:.3g}"
            )
        lamps = lamps_of(lights)
        shadows = None
        if surfaces and any(lamp.light.shadows for lamp in lamps):
            found = ShadowTiles.build(view, lamps, Casters.of(surfaces))
            shadows = found if found.any else None
        return Lighting(rows, ambient(lights), shadows)

    def constants(self) -> dict[str, float]:
        """Override constants of the shaders."""
        return {
            "emitter_count": float(len(self.emitters)),
            "shadowed": float(self.shadows is not None),
        }

    def uniform(self) -> dict[str, Array]:
        """The emitters as the shaders' uniform ``lamps``."""
        rows = np.zeros((MOST_EMITTERS, 12))
        rows[: len(self.emitters)] = self.emitters
        return {"ambient": np.full(4, self.ambient), "emitters": rows.reshape(-1, 4)}

    def matte(
        self, x: Array, y: Array, at: Array, normal: Array, across: Array, down: Array
    ) -> Array:
        """What the albedo of a matte surface is multiplied by, (n,): irradiance / pi.

        ``x``, ``y`` px; ``at`` (n, 3) relative to the eye; ``normal`` (n, 3) unit; ``across`` and
        ``down`` (n, 3): how ``at`` changes over the pixel, for shadows sharper than a pixel.
        """
        parts = irradiance(self.emitters, at, normal)
        if self.shadows is not None:
            share = self.shadows.shares(x, y, at, across, down)
            parts = parts * share[:, self.emitters[:, 11].astype(np.int64)]
        result: Array = (parts.sum(axis=1) + self.ambient) / np.pi
        return result
