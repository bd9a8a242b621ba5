"""What reaches a point of surroundings that surfaces hide, as a share of what would without them.

Even surroundings count by the cosine. Of others each sample of the hemisphere brings the radiance
of its own direction, so that a face under a ledge doesn't lose the light from below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.unique import distinct
from gpusim.optics.ambient.hemisphere_mask import COLUMNS, ROWS, HemisphereMasks, directions
from gpusim.optics.ambient.silhouette_bvh import tangent
from gpusim.optics.light.environment import Environment
from gpusim.optics.light.lights import AmbientLight, EnvironmentLight, Light

CHUNK = 512
"""Points at a time."""

NORMALS = 1e-4
"""Steps in which components of normals are told apart."""


@dataclass(frozen=True, eq=False)
class SkyIrradiance:
    """``open`` and ``even``: irradiance of even surroundings that nothing hides, and of those that
    surfaces do; ``environment``: other surroundings, ``hides`` whether surfaces hide these."""

    open: float
    even: float
    environment: Environment | None
    hides: bool

    @staticmethod
    def of(lights: Sequence[Light], environment: Environment | None) -> SkyIrradiance | None:
        """None where no light asks for it."""
        ambient = [light for light in lights if isinstance(light, AmbientLight)]
        hides = any(isinstance(light, EnvironmentLight) and light.occlusion for light in lights)
        if not hides and not any(light.occlusion for light in ambient):
            return None
        both = [
            float(np.pi * sum(light.radiance for light in ambient if light.occlusion is occluded))
            for occluded in (False, True)
        ]
        return SkyIrradiance(both[0], both[1], environment, hides)

    def share(self, seen: HemisphereMasks, normal: Float) -> Float:
        """(N,) of all surroundings' irradiance at points with unit normals (N, 3)."""
        got = self.open + self.even * seen.open_share
        whole = np.full(len(normal), self.open + self.even)
        if self.environment is not None:
            around = self.environment.diffuse(normal)
            whole += around
            got += around * (_seen_of(self.environment, seen, normal) if self.hides else 1.0)
        result: Float = np.where(whole > 0.0, got / np.where(whole > 0.0, whole, 1.0), 1.0)
        return result


def _seen_of(environment: Environment, seen: HemisphereMasks, normal: Float) -> Float:
    """Shares (N,) of the surroundings' irradiance."""
    whole = np.rint(normal / NORMALS).astype(np.int64) + 20_000
    key = (whole[:, 0] * 40_001 + whole[:, 1]) * 40_001 + whole[:, 2]
    order = np.argsort(key, kind="stable")
    normal, hidden = normal[order], seen.hidden[order]
    kind = np.searchsorted(distinct(key), key[order])
    result = np.ones(len(normal))
    for begin in range(0, len(normal), CHUNK):
        part = slice(begin, begin + CHUNK)
        first, of_kind = np.unique(kind[part], return_index=True)
        radiance = _radiances(environment, normal[part][of_kind])
        radiance = radiance[np.searchsorted(first, kind[part])]
        bits = np.unpackbits(hidden[part].astype("<u4").view(np.uint8), axis=1, bitorder="little")
        total = radiance.sum(axis=1)
        lost = np.einsum("nk,nk->n", radiance, bits)
        result[part] = 1.0 - lost / np.where(total > 0.0, total, 1.0)
    back = np.empty_like(result)
    back[order] = result
    return back


def _radiances(environment: Environment, normal: Float) -> Float:
    """(N, 2048): of the samples over points with unit normals (N, 3)."""
    u = tangent(normal)
    axes = np.stack([u, np.cross(normal, u), normal], axis=1)
    to = (directions().reshape(-1, 3) @ axes).reshape(-1, 3)
    image = environment.image
    if image.shape[1] == 1:
        result = np.where(to @ environment.axes[2] > 0.0, image[0, 0], image[-1, 0])
    else:
        result = environment.mirrored(image[None], np.zeros(len(to), np.int32), to)
    return np.asarray(result).reshape(len(normal), ROWS * COLUMNS)
