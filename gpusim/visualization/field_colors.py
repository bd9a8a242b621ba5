"""A rendered picture coloured by a field: values of a body's nodes or elements at every pixel.

The triangles that the picture was made of are drawn again in the colours of their values, which are
interpolated as perspective has it, with more samples a pixel where borders should be smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single
from gpusim.arrays.srgb import decoded, encoded
from gpusim.gpu import Buffer, Device, Recording, Texture
from gpusim.optics.frame import Frame
from gpusim.optics.geometry.triangle_corners import REFERENCE
from gpusim.optics.geometry.view import FIXED, View
from gpusim.optics.visibility_buffer import VertexBuffers
from gpusim.surface import Skin
from gpusim.surface.surface import Surface
from gpusim.validation import require
from gpusim.visualization.placement import Placement

NONE = -1e30
"""The value of corners that have none."""
SHADE = 0.35
"""What is left of a colour where the surface is black."""


@dataclass(frozen=True, eq=False)
class SurfaceField:
    """Values on a surface: of its vertices (P,), or ``by_face`` of its faces (F,)."""

    values: Float
    by_face: bool = False


def surface_field(skin: Skin, values: Float, by_cell: bool = False) -> SurfaceField:
    """Values of a body's nodes, or elements, on its surface."""
    if by_cell:
        return SurfaceField(values[skin.cell_of_piece], by_face=True)
    return SurfaceField(skin.at_vertices(values))


def corner_values(
    view: View, surfaces: Sequence[Surface], fields: Sequence[SurfaceField | None]
) -> Float:
    """(T, 3) values at the corners of a view's triangles, NaN on surfaces that have no field.

    ``surfaces``: those that the view was made of, in order; ``fields``: of the first ones.
    """
    result = np.full((view.count, 3), np.nan)
    first = 0
    for number, (surface, field) in enumerate(zip(surfaces, fields, strict=False)):
        topology = surface.topology
        start, stop = np.searchsorted(view.body, [number, number + 1])
        own = slice(int(start), int(stop))
        triangle = view.source[own] - first
        first += len(topology.triangles)
        if field is None:
            continue
        shape, count = field.values.shape, len(surface.faces if field.by_face else surface.rest)
        what = f"field on surface {surface.name!r}"
        require(shape == (count,), what, f"shape {shape}", f"({count},)")
        if field.by_face:
            result[own] = field.values[topology.source[triangle]][:, None]
            continue
        vertices = topology.triangles[triangle]
        shares = barycentric(view.corners_of(own, REFERENCE), surface.rest[vertices])
        result[own] = np.einsum("nck,nk->nc", shares, field.values[vertices])
    return result


def barycentric(points: Float, corners: Float) -> Float:
    """(n, c, 3) of points (n, c, 3) in the planes of triangles (n, 3, 3): the corners' weights."""
    e, f = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d = points - corners[:, :1]
    ee, ef, ff = ((a * b).sum(axis=1)[:, None] for a, b in ((e, e), (e, f), (f, f)))
    de, df = ((d * a[:, None]).sum(axis=2) for a in (e, f))
    area = ee * ff - ef * ef
    second, third = (ff * de - ef * df) / area, (ee * df - ef * de) / area
    return np.stack([1.0 - second - third, second, third], axis=2)


def finer(view: View, samples: int) -> View:
    """The view for a camera with as many pixels along each of its own; triangles are the same."""
    if samples == 1:
        return view
    # its distortion is the same in (x, y), which the triangles have been through already
    ideal = view.camera.without_distortion()
    width, height = samples * ideal.width, samples * ideal.height
    camera = ideal.reframed(width, height, scale=(samples, samples))
    return replace(view, camera=camera, place=samples * (view.place + 0.5) - 0.5)


def draw_field_colors(
    device: Device,
    target: Any,
    frame: Frame,
    values: Float,
    limits: tuple[float, float],
    colors: npt.NDArray[Any],
    *,
    white: float,
    recording: Recording,
    place: Placement | None = None,
    samples: int = 1,
    shade: float = SHADE,
    opacity: float = 1.0,
) -> None:
    """Draw the colours of ``values`` over ``target``, on which the picture of ``frame`` is.

    Parameters
    ----------
    target : a `gpusim.gpu.Texture`, or a `gpusim.visualization.overlay.Target`.
    values : (T, 3), as `corner_values` gives them for ``frame.view``.
    limits : values that the first and the last colour stand for; others have these, too.
    colors : (C, 3) from 0 to 1 as sRGB has them, C at least 2; (C, 4) with an opacity.
    white : the radiance that the picture shows as white.
    recording : takes what is drawn, to be submitted with what comes before.
    place : where the picture lies on the target; None: pixel for pixel.
    samples : along a side of a pixel; 1 while things move, 2 or 3 for smooth borders. One that
        makes the image larger than a texture may be is lowered.
    shade : what is left of a colour on a black surface; 1: the radiance isn't looked at.

    Examples
    --------
    >>> from gpusim.visualization.field_colors import SurfaceField, corner_values, draw_field_colors
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> device = gs.Device()
    >>> frame = gs.render([wall], camera, device=device)
    >>> height = SurfaceField(wall.points[:, 1])
    >>> values = corner_values(frame.view, [wall], [height])
    >>> target = device.texture(60, 40, "rgba8unorm", "window")
    >>> black_to_white = np.array([[0, 0, 0], [1, 1, 1.0]])
    >>> with device.recording("view") as recording:
    ...     draw_field_colors(
    ...         device, target, frame, values, (-1.0, 1.0), black_to_white, white=1.0,
    ...         recording=recording,
    ...     )
    """
    shape = frame.view.count, 3
    require(values.shape == shape, "field values", f"shape {values.shape}", f"{shape}")
    shown = _box_of(frame.view, values)
    if shown is None:
        return
    largest = device.limits["max-texture-dimension-2d"]
    samples = max(1, min(samples, largest // max(frame.width, frame.height)))
    place = place or Placement()
    low, high = np.clip(place.window(shown), 0.0, [target.width, target.height])
    radiance, stride = _radiance(device, frame)
    raster = device.raster(
        "visualization/field_colors", (target.format,), depth="over",
        entries=("vertex_over", "fragment_over"),
    )  # fmt: skip
    placing = {
        "size": (target.width, target.height), "low": np.floor(low), "high": np.ceil(high),
        "origin": (place.x, place.y), "scale": place.scale, "samples": samples,
        "width": frame.width, "height": frame.height, "stride": stride, "white": white,
        "shade": shade, "opacity": opacity,
        "encode": int(not target.format.endswith("-srgb")),
    }  # fmt: skip
    view, relative = finer(frame.view, samples), _relative(values, limits)
    layer = _layer(device, view, relative, colors, recording)
    bindings = raster.bind(placing=placing, layer=layer, radiance=radiance)
    recording.draw(
        raster, bindings, colors=(target,), depth=None, vertices=6,
        size=(target.width, target.height), clear=None,
    )  # fmt: skip


def _layer(
    device: Device,
    view: View,
    values: Single,
    colors: npt.NDArray[Any],
    recording: Recording,
) -> Texture:
    """A view's triangles in the colours of ``values`` (3 T,), others as nothing."""
    width, height = view.camera.width, view.camera.height
    layer = device.target(width, height, "rgba8unorm-srgb", "view.field")
    depth = device.target(width, height, "depth32float", "view.depth")
    raster = device.raster("visualization/field_colors", (layer.format,))
    buffers = VertexBuffers(device, view, "view")
    bindings = raster.bind(
        params={"width": width, "height": height, "near": buffers.near}, **buffers.bindings(),
        values=device.buffer(values, "view.values"),
        colors=device.buffer(_table(colors), "view.colors"),
    )  # fmt: skip
    recording.draw(
        raster, bindings, colors=(layer,), depth=depth, vertices=3 * view.count,
        size=(width, height),
    )  # fmt: skip
    return layer


def _box_of(view: View, values: Float) -> Float | None:
    """(2, 2): first and last place, px, of the triangles that have values; None if none has."""
    own = np.isfinite(values).all(axis=1)
    if not own.any():
        return None
    low, high = view.box
    return np.stack([low[own].min(axis=0) - 1.0, high[own].max(axis=0) + 1.0])


def _radiance(device: Device, frame: Frame) -> tuple[Buffer, int]:
    """A frame's grey or green radiance on the device, and its floats in a row."""
    plane = frame.planes[len(frame.planes) // 2]
    if plane.device is device and len(plane.bands) == 1:
        return plane.bands[0].buffer, plane.bands[0].stride
    return device.buffer(plane.radiance, "view.radiance"), plane.width


def _relative(values: Float, limits: tuple[float, float]) -> Single:
    low, high = limits
    require(high > low, "field limits", f"{low:g} to {high:g}", "growing numbers")
    result = ((values - low) / (high - low)).astype(np.float32).reshape(-1)
    result[~np.isfinite(result)] = NONE
    return result if len(result) else np.full(3, NONE, np.float32)


def _table(colors: npt.NDArray[Any]) -> Single:
    """(C, 4) linear colours, and their opacity."""
    colors = np.asarray(colors, np.float64)
    table = np.ones((len(colors), 4), np.float32)
    table[:, : colors.shape[1]] = colors
    table[:, :3] = decoded(colors[:, :3])
    return table


def interpolated(view: View, ids: npt.NDArray[np.uint32], values: Float) -> Float:
    """(H, W) values at the pixels' centres from those at corners (T, 3); NaN where there are none.

    Places are rounded as for the device; the arithmetic is float64.
    """
    result = np.full(ids.shape, np.nan)
    row, column = np.nonzero(ids)
    triangle = ids[row, column].astype(np.int64) - 1
    at = view.fixed()[view.corner[triangle]] / FIXED - np.stack([column, row], axis=1)[:, None]
    x, y = at[:, :, 0], at[:, :, 1]
    ahead, after = [1, 2, 0], [2, 0, 1]
    part = x[:, ahead] * y[:, after] - y[:, ahead] * x[:, after]
    turn = np.where(part.sum(axis=1) > 0.0, 1.0, -1.0)[:, None]
    w = np.maximum(turn * part, 1e-9) / view.vertices[view.corner[triangle], 2]
    result[row, column] = (w * values[triangle]).sum(axis=1) / w.sum(axis=1)
    return result


def field_colors_twin(
    picture: Single, frame: Frame, ids: npt.NDArray[np.uint32], values: Float,
    limits: tuple[float, float], colors: npt.NDArray[Any], *, white: float, samples: int,
    shade: float = SHADE,
) -> Single:  # fmt: skip
    """What `draw_field_colors` makes of a picture (H, W, 4) without sRGB's curve, pixel for pixel.

    ``ids`` (H s, W s): of the `finer` view.
    """
    table, height, width = _table(colors), *picture.shape[:2]
    fine = interpolated(finer(frame.view, samples), ids, values)
    some = np.isfinite(fine)
    at = np.clip((np.where(some, fine, 0.0) - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    at *= len(table) - 1
    i = np.minimum(at.astype(int), len(table) - 2)
    color = table[i] + (at - i)[..., None] * (table[i + 1] - table[i])
    blocks = (height, samples, width, samples)
    alpha = color[..., 3] * some
    color = (color[..., :3] * alpha[..., None]).reshape(*blocks, 3).sum(axis=(1, 3))
    count = alpha.reshape(blocks).sum(axis=(1, 3))
    color /= np.where(count > 0.0, count, 1.0)[..., None]
    plane = frame.planes[len(frame.planes) // 2].radiance
    light = shade + (1.0 - shade) * np.sqrt(np.clip(plane / white, 0.0, 1.0))
    color *= light[..., None]
    shown = encoded(color)
    share = (count / samples**2)[..., None]
    result = share * np.concatenate([shown, np.ones_like(share)], axis=2) + (1.0 - share) * picture
    shown32: Single = result.astype(np.float32)
    return shown32
