"""The light of a view: emitters, surroundings and shadows, as the shaders read them and in NumPy.

Twin of ``shaders/lib/light/lighting.wgsl`` and ``lamp_shares.wgsl``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.gpu import Device
from gpusim.gpu.buffer import F32_MAX
from gpusim.optics.ambient.sky_irradiance import SkyIrradiance
from gpusim.optics.ambient.sky_visibility import SkyVisibility
from gpusim.optics.geometry.triangle_corners import POSITION
from gpusim.optics.geometry.view import View
from gpusim.optics.light.environment import Environment
from gpusim.optics.light.lights import AmbientLight, AreaLight, Light
from gpusim.optics.light.microfacet_material import Gloss, Reflection, sharpest
from gpusim.optics.light.quadrature import closest_points, emitter_light, emitters, lamps_of
from gpusim.optics.shadow.scene import Shadows
from gpusim.surface.surface import Surface
from gpusim.validation import require

MAX_EMITTERS = 256

SharesOf = Callable[[Float, Float, Float, Float, Float, Float, Long], Float]
"""As `Shadows.shares`."""


def casts_shadows(lights: Sequence[Light]) -> bool:
    """Whether some lamp is hidden by what is before it."""
    return any(lamp.light.shadows for lamp in lamps_of(lights))


def find_shadows(
    view: View,
    lights: Sequence[Light],
    surfaces: Sequence[Surface],
    device: Device | None = None,
) -> Shadows | None:
    """What ``surfaces`` hide of ``lights`` in a view; None where no lamp casts shadows."""
    if not surfaces or not casts_shadows(lights):
        return None
    return Shadows.of(view, lamps_of(lights), surfaces, device)


def emitting_points(view: View, lights: Sequence[Light]) -> Float:
    """The points that ``lights`` are divided into for ``view``: rows (E, 12) of `emitters`."""
    triangles = np.zeros((0, 3, 3))
    if any(isinstance(light, AreaLight) for light in lights):
        triangles = view.corners_of(slice(None), POSITION)
    closest = closest_points(lights, triangles, view.camera)
    return emitters(lights, closest, sharpest(view.paints))


def ambient(lights: Sequence[Light]) -> float:
    """Irradiance that every face receives from even surroundings."""
    return float(np.pi * sum(v.radiance for v in lights if isinstance(v, AmbientLight)))


@dataclass(frozen=True, eq=False)
class Lighting:
    """What lights a view; positions are relative to the camera's eye.

    ``emitters`` (E, 12): see `gpusim.optics.light.quadrature.emitters`. ``ambient``: irradiance
    from everywhere. ``environment``: other surroundings. ``gloss``: None without glossy paint.
    ``shadows``: None where no lamp casts any. ``openness``: None where nothing hides surroundings.
    """

    emitters: Float
    ambient: float
    environment: Environment | None
    gloss: Gloss | None
    shadows: Shadows | None
    openness: SkyVisibility | None

    @staticmethod
    def build(
        view: View,
        lights: Sequence[Light] | None,
        surfaces: Sequence[Surface] = (),
        device: Device | None = None,
    ) -> Lighting:
        """Reduce ``lights`` for ``view``; ``surfaces`` may hide them.

        ``device`` looks at surroundings, NumPy without one.

        Raises
        ------
        InputError
            More emitting points than a shader takes, or numbers beyond float32.
        """
        lights = lights or []
        rows = emitting_points(view, lights)
        expected = f"at most {MAX_EMITTERS}: use fewer lamps, or smaller ones farther away"
        got = f"{len(rows)} emitting points"
        require(len(rows) <= MAX_EMITTERS, "render lights", got, expected)
        rows[:, :3] -= rows[:, 8:9] * view.camera.eye
        largest = np.abs(rows).max(initial=0.0)
        expected = f"positions and intensities below {F32_MAX:.3g}"
        require(largest <= F32_MAX, "render lights", f"values up to {largest:.3g}", expected)
        environment = Environment.of(lights)
        even = ambient(lights)
        gloss = Gloss.build(view.paints, environment, even / np.pi) if lights else None
        hidden, openness = SkyIrradiance.of(lights, environment), None
        if surfaces and hidden is not None:
            openness = SkyVisibility.build(view, surfaces, hidden.share, device)
        shadows = find_shadows(view, lights, surfaces, device)
        return Lighting(rows, even, environment, gloss, shadows, openness)

    def with_strengths_of(self, lights: Sequence[Light], share: Float) -> Lighting:
        """The same with the strengths of lights that differ from its own in nothing else; ``share``
        (lamps,): by how much the lamps'."""
        rows, even = self.emitters.copy(), ambient(lights)
        rows[:, 3] *= share[rows[:, 11].astype(np.int64)]
        environment, gloss = Environment.of(lights), self.gloss
        if gloss is not None:
            gloss = gloss.under(environment, even / np.pi)
        return replace(self, emitters=rows, ambient=even, environment=environment, gloss=gloss)

    def constants(self, glossy: bool) -> dict[str, float]:
        """Override constants of the shaders; ``glossy``: for triangles with such paint."""
        return {
            "glossy": float(glossy),
            "sky": float(self.environment is not None),
            "emitter_count": float(len(self.emitters)),
            "sheltered": float(self.openness is not None),
        }

    def uniform(self) -> dict[str, Float]:
        """The emitters as the shaders' uniform ``lamps``."""
        rows = np.zeros((MAX_EMITTERS, 12))
        rows[: len(self.emitters)] = self.emitters
        linear, square, axes = np.zeros(4), np.zeros((3, 3)), np.zeros((3, 4))
        if self.environment is not None:
            linear[:3], linear[3] = self.environment.linear, self.environment.constant
            square, axes[:, :3] = self.environment.quadratic, self.environment.axes
        shape = self.gloss.maps.shape[1:] if self.gloss is not None else (2, 1)
        return {
            "ambient": np.array([self.ambient, self.ambient / np.pi, *shape]),
            "linear": linear,
            "diagonal": np.array([*np.diag(square), 0.0]),
            "mixed": np.array([square[1, 2], square[2, 0], square[0, 1], 0.0]),
            "per_paint": np.full(4, self.gloss.per_paint if self.gloss is not None else 1),
            "axes": axes,
            "emitters": rows.reshape(-1, 4),
        }

    def reflect(
        self,
        triangle: Long,
        paint: Int,
        at: Float,
        normal: Float,
        widened: Float,
        seen: Float | None,
    ) -> Reflection:
        """What surfaces at (n, 3) relative to the eye send towards it.

        ``triangle``, ``paint`` (n,); ``normal`` (n, 3) unit; ``widened`` (n,): what a relief adds
        to the square of alpha; ``seen`` (n, lamps): visible fractions; None for all.
        """
        around = np.full(len(at), self.ambient)
        if self.environment is not None:
            around = around + self.environment.diffuse(normal)
        share = np.ones((len(at), len(self.emitters)))
        if seen is not None:
            share = seen[:, self.emitters[:, 11].astype(np.int64)]
        openness = np.ones(len(at)) if self.openness is None else self.openness.at(triangle, at)
        matte = around / np.pi * openness
        p = q = np.zeros(len(at))
        view = -at / np.linalg.norm(at, axis=1)[:, None]
        if self.gloss is not None:
            first = self.gloss.surroundings(paint, normal, view, around)
            p, q = first.p * openness, first.q * openness
        for k, row in enumerate(self.emitters):
            irradiance, unit, _ = emitter_light(row, at, normal)
            irradiance = irradiance * share[:, k]
            matte = matte + irradiance / np.pi
            if self.gloss is not None:
                more = self.gloss.from_lamp(paint, normal, view, unit, irradiance, widened)
                p, q = p + more.p, q + more.q
        return Reflection(matte, p, q)
