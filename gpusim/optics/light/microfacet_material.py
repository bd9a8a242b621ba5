"""Glossy paints of a view: their microfacets, and tables of what they reflect of surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.view import RegionPaint
from gpusim.optics.light.brdf import (
    DIELECTRIC,
    SAMPLES,
    facet_terms,
    reflectance,
    reflectance_table,
)
from gpusim.optics.light.environment import Environment

__all__ = ["Gloss", "Reflection", "gloss_texels", "sharpest"]

Array = npt.NDArray[np.float64]
SMOOTHEST = 0.02
"""The smallest alpha that float32 resolves; smoother paints are taken as this one."""


@dataclass(frozen=True, eq=False)
class Reflection:
    """What surfaces send towards the eye, (n,) each.

    A matte print of albedo a: a ``matte``. The ground of a paint with albedo g: g ``p`` + ``q``.
    """

    matte: Array
    p: Array
    q: Array


def finish(region: RegionPaint) -> tuple[float, float]:
    """Roughness and metallic share of a paint; those that have none are matte."""
    return getattr(region.paint, "roughness", 1.0), getattr(region.paint, "metallic", 0.0)


def sharpest(paints: Sequence[RegionPaint]) -> float:
    """The smallest alpha of any glossy paint; infinite where all are matte."""
    alphas = [max(finish(r)[0] ** 2, SMOOTHEST) for r in paints if finish(r)[0] < 1.0]
    return min(alphas, default=np.inf)


@dataclass(frozen=True, eq=False)
class Gloss:
    """Per paint (P,): ``glossy``, ``alpha``, ``metallic``; ``table`` (P, 64, 2) of reflectances,
    ``maps`` (P, H, W) of the surroundings blurred by its lobe (all alike without an environment).
    """

    glossy: npt.NDArray[np.bool_]
    alpha: Array
    metallic: Array
    table: Array
    maps: Array
    environment: Environment | None
    even: float

    @staticmethod
    def build(
        paints: Sequence[RegionPaint], environment: Environment | None, even: float
    ) -> Gloss | None:
        """None if no paint is glossy. ``even``: radiance from every direction beside the rest."""
        rough = np.array([finish(region)[0] for region in paints], np.float64)
        glossy = rough < 1.0
        if not glossy.any():
            return None
        alpha = np.maximum(rough**2, SMOOTHEST)
        shape = environment.shape if environment is not None else (2, 1)
        table, maps = np.zeros((len(rough), SAMPLES, 2)), np.zeros((len(rough), *shape))
        for value in np.unique(alpha[glossy]):
            own = glossy & (alpha == value)
            table[own] = reflectance_table(float(value))
            if environment is not None:
                maps[own] = environment.blurred(float(value))
        metallic = np.array([finish(region)[1] for region in paints], np.float64)
        return Gloss(glossy, alpha, metallic, table, maps, environment, even)

    @property
    def per_paint(self) -> int:
        """Texels of the device's table per paint."""
        return SAMPLES + int(self.maps.shape[1] * self.maps.shape[2])

    def surroundings(
        self, paint: npt.NDArray[np.int32], normal: Array, view: Array, diffuse: Array
    ) -> Reflection:
        """Reflection of the surroundings; ``diffuse`` (n,) their irradiance."""
        nv = np.clip(np.sum(normal * view, axis=1), 0.0, 1.0)
        a, b = reflectance(self.table[paint], nv).T
        radiance = np.full(len(paint), self.even)
        if self.environment is not None:
            mirror = 2.0 * nv[:, None] * normal - view
            mirror = mirror / np.linalg.norm(mirror, axis=1)[:, None]
            radiance = radiance + self.environment.mirrored(self.maps, paint, mirror)
        metallic = self.metallic[paint]
        base = (1.0 - metallic) * self._base(a, b) * diffuse / np.pi
        coat = DIELECTRIC * (1.0 - metallic) * a + b
        return Reflection(diffuse / np.pi, base + metallic * a * radiance, coat * radiance)

    def from_lamp(
        self,
        paint: npt.NDArray[np.int32],
        normal: Array,
        view: Array,
        light: Array,
        irradiance: Array,
        widened: Array | float = 0.0,
    ) -> Reflection:
        """Reflection of light from unit directions ``light`` (n, 3) of given irradiance (n,).

        ``widened`` (n,): what a relief too fine to be seen adds to the square of alpha.
        """
        nv = np.clip(np.sum(normal * view, axis=1), 0.0, 1.0)
        a, b = reflectance(self.table[paint], nv).T
        alpha = np.minimum(np.sqrt(self.alpha[paint] ** 2 + widened), 1.0)
        facets, fresnel = facet_terms(alpha, normal, view, light)
        metallic = self.metallic[paint]
        mirrored = facets * irradiance
        base = (1.0 - metallic) * self._base(a, b) * irradiance / np.pi
        coat = fresnel + DIELECTRIC * (1.0 - metallic) * (1.0 - fresnel)
        p = base + metallic * mirrored * (1.0 - fresnel)
        return Reflection(irradiance / np.pi, p, mirrored * coat)

    @staticmethod
    def _base(a: Array, b: Array) -> Array:
        """What a dielectric's coat leaves to the base under it."""
        return 1.0 - DIELECTRIC * a - b


def gloss_texels(device: Device, gloss: Gloss | None) -> Texels:
    """The tables as lib/light/brdf.wgsl reads them."""
    if gloss is None:
        return device.no_texels("rgba32float")
    rows = np.zeros((len(gloss.alpha), gloss.per_paint, 4), np.float32)
    rows[:, :SAMPLES, :2] = gloss.table
    rows[:, SAMPLES:, 0] = gloss.maps.reshape(len(gloss.alpha), -1)
    texels = device.texels(rows.shape[0] * rows.shape[1], "rgba32float", "shade.gloss")
    texels.write(rows.reshape(-1, 4))
    return texels
