"""Pictures of deformed bodies in the colours of a field, for reports.

Light is even: a colour is the legend's, whichever way a surface faces. Displacements are drawn a
round number of times, beside the edges of the undeformed bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.arrays.round_numbers import round_down
from gpusim.export.field_catalogue import Field
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.rendering.local_origin import local_view
from gpusim.surface import Skin
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface
from gpusim.visualization.color_scale import ColorScale, scale_of, value_text
from gpusim.visualization.field_colors import (
    corner_values,
    draw_field_colors,
    surface_field,
)
from gpusim.visualization.legend import draw_legend
from gpusim.visualization.mesh_edges import crease_edges, element_edges
from gpusim.visualization.overlay import INK, Overlay, pixels_of
from gpusim.visualization.placement import Placement
from gpusim.visualization.symbols import Symbols
from gpusim.visualization.turntable import Turntable

WIDTH, HEIGHTS = 1280, (440, 860)
"""Of a picture, px; as high as the bodies ask for."""
SIZE, EDGE = 26, 22
"""Of letters, and of the free border, px."""
TOP, RIGHT, BELOW = 54, 190, 104
"""Px that title, legend and scale take."""
FIELD_OF_VIEW = 0.2
"""rad: little perspective, so that the scale holds for all that is seen."""
SHOWN = 0.08
"""Of a body's size: how far its largest displacement is drawn, at least."""
SMALL = 0.02
"""Of the farthest value from zero: the largest or smallest that isn't worth a mark."""
SAMPLES = 2
"""Along a side of a pixel."""
PLACE = Placement(0.0, TOP)
"""Of the camera's picture in the whole."""
_MUTED, _GHOST, _CREASE = "#5b6876", "#5b6876b0", "#16202bc0"


def exaggeration(points: Float, length: Float) -> float:
    """How often displacements of these ``length`` (N,) are drawn on bodies with ``points`` (N, 3):
    a round number, 1 where they are large.

    Examples
    --------
    >>> from gpusim.visualization.body_picture import exaggeration
    >>> exaggeration(np.array([[0, 0, 0], [0.3, 0, 0]]), np.array([0.0, 1e-4]))
    200.0
    """
    size, most = float(np.linalg.norm(np.ptp(points, axis=0))), float(length.max(initial=0.0))
    return max(1.0, round_down(SHOWN * size / most)) if most > 0.0 and size > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class DisplacedBody:
    """A body by ``name``, its ``skin``, and the displacements ``u`` (N, 3) m of its nodes."""

    name: str
    skin: Skin
    u: Float

    @cached_property
    def rest(self) -> Surface:
        """Undeformed, without paint."""
        regions = np.zeros(len(self.skin.faces), np.int32)
        return self.skin.surface({"": Plain()}, regions, {}, self.name)

    def moved(self, factor: float) -> Surface:
        """With displacements ``factor`` times as large."""
        return self.skin.moved(self.rest, factor * self.u)


class Extreme(NamedTuple):
    """The largest or smallest value of a field, and the numbers of its body and node."""

    value: float
    body: int
    node: int


def extremes(field: Field, values: Sequence[Float]) -> dict[str, Extreme]:
    """The "largest" of a field's ``values`` (N,) at the nodes of bodies, and the "smallest" of a
    signed one; neither where it isn't of its sign, or is small beside the other."""
    found: dict[str, Extreme] = {}
    for word, sign in (("largest", 1.0), ("smallest", -1.0))[: 1 + field.signed]:
        # what isn't known is as little as nothing
        known = [np.where(np.isfinite(one), sign * one, 0.0) for one in values]
        body = max(range(len(known)), key=lambda k: float(known[k].max()))
        node = int(np.argmax(known[body]))
        if known[body][node] > 0.0:
            found[word] = Extreme(float(values[body][node]), body, node)
    far = max((abs(one.value) for one in found.values()), default=0.0)
    return {word: one for word, one in found.items() if abs(one.value) >= SMALL * far}


class BodyPictures:
    """Pictures of the same bodies, displaced ``factor`` times, from the side of a ``view``.

    The view is moved so that everything is seen.

    Examples
    --------
    >>> from gpusim.export.field_catalogue import BODY
    >>> from gpusim.visualization.body_picture import BodyPictures, DisplacedBody
    >>> from gpusim.visualization.turntable import Turntable
    >>> bar = gs.mesh.box(size=(0.3, 0.02, 0.02), divisions=(6, 1, 1))
    >>> u = np.stack([0 * bar.points[:, 0], 0 * bar.points[:, 0], bar.points[:, 0] ** 2], axis=1)
    >>> body = DisplacedBody("bar", gs.Skin(bar, gs.mesh.boundary_faces(bar)), u)
    >>> pictures = BodyPictures(gs.Device(), [body], Turntable())
    >>> pictures.draw(BODY["displacement_z"], [1e3 * u[:, 2]]).shape
    (860, 1280, 3)
    """

    def __init__(self, device: Device, bodies: Sequence[DisplacedBody], view: Turntable) -> None:
        self.device, self.bodies, self.overlay = device, bodies, Overlay(device)
        length = np.concatenate([np.linalg.norm(one.u, axis=1) for one in bodies])
        points = np.concatenate([one.rest.points for one in bodies])
        self.factor = exaggeration(points, length)
        self.surfaces = [one.moved(self.factor) for one in bodies]
        shown = np.concatenate([points, *(one.points for one in self.surfaces)])
        self.view, self.camera = _framed(replace(view, field_of_view=FIELD_OF_VIEW), shown)
        seen = local_view(self.surfaces, self.camera, lit=False)
        dark = np.zeros((self.camera.height, self.camera.width), np.float32)
        self.frame = Frame(seen, device, radiance=dark)

    def draw(self, field: Field, values: Sequence[Float]) -> npt.NDArray[np.uint8]:
        """(H, W, 3): the bodies in the colours of a field, its ``values`` (N,) at their nodes."""
        scale = scale_of(values, field.signed)
        fields = [
            surface_field(body.skin, one) for body, one in zip(self.bodies, values, strict=True)
        ]
        corners = corner_values(self.frame.view, self.surfaces, fields)
        overlay, (width, height) = self.overlay, self.size
        target = self.device.texture(width, height, "rgba8unorm", "view.field_picture")
        with self.device.recording("view.field_picture") as recording:
            overlay.rectangle(0, 0, width, height, "white")
            overlay.draw(target, recording)
            draw_field_colors(
                self.device, target, self.frame, corners, scale.limits, scale.colors, white=1.0,
                recording=recording, place=PLACE, samples=SAMPLES, shade=1.0,
            )  # fmt: skip
            overlay.add(self._lines)
            self._draw_frame(overlay, field, scale)
            self._mark_extremes(overlay, field, values)
            overlay.draw(target, recording)
        return pixels_of(self.device, target)[..., :3].copy()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, px."""
        return self.camera.width, self.camera.height + TOP

    @cached_property
    def _lines(self) -> npt.NDArray[np.void]:
        """Borders of elements, edges, and those of the undeformed bodies: alike for all fields."""
        symbols, eye = self._symbols(Overlay(self.device)), self.camera.eye
        for body, surface in zip(self.bodies, self.surfaces, strict=True):
            if body.u.any():
                symbols.lines(crease_edges(body.rest, eye=eye), _GHOST, 1.2, pale=0.35)
            symbols.elements(element_edges(surface, body.skin), "#00000048")
            symbols.lines(crease_edges(surface, eye=eye), _CREASE, 1.6)
        return symbols.overlay.quads()

    def _symbols(self, overlay: Overlay) -> Symbols:
        return Symbols(overlay, self.camera, PLACE, self.frame)

    def _draw_frame(self, overlay: Overlay, field: Field, scale: ColorScale) -> None:
        """Title, legend, scale, axes, and how often displacements are drawn."""
        width, height = self.size
        overlay.text(EDGE, EDGE, field.label(), SIZE + 2, INK)
        tall = min(height - TOP - BELOW, 420.0)
        draw_legend(overlay, scale, field.unit, width - EDGE, TOP, tall, SIZE)
        Symbols(overlay, self.camera).tripod(EDGE + 46.0, height - 52.0, 36.0)
        unit = 2.0 * self.view.distance * np.tan(0.5 * FIELD_OF_VIEW) / self.camera.height
        length = round_down(0.2 * width * unit)
        left, low, bar = 150.0, height - 38.0, length / unit
        overlay.rectangle(left, low, round(bar), 4, INK)
        for end in (left, left + round(bar) - 2):
            overlay.rectangle(end, low - 6, 2, 10, INK)
        overlay.text(left + 0.5 * bar, low - 12, f"{1e3 * length:g} mm", SIZE, INK, "ms")
        text = "not loaded" if not any(one.u.any() for one in self.bodies) else (
            f"displacements drawn {self.factor:g} times, thin lines: undeformed"
            if self.factor != 1.0 else "displacements as they are, thin lines: undeformed"
        )  # fmt: skip
        overlay.text(left + bar + 34.0, low + 4, text, SIZE - 2, _MUTED, "ls")

    def _mark_extremes(self, overlay: Overlay, field: Field, values: Sequence[Float]) -> None:
        """A ring round the largest value, and round the smallest where there are both signs."""
        marks = []
        for word, one in extremes(field, values).items():
            body = self.bodies[one.body]
            place = body.skin.mesh.points[one.node] + self.factor * body.u[one.node]
            marks.append((f"{word} {value_text(one.value, field.unit)}", place))
        width, height = self.size
        free = np.array([[0.0, TOP], [width - RIGHT + EDGE, height - BELOW + 2 * EDGE]])
        self._symbols(overlay).rings(marks, SIZE, free)


def _framed(view: Turntable, points: Float) -> tuple[Turntable, Camera]:
    """The view with all ``points`` (n, 3) in it beside what is written, and its camera: no higher
    than the points ask for."""
    low, high = (bound - TOP for bound in HEIGHTS)
    fitted = view.fit(points, WIDTH, high, (RIGHT, BELOW))
    across = np.ptp(fitted.camera(WIDTH, high).project(points), axis=0)
    wide = WIDTH - RIGHT - 2 * EDGE
    tall = float(across[1]) * wide / max(float(across[0]), 1.0)
    height = round(min(max(tall / 0.9 + BELOW, low), high))
    fitted = view.fit(points, WIDTH, height, (RIGHT, BELOW))
    return fitted, fitted.camera(WIDTH, height)
