"""Rendering one frame: view, visibility, interior shading, edge pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import UnionType

import numpy as np

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, working_device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.plate_border import Border
from gpusim.optics.edge_pixels.resolve import EdgePixelPass, edges_twin
from gpusim.optics.edge_pixels.scatter import write_pixels
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.face_winding import wound_inwards
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import Light, is_light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.raster.compute_raster import VisibilityBuffer
from gpusim.optics.raster.id_buffer import visibility_twin
from gpusim.optics.rendering.background import BackgroundTasks
from gpusim.optics.rendering.local_origin import local, seen_from_origin
from gpusim.optics.shading.deferred_pass import small_triangles
from gpusim.optics.shading.forward_pass import ShadingPass, shade_twin
from gpusim.optics.shading.lighting import casts_shadows, find_shadows
from gpusim.optics.shading.relighting import RelightingPass
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.single_layer import without_shadows
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.surface.surface import Surface
from gpusim.validation import checked

__all__ = ["render"]

BAND_BYTES = 1 << 25
WIDEST = 8192
MOST_TRIANGLES = 4_000_000
"""Triangles set up at once: their records fill most of a portable texture (2^25 texels)."""

FEWEST_ROWS = 16
WHOLE_ROWS = 32
FEWEST_LAMPS = 4
FINEST_ERROR = 0.25


@checked
@one_blas_thread()
def render(
    surfaces: Sequence[Surface],
    camera: Camera,
    lights: Sequence[Light] | None = None,
    *,
    error: float = FINEST_ERROR,
    background: float = 0.0,
    device: Device | None = None,
    backend: str = "auto",
) -> Frame:
    """Render ``surfaces`` as ``camera`` sees them.

    Parameters
    ----------
    lights : None shows each paint's albedo as radiance, the form in which geometry is verified;
        otherwise the lights' reflection, with the shadows of all ``surfaces``.
    error : largest error wanted, in grey levels of 8 bit (RMS); the closed forms reach 0.25, so
        smaller values are refused.
    background : radiance where no surface is.
    backend : ``"auto"``: on the device where an adapter is found, else by the NumPy twins, with one
        warning; ``"gpu"``: on a device or not at all; ``"numpy"``: the float64 twins.
    device : the device to take; None: the process-wide one.

    Returns
    -------
    Frame
        Each pixel is the mean radiance over its square: paint patterns and edges are integrated
        in closed form, light varies smoothly and is taken at the centre. Its ``warnings`` name
        closed surfaces whose faces are wound inwards.

    Raises
    ------
    InputError, NoAdapter, OutOfDeviceMemory

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> float(gs.render([wall], camera).radiance.max())
    0.5
    """
    if not _all_are(Surface, surfaces) or not surfaces:
        raise InputError(f"render surfaces; got {surfaces!r}; expected a list of Surface")
    if not isinstance(camera, Camera):
        raise InputError(f"render camera; got {camera!r}; expected a Camera")
    if lights is not None and not (
        isinstance(lights, Sequence) and all(is_light(light) for light in lights)
    ):
        raise InputError(f"render lights; got {lights!r}; expected a list of lights, or None")
    if not (np.isfinite(error) and error >= FINEST_ERROR):
        raise InputError(f"render error; got {error}; expected at least {FINEST_ERROR} grey levels")
    if not (np.isfinite(background) and background >= 0.0):
        raise InputError(f"render background; got {background}; expected a radiance from 0 up")
    for name, size in (("width", camera.width), ("height", camera.height)):
        if size > WIDEST:
            raise InputError(f"render: image {name}; got {size}; expected at most {WIDEST} px")
    device = working_device("render", backend, device)
    surfaces, camera, lights, origin = local(surfaces, camera, lights)
    lights = None if lights is None else without_shadows(surfaces, lights, camera.eye)
    if device is None:
        view = look(surfaces, camera, lit=lights is not None)
        setup = Setup.build(view, lights, background, surfaces)
        interior = shade_twin(setup, visibility_twin(view))
        radiance = edges_twin(setup, find_edge_pixels(view), interior)
        frame = Frame(seen_from_origin(view, origin), None, radiance=radiance)
    else:
        view, bands = _seen(device, surfaces, camera, lights, background)
        frame = Frame(seen_from_origin(view, origin), device, tuple(bands))
    frame.warnings = wound_inwards(surfaces, camera)
    return frame


def _seen(
    device: Device,
    surfaces: Sequence[Surface],
    camera: Camera,
    lights: Sequence[Light] | None,
    background: float,
) -> tuple[View, list[Band]]:
    """What a camera sees, and the device's picture of it."""
    view = look(surfaces, camera, lights is not None)
    bands: list[Band] = []
    for first, stop, part in _parts(view, 0, camera.height):
        bands += _draw(device, part, lights, background, surfaces, first, stop)
    return view, bands


def _parts(view: View, first: int, stop: int) -> Iterator[tuple[int, int, View]]:
    """Rows of the image with no more triangles over them than one binding holds."""
    part = view if stop - first == view.camera.height else view.over_rows(first, stop)
    if part.count <= MOST_TRIANGLES or stop - first <= FEWEST_ROWS:
        yield first, stop, part
        return
    middle = (first + stop) // 2
    yield from _parts(view, first, middle)
    yield from _parts(view, middle, stop)


def _band_rows(camera: Camera, first: int, stop: int, lights: Sequence[Light] | None = None) -> int:
    """Rows at a time of ``first`` … ``stop - 1``, lit by ``lights``."""
    rows = max(16, BAND_BYTES // (4 * camera.width))
    if casts_shadows(lights or []):
        # shares of all lamps are in one binding, and tiles are looked at together
        lamps = max(len(lamps_of(lights or [])), FEWEST_LAMPS)
        rows = max(rows * FEWEST_LAMPS // lamps // WHOLE_ROWS, 1) * WHOLE_ROWS
    return min(stop - first, rows)


def _draw(
    device: Device,
    view: View,
    lights: Sequence[Light] | None,
    background: float,
    surfaces: Sequence[Surface],
    first: int,
    stop: int,
) -> list[Band]:
    """Rows ``first`` … ``stop - 1`` in bands of what a texture may hold.

    The device begins with what is ready, while the host works on what comes next.
    """
    rows = _band_rows(view.camera, first, stop, lights)
    shadowed = casts_shadows(lights or [])
    visibility: VisibilityBuffer | None = None
    if small_triangles(view):
        visibility = VisibilityBuffer(device, view, rows)
        visibility.begin(first, rows)
    shade_pass: ShadingPass | None = None
    begun: Buffer | None = None
    # one thread beside this one: more would wait for the interpreter
    with BackgroundTasks(view.count) as aside:
        simple = lights is None and Border.suits(view)
        found = None if simple else aside.begin(find_edge_pixels, view)
        setup = Setup.build(view, lights, background, surfaces, device, False)
        buffers = SceneBuffers(device, setup, visibility)
        # what hides lamps is looked for once the device knows which pixels ask; and the first of
        # several bands needn't wait for the edges either
        if shadowed or rows < stop - first:
            shade_pass = ShadingPass(buffers, rows, visibility is not None, visibility, shadowed)
            begun = device.pool.take(4 * rows * shade_pass.stride, f"radiance[{first}]")
            with device.recording("optics.shade") as recording:
                shade_pass.record(recording, begun, first, rows)
        if shadowed:
            buffers = buffers.with_shadows(find_shadows(view, lights or [], surfaces, device))
        edge_pass = None if found is None else EdgePixelPass(buffers, found())
    if edge_pass is not None:
        edge_pass.begin()
    shade_pass = shade_pass or ShadingPass(buffers, rows, visibility is not None, visibility)
    bands = _bands(buffers, shade_pass, edge_pass, range(first, stop, rows), stop, begun)
    if visibility is not None:
        visibility.release()
    return bands


def _bands(
    buffers: SceneBuffers,
    shade_pass: ShadingPass,
    edge_pass: EdgePixelPass | None,
    starts: range,
    stop: int,
    begun: Buffer | None,
) -> list[Band]:
    """Bands of rows from ``starts`` on, up to ``stop``, edges and shadows and all; ``begun``: the
    first band, where it has been shaded."""
    device, setup, stride = buffers.device, buffers.setup, shade_pass.stride
    relit = None
    if setup.lighting.shadows is not None:
        relit = RelightingPass(buffers, shade_pass, min(starts.step, stop - starts.start))
    bands: list[Band] = []
    for row0 in starts:
        count = min(starts.step, stop - row0)
        if relit is not None:
            relit.finish()
        radiance = begun or device.pool.take(4 * count * stride, f"radiance[{row0}]")
        with device.recording("optics.shade") as recording:
            if begun is None:
                shade_pass.record(recording, radiance, row0, count)
            begun = None
            if not bands and edge_pass is not None:
                # before anything else is submitted that one would wait for as well
                edge_pass.fetch()
        if relit is not None:
            relit.record(radiance, row0, count)
        bands.append(Band(row0, count, stride, radiance))
    if edge_pass is None:
        border = Border.of(setup.view, setup.background)
        value = border.value.astype(np.float32)
        write_pixels(device, bands, setup.view.camera.width, border.pixel, value)
        return bands
    # while the device looks for what hides lamps from other pixels
    edge_pass.resolve()
    if relit is not None:
        relit.finish()
    edge_pass.write(bands)
    return bands


def _all_are(kind: type | UnionType, values: object) -> bool:
    return isinstance(values, Sequence) and all(isinstance(value, kind) for value in values)
