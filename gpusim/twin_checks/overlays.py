"""What the preview window draws over its picture, against NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.gpu import Device, Pair, Pairs, Tolerance, twin_check
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.view import look
from gpusim.optics.rendering.renderer import render
from gpusim.optics.visibility_buffer import VisibilityBuffer
from gpusim.twin_checks.scenes import shadow_scene
from gpusim.view.picture.display import (
    display_twin,
    draw_enlarged,
    draw_frame,
    enlarged_twin,
)
from gpusim.visualization.field_colors import (
    SurfaceField,
    corner_values,
    draw_field_colors,
    field_colors_twin,
    finer,
)
from gpusim.visualization.overlay import Overlay, overlay_twin, pixels_of
from gpusim.visualization.placement import Placement

STEP = 1.0 / 255.0
"""Of a target of 8 bits."""


@twin_check(
    "visualization/overlay", Tolerance(2.5 * STEP, 0.0, "rounded once by every quad over a pixel")
)
def check_overlay(device: Device) -> Pairs:
    """Quads of every kind, some over others and over the border."""
    target = device.texture(97, 61, "rgba8unorm", "twin.overlay")
    overlay = Overlay(device)
    overlay.rectangle(-3.0, 5.0, 52.0, 41.0, "#2080c0")
    overlay.polygon([(60.3, 4.2), (90.1, 20.7), (55.5, 33.3)], "#c0a080d0")
    overlay.polygon([(20.0, 30.5), (66.0, 28.0), (99.0, 58.0), (12.0, 64.0)], "#00ff0060")
    overlay.line([(3.0, 3.0), (44.0, 52.0), (95.0, 41.0)], (1.0, 0.5, 0.1), 2.5)
    overlay.text(50.0, 25.0, "Ag µ\n→ é漢", 14, "#ffffff", anchor="mm", halo="#000000c0")
    quads = overlay.quads()
    with device.recording("twin.overlay") as recording:
        overlay.draw(target, recording)
    empty = np.zeros((61, 97, 4), np.float32)
    twin = overlay_twin(empty, quads, overlay.atlas.coverage)
    yield Pair(pixels_of(device, target) * STEP, twin)


@twin_check(
    "visualization/field_colors",
    Tolerance(2.1 * STEP, 0.0, "mean of four samples and their opacity, 8 bits each, to 8 bits"),
)
def check_field_colors(device: Device) -> Pairs:
    """Fields of vertices and of faces, on some of the surfaces that are seen."""
    surfaces, camera, _ = shadow_scene()
    frame = render(surfaces, camera, device=device)
    fields = [
        SurfaceField(surfaces[0].points[:, 0] - 0.4 * surfaces[0].points[:, 1]),
        None,
        SurfaceField(np.linspace(-1.4, 1.0, len(surfaces[2].faces)), by_face=True),
    ]
    values = corner_values(frame.view, surfaces, fields)
    colors = np.array([[0.1, 0.0, 0.6, 1.0], [0.2, 0.8, 0.1, 1.0], [0.9, 0.9, 0.3, 0.0],
                       [0.8, 0.0, 0.1, 0.6]])  # fmt: skip
    target = device.texture(camera.width, camera.height, "rgba8unorm", "twin.field")
    options: dict[str, Any] = {"white": 0.8, "samples": 2}
    coloring = frame, values, (-1.2, 1.2), colors
    with device.recording("twin.field") as recording:
        draw_field_colors(device, target, *coloring, recording=recording, **options)
    ids = VisibilityBuffer.of(device, finer(frame.view, 2), 2 * camera.height).read()
    empty = np.zeros((camera.height, camera.width, 4), np.float32)
    twin = field_colors_twin(empty, frame, ids, values, (-1.2, 1.2), colors, **options)
    yield Pair(pixels_of(device, target) * STEP, twin)


@twin_check("view/picture/display", Tolerance(0.51 * STEP, 0.0, "rounded once"))
def check_display(device: Device) -> Pairs:
    """A grey and a coloured picture in two bands, pixel for pixel, the latter in grey, too."""
    target = device.texture(61, 37, "rgba8unorm", "twin.display")
    grey, coloured = _grey_and_coloured(device)
    weights = (0.2, 0.5, 0.3)
    for (frame, radiance), mixed in ((grey, None), (coloured, None), (coloured, weights)):
        with device.recording("twin.display") as recording:
            draw_frame(device, recording, target, 3, 2, frame, 1.2, weights=mixed)
        wanted = np.pad(display_twin(radiance, 1.2, mixed), ((2, 21), (3, 35), (0, 0)))
        yield Pair(pixels_of(device, target)[..., :3] * STEP, wanted)


@twin_check(
    "view/picture/enlarge",
    Tolerance(2.1 * STEP, 0.0, "rounded twice, and weights have 8 bits on devices"),
)
def check_enlarge(device: Device) -> Pairs:
    """The same, larger."""
    target = device.texture(61, 37, "rgba8unorm", "twin.enlarge")
    for frame, radiance in _grey_and_coloured(device):
        with device.recording("twin.enlarge") as recording:
            draw_enlarged(device, recording, target, Placement(scale=2.6), frame, 1.2)
        wanted = enlarged_twin(display_twin(radiance, 1.2), 61, 37, 2.6)
        yield Pair(pixels_of(device, target)[..., :3] * STEP, wanted)


def _grey_and_coloured(device: Device) -> list[tuple[Frame, Float]]:
    """Pictures of noise in two bands, on the device and here."""
    random = np.random.default_rng(3)
    surfaces, camera, _ = shadow_scene()
    view = look(surfaces, replace(camera, width=23, height=14), lit=False)
    planes = [random.random((14, 23)) for _ in range(3)]
    frames = [Frame(view, device, _bands(device, plane, (9, 5))) for plane in planes]
    return [(frames[0], planes[0]), (Frame.of_planes(frames), np.dstack(planes))]


def _bands(device: Device, radiance: Float, parts: Sequence[int]) -> tuple[Band, ...]:
    """A picture (H, W) in bands of so many rows."""
    bands, row0 = [], 0
    for rows in parts:
        own = np.zeros((rows, 64), np.float32)
        own[:, : radiance.shape[1]] = radiance[row0 : row0 + rows]
        bands.append(Band(row0, rows, 64, (device.buffer(own, "twin.band"),)))
        row0 += rows
    return tuple(bands)
