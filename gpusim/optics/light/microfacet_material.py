"""Glossy paints of a view: their microfacets, and tables of what they reflect of surroundings.

Microfacets after Walter et al., "Microfacet models for refraction through rough surfaces" (EGSR
2007): GGX distribution with alpha = roughness^2, Smith's height-correlated masking (Heitz,
"Understanding the masking-shadowing function", JCGT 2014), Schlick's Fresnel term. A dielectric
reflects 4 % at normal incidence over a Lambert base, which gets what the coat leaves; a metal has
no base and reflects its albedo. Every term is linear in the albedo: radiance = albedo p + q. Twin
of ``shaders/lib/light/brdf.wgsl``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.light.environment import Environment

DIELECTRIC = 0.04
SAMPLES = 64
"""Nodes of a reflectance table: cosines (i + 1/2) / 64."""


def facet_terms(alpha: Float, normal: Float, view: Float, light: Float) -> tuple[Float, Float]:
    """Microfacets between unit vectors (n, 3): their reflection without Fresnel, and Schlick's
    (1 - v . h)^5; the BRDF is terms[0] x (F0 + (1 - F0) terms[1]) per sr.
    """
    half = light + view
    half = half / np.maximum(np.linalg.norm(half, axis=1), 1e-30)[:, None]
    nl = np.maximum(np.sum(normal * light, axis=1), 1e-6)
    nv = np.maximum(np.sum(normal * view, axis=1), 1e-6)
    nh = np.clip(np.sum(normal * half, axis=1), 0.0, 1.0)
    vh = np.clip(np.sum(view * half, axis=1), 0.0, 1.0)
    a2 = alpha * alpha
    spread = nh * nh * (a2 - 1.0) + 1.0
    mask = nl * np.sqrt(nv * nv * (1.0 - a2) + a2) + nv * np.sqrt(nl * nl * (1.0 - a2) + a2)
    return a2 / (np.pi * spread * spread) * 0.5 / mask, (1.0 - vh) ** 5


@lru_cache(maxsize=64)
def reflectance_table(alpha: float) -> Float:
    """(64, 2), read only: a and b at cosines (i + 1/2) / 64; even light of radiance L is reflected
    as L (F0 a + b) (the directional albedo, split as in Karis, SIGGRAPH 2013 course).

    Integrated over half vectors drawn from the distribution of visible ones' projection
    (4096 points of a Fibonacci lattice): right to about 1e-3.
    """
    count = 4096
    i = np.arange(count)
    u = (i + 0.5) / count
    phi = 2.0 * np.pi * ((i * 0.6180339887498949) % 1.0)
    cos_h = np.sqrt((1.0 - u) / (1.0 + (alpha * alpha - 1.0) * u))
    sin_h = np.sqrt(np.maximum(1.0 - cos_h**2, 0.0))
    half = np.stack([sin_h * np.cos(phi), sin_h * np.sin(phi), cos_h], axis=1)
    result = np.zeros((SAMPLES, 2))
    for k in range(SAMPLES):
        mu = (k + 0.5) / SAMPLES
        view = np.array([np.sqrt(1.0 - mu * mu), 0.0, mu])
        vh = half @ view
        nl = 2.0 * vh * cos_h - mu
        good = (nl > 0.0) & (vh > 0.0)
        a2 = alpha * alpha
        safe = np.where(good, nl, 1.0)
        mask = safe * np.sqrt(mu * mu * (1.0 - a2) + a2) + mu * np.sqrt(safe**2 * (1.0 - a2) + a2)
        weight = np.where(good, 2.0 * vh * safe / (cos_h * mask), 0.0)
        fresnel = (1.0 - np.clip(vh, 0.0, 1.0)) ** 5
        result[k] = np.mean(weight * (1.0 - fresnel)), np.mean(weight * fresnel)
    result.flags.writeable = False
    return result


def reflectance(table: Float, cosine: Float) -> Float:
    """(n, 2) a and b at cosines (n,), linear between the nodes; ``table`` (n, 64, 2)."""
    at = np.clip(cosine * SAMPLES - 0.5, 0.0, SAMPLES - 1.0)
    low = np.minimum(at.astype(np.int64), SAMPLES - 2)
    t = (at - low)[:, None]
    rows = np.arange(len(low))
    result: Float = table[rows, low] * (1.0 - t) + table[rows, low + 1] * t
    return result


SMOOTHEST = 0.02
"""The smallest alpha that float32 resolves; smoother paints are taken as this one."""


@dataclass(frozen=True, eq=False)
class Reflection:
    """What surfaces send towards the eye, (n,) each.

    A matte print of albedo a: a ``matte``. The ground of a paint with albedo g: g ``p`` + ``q``.
    """

    matte: Float
    p: Float
    q: Float


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

    glossy: Bool
    alpha: Float
    metallic: Float
    table: Float
    maps: Float
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
        table, none = np.zeros((len(rough), SAMPLES, 2)), np.zeros((len(rough), 2, 1))
        for value in np.unique(alpha[glossy]):
            table[glossy & (alpha == value)] = reflectance_table(float(value))
        metallic = np.array([finish(region)[1] for region in paints], np.float64)
        return Gloss(glossy, alpha, metallic, table, none, None, 0.0).under(environment, even)

    def under(self, environment: Environment | None, even: float) -> Gloss:
        """The same paints under other surroundings."""
        shape = environment.shape if environment is not None else (2, 1)
        maps = np.zeros((len(self.alpha), *shape))
        if environment is not None:
            for value in np.unique(self.alpha[self.glossy]):
                own = self.glossy & (self.alpha == value)
                maps[own] = environment.blurred(float(value))
        return replace(self, maps=maps, environment=environment, even=even)

    @property
    def per_paint(self) -> int:
        """Texels of the device's table per paint."""
        return SAMPLES + int(self.maps.shape[1] * self.maps.shape[2])

    def surroundings(self, paint: Int, normal: Float, view: Float, diffuse: Float) -> Reflection:
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
        paint: Int,
        normal: Float,
        view: Float,
        light: Float,
        irradiance: Float,
        widened: Float | float = 0.0,
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
    def _base(a: Float, b: Float) -> Float:
        """What a dielectric's coat leaves to the base under it."""
        return 1.0 - DIELECTRIC * a - b


def gloss_texels(device: Device, bands: Sequence[Gloss | None]) -> Texels:
    """The tables as lib/light/brdf.wgsl reads them; of the ``bands`` only the maps differ."""
    gloss = bands[0]
    if gloss is None:
        return device.no_texels("rgba32float")
    rows = np.zeros((len(gloss.alpha), gloss.per_paint, 4), np.float32)
    rows[:, :SAMPLES, :2] = gloss.table
    for k, band in enumerate(bands):
        if band is not None:
            rows[:, SAMPLES:, k] = band.maps.reshape(len(gloss.alpha), -1)
    texels = device.texels(rows.shape[0] * rows.shape[1], "rgba32float", "shade.gloss")
    texels.write(rows.reshape(-1, 4))
    return texels
