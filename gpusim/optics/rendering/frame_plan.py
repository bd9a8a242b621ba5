"""What one frame is made by: every choice, made once before any work, with its reason.

A plan can be printed, and overridden: ``plan.replace(deferred=False)``. None of its shortcuts
changes a picture by more than rounding; `FramePlan.without_shortcuts` goes without all of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gpusim.optics.edge_pixels.plate_border import Border
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shading.lighting import casts_shadows
from gpusim.optics.shading.shading_pass import small_triangles
from gpusim.optics.shading.tile_light import MIN_PIXELS

BAND_BYTES = 1 << 25
"""Of radiance that is worked on at a time."""

MIN_ROWS = 16
"""Of a band."""

MIN_ROWS_SHADOWED = 32
"""Rows of a band under shadows come by as many, as whole tiles of receivers."""

LAMPS_AT_ONCE = 4
"""Lamps whose shares of all of a band fit into one binding; with more of them bands are lower."""


@dataclass(frozen=True)
class FramePlan:
    """The choices of a frame, or of a part of its rows.

    ``rows``: of a band. ``lit``, ``shadowed``: whether there are lights, and lamps whose light
    something may hide. The others are shortcuts: ``deferred``: pixels are shaded once it is known
    which triangle each one sees; ``checker_lines``: boards are plain but for strips along their
    lines; ``tile_light``: light on large planes is interpolated; ``plate_border``: edge pixels of a
    flat plate in closed form. ``reasons``: why, by name.
    """

    rows: int
    lit: bool
    shadowed: bool
    deferred: bool
    checker_lines: bool
    tile_light: bool
    plate_border: bool
    reasons: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    def replace(self, **choices: bool | int) -> FramePlan:
        """The same plan with other choices."""
        reasons = {**self.reasons, **dict.fromkeys(choices, "asked for")}
        return dataclasses.replace(self, reasons=reasons, **choices)  # type: ignore[arg-type]

    def without_shortcuts(self) -> FramePlan:
        """The same plan without anything that is there for speed alone."""
        return self.replace(**dict.fromkeys(SHORTCUTS, False))

    def __str__(self) -> str:
        """A table: choice, value, reason."""
        values = {name: getattr(self, name) for name in self.reasons}
        shown = {n: ("yes" if v else "no") if isinstance(v, bool) else v for n, v in values.items()}
        return "\n".join(f"{n:15} {v!s:6} {self.reasons[n]}" for n, v in shown.items())


SHORTCUTS = ("deferred", "checker_lines", "tile_light", "plate_border")


def plan_frame(
    view: View,
    lights: Sequence[Light] | None,
    height: int | None = None,
    coloured: bool = False,
) -> FramePlan:
    """The plan of a view, of which ``height`` rows are drawn (None: all)."""
    camera, height = view.camera, height or view.camera.height
    lit, shadowed = lights is not None, casts_shadows(lights or [])
    rows = _band_rows(camera.width, height, lights or [] if shadowed else None)
    straight = camera.lens is None
    deferred = small_triangles(view)
    # a box that is too small holds no triangle that is large enough
    large = 0.5 * view.extent**2 >= MIN_PIXELS
    choices: dict[str, tuple[bool | int, str]] = {
        "rows": (rows, f"{height} rows in all"),
        "lit": (lit, "lights" if lit else "no lights: the paints' albedo"),
        "shadowed": (shadowed, "lamps that cast shadows" if shadowed else "no lamp casts shadows"),
        "deferred": (
            deferred, f"{view.count} triangles of {view.mean_pixels:.0f} px in the mean"
        ),
        "checker_lines": (
            not deferred and straight, "small triangles or a lens bend lines" if deferred or
            not straight else "triangles larger than fields' lines are wide",
        ),
        "tile_light": (lit and large, f"boxes of at least {MIN_PIXELS:.0f} px, lit"),
        "plate_border": (
            not (lit or coloured) and Border.suits(view),
            "one unlit grey plate, its ground all round",
        ),
    }  # fmt: skip
    return FramePlan(
        **{name: value for name, (value, _) in choices.items()},  # type: ignore[arg-type]
        reasons={name: reason for name, (_, reason) in choices.items()},
    )


def _band_rows(width: int, height: int, lights: Sequence[Light] | None) -> int:
    """Rows at a time of ``height``; ``lights``: those of a view with shadows."""
    rows = max(MIN_ROWS, BAND_BYTES // (4 * width))
    if lights is not None:
        # shares of all lamps are in one binding, and tiles are looked at together
        casting = sum(lamp.light.shadows for lamp in lamps_of(lights))
        lamps = max(casting, LAMPS_AT_ONCE)
        whole = rows * LAMPS_AT_ONCE // lamps // MIN_ROWS_SHADOWED
        rows = max(whole, 1) * MIN_ROWS_SHADOWED
    return min(height, rows)
