"""Glossy reflection: microfacets after Walter et al., "Microfacet models for refraction through
rough surfaces" (EGSR 2007).

GGX distribution with alpha = roughness^2, Smith's height-correlated masking (Heitz, "Understanding
the masking-shadowing function", JCGT 2014), Schlick's Fresnel term. A dielectric reflects 4 % at
normal incidence over a Lambert base, which gets what the coat leaves; a metal has no base and
reflects its albedo. Every term is linear in the albedo: radiance = albedo p + q.
Twin of ``shaders/lib/light/brdf.wgsl``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

__all__ = ["DIELECTRIC", "SAMPLES", "facet_terms", "reflectance_table"]

Array = npt.NDArray[np.float64]
DIELECTRIC = 0.04
SAMPLES = 64
"""Nodes of a reflectance table: cosines (i + 1/2) / 64."""


def facet_terms(alpha: Array, normal: Array, view: Array, light: Array) -> tuple[Array, Array]:
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
def reflectance_table(alpha: float) -> Array:
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


def reflectance(table: Array, cosine: Array) -> Array:
    """(n, 2) a and b at cosines (n,), linear between the nodes; ``table`` (n, 64, 2) or (64, 2)."""
    at = np.clip(cosine * SAMPLES - 0.5, 0.0, SAMPLES - 1.0)
    low = np.minimum(at.astype(np.int64), SAMPLES - 2)
    t = (at - low)[:, None]
    rows = np.arange(len(low))
    if table.ndim == 2:
        result: Array = table[low] * (1.0 - t) + table[low + 1] * t
        return result
    result = table[rows, low] * (1.0 - t) + table[rows, low + 1] * t
    return result
