"""Surroundings far away: what they light diffusely, and what glossy paints mirror of them.

Diffuse irradiance by spherical harmonics to the second order (Ramamoorthi and Hanrahan, "An
efficient representation for irradiance environment maps", SIGGRAPH 2001), which is exact for sky
and ground; reflections from a map that is blurred in advance by the lobe of each roughness, as seen
along its own normal (Karis, "Real shading in Unreal Engine 4", SIGGRAPH 2013 course).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from gpusim.arrays.array_types import Float, Int
from gpusim.optics.light.lights import EnvironmentLight, Light
from gpusim.validation import require

HEIGHT = 32
"""Rows of a blurred map; columns are twice as many, or one where all columns are equal."""

FINE = 48
"""Rows of the map that is blurred."""


@dataclass(frozen=True, eq=False)
class Environment:
    """Sum of all surroundings of a scene.

    ``axes`` (3, 3): rows right, forward, up. ``image`` (H, W) radiance, see `EnvironmentLight`.
    ``irradiance``: c, b (3,), m (3, 3) with E(n) = c + b . n + n . m n, in world axes.
    """

    axes: Float
    image: Float
    constant: float
    linear: Float
    quadratic: Float

    @staticmethod
    def of(lights: Sequence[Light]) -> Environment | None:
        """The `EnvironmentLight` among the lights, if there is one.

        Raises
        ------
        InputError
            There are several.
        """
        found = [light for light in lights if isinstance(light, EnvironmentLight)]
        if not found:
            return None
        require(len(found) == 1, "render lights", f"{len(found)} environments", "at most one")
        return Environment._of_light(found[0])

    @staticmethod
    @lru_cache(maxsize=16)
    def _of_light(light: EnvironmentLight) -> Environment:
        up = np.array(light.up, np.float64)
        up /= np.linalg.norm(up)
        forward = np.array(light.forward, np.float64)
        forward = forward - up * (forward @ up)
        forward /= np.linalg.norm(forward)
        axes = np.stack([np.cross(forward, up), forward, up])
        if light.image is None:
            image = np.repeat([[light.sky], [light.ground]], FINE // 2, axis=0)
            half = 0.5 * np.pi
            return Environment(
                axes, image, half * (light.sky + light.ground),
                half * (light.sky - light.ground) * up, np.zeros((3, 3)),
            )  # fmt: skip
        image = _resized(light.image, FINE, 2 * FINE)
        direction, weight = _directions(FINE, 2 * FINE)
        radiance = image.reshape(-1) * weight
        d = direction @ axes
        # moments of the radiance against the cosine lobe's first three bands
        zero = radiance.sum()
        one = radiance @ d
        two = np.einsum("n,ni,nj->ij", radiance, d, d)
        trace = two - np.eye(3) * zero / 3.0
        return Environment(axes, image, 0.25 * zero, 0.5 * one, 15.0 / 32.0 * trace)

    def diffuse(self, normal: Float) -> Float:
        """Irradiance (n,) of faces with unit normals (n, 3)."""
        square = np.einsum("ni,ij,nj->n", normal, self.quadratic, normal)
        result: Float = np.maximum(self.constant + normal @ self.linear + square, 0.0)
        return result

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the blurred maps."""
        return HEIGHT, 1 if self.image.shape[1] == 1 else 2 * HEIGHT

    def blurred(self, alpha: float) -> Float:
        """The map (H, W) as the lobe of GGX with ``alpha`` sees it around each direction."""
        if alpha not in self._blurred:
            self._blurred[alpha] = self._blur(alpha)
        return self._blurred[alpha]

    @cached_property
    def _blurred(self) -> dict[float, Float]:
        """By alpha: finding them takes longer than many a picture."""
        return {}

    def _blur(self, alpha: float) -> Float:
        rows, columns = self.shape
        target, _ = _directions(rows, columns)
        fine = self.image if columns > 1 else np.repeat(self.image, 2 * FINE, axis=1)
        source, weight = _directions(*fine.shape)
        weights = np.stack([weight * fine.reshape(-1), weight], axis=1)
        result = np.zeros(len(target))
        a2 = max(alpha, 1.5 / FINE) ** 2
        for k in range(0, len(target), 16):  # what stays in the processor's cache
            lobe = target[k : k + 16] @ source.T
            # the half vector lies half way: cos^2 of half the angle
            square = np.clip(0.5 * (1.0 + lobe), 0.0, 1.0)
            square *= a2 - 1.0
            square += 1.0
            np.maximum(lobe, 0.0, out=lobe)
            lobe /= square * square
            sums = lobe @ weights
            result[k : k + 16] = sums[:, 0] / sums[:, 1]
        return result.reshape(rows, columns)

    def mirrored(self, maps: Float, which: Int, direction: Float) -> Float:
        """Values (n,) of blurred maps (M, H, W) in unit directions (n, 3), between four texels."""
        rows, columns = maps.shape[1:]
        local = direction @ self.axes.T
        v = np.arccos(np.clip(local[:, 2], -1.0, 1.0)) / np.pi * rows - 0.5
        u = (np.arctan2(local[:, 0], local[:, 1]) / (2.0 * np.pi) + 0.5) * columns - 0.5
        v = np.clip(v, 0.0, rows - 1.0)
        j = np.minimum(np.floor(v).astype(np.int64), rows - 2)
        i = np.floor(u).astype(np.int64)
        s, t = u - i, v - j
        a, b = i % columns, (i + 1) % columns
        top = maps[which, j, a] * (1.0 - s) + maps[which, j, b] * s
        low = maps[which, j + 1, a] * (1.0 - s) + maps[which, j + 1, b] * s
        result: Float = top * (1.0 - t) + low * t
        return result


def _directions(rows: int, columns: int) -> tuple[Float, Float]:
    """Unit vectors (right, forward, up) of the texels of a map, and their solid angles."""
    theta = (np.arange(rows) + 0.5) / rows * np.pi
    phi = ((np.arange(columns) + 0.5) / columns - 0.5) * 2.0 * np.pi
    t, p = np.meshgrid(theta, phi, indexing="ij")
    direction = np.stack([np.sin(t) * np.sin(p), np.sin(t) * np.cos(p), np.cos(t)], axis=-1)
    edges = np.cos(np.arange(rows + 1) / rows * np.pi)
    weight = np.repeat((edges[:-1] - edges[1:]) * 2.0 * np.pi / columns, columns)
    return direction.reshape(-1, 3), weight


def _resized(image: Float, rows: int, columns: int) -> Float:
    """Mean over the areas of another grid, whatever the ratio of the sizes."""

    def matrix(count: int, wanted: int) -> Float:
        low = np.arange(wanted)[:, None] * count / wanted
        high = (np.arange(wanted)[:, None] + 1) * count / wanted
        own = np.arange(count)[None]
        share: Float = np.clip(np.minimum(high, own + 1) - np.maximum(low, own), 0.0, None)
        return share * wanted / count

    result: Float = matrix(image.shape[0], rows) @ image @ matrix(image.shape[1], columns).T
    return result
