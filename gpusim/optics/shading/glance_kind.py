"""Triangles of one program whose light is looked for as a function of the pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device
from gpusim.optics.shading.looks import Looks

if TYPE_CHECKING:
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["SLENDER", "GlanceKind", "glance_params"]

SLENDER = 64.0
"""Squares of two sides of a triangle over twice its area, beyond which terms of second degree would
be large and cancel."""

UNUSED: dict[str, Any] = {
    "last": 0, "stretch": 1.0, "margin": 0.0, "rows": 0, "stride": 0, "looking": 0, "tall": 0,
    "longest": 0, "late": False, "lowest": (0, 0), "steep": 0.0, "ground": 0.0,
}  # fmt: skip
"""Uniforms of the shader, where an entry has no use for them."""


def glance_params(tables: Tables, tolerance: float) -> dict[str, Any]:
    """Uniforms of the shader of a view whose triangles have records; ``tolerance``: of the light,
    that functions may be off by."""
    assert tables.records is not None
    return {
        "rays": tables.rays(), "count": 0, "width": 0, "row0": 0, "tolerance": tolerance,
        "background": tables.setup.background, "slender": SLENDER,
        "inverse_depth": tables.records.inverse_depth, **UNUSED,
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class GlanceKind:
    """Matte triangles whose light is looked at: their program's ``constants``, their numbers + 1
    in ``order``, how many groups of 64 they fill in ``groups``, if the device found them, or None.
    ``bare``: light is found without the albedo. ``looks``: these are those near lines among all of
    a view, which are looked at. ``refused``: numbers + 1 of those whose light is no such function,
    and ``refusals``: how many groups of 64 they fill, 1, 1, and how many they are."""

    constants: dict[str, float]
    bare: bool
    order: Buffer
    looks: Looks | None
    refused: Buffer
    refusals: Buffer

    @staticmethod
    def of(device: Device, constants: dict[str, float], order: Buffer | Looks) -> GlanceKind:
        bare = bool(constants["board"])
        looks = order if isinstance(order, Looks) else None
        order = order.lined if isinstance(order, Looks) else order
        refused = device.empty(order.nbytes, "glance.refused")
        refusals = device.buffer(np.array([0, 1, 1, 0], np.uint32), "glance.refusals")
        # what is refused takes the closed form for all
        constants = {**constants, "board": 0.0}
        return GlanceKind(constants, bare, order, looks, refused, refusals)

    @property
    def groups(self) -> Buffer | None:
        """How many groups of 64 those in ``order`` fill, 1, 1, if the device counted them."""
        return None if self.looks is None else self.looks.groups

    @property
    def count(self) -> int:
        """How many triangles are looked at."""
        return self.order.nbytes // 4

    def numbers(self) -> npt.NDArray[np.uint32]:
        """The triangles in ``order``; waits for the device."""
        numbers = self.order.read(np.uint32)
        return np.asarray(numbers[numbers > 0] - np.uint32(1))
