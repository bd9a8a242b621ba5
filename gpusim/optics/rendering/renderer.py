"""Rendering one frame: view, visibility, interior shading, edge pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import UnionType

import numpy as np

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, working_device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.edge_pixels.border import Border
from gpusim.optics.edge_pixels.fragment_lists import bin_edges
from gpusim.optics.edge_pixels.resolve import EdgePass, edges_twin
from gpusim.optics.edge_pixels.scatter import write_pixels
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.face_winding import wound_inwards
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import Light, is_light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.raster.id_buffer import visibility_twin
from gpusim.optics.rendering.background import Aside
from gpusim.optics.rendering.local_origin import local, told_from
from gpusim.optics.series.late import LateSight
from gpusim.optics.series.speckled_layer import likely_speckled
from gpusim.optics.shading.deferred_pass import small_triangles
from gpusim.optics.shading.forward_pass import ShadePass, shade_twin
from gpusim.optics.shading.glance import fields_glanced, may_glance
from gpusim.optics.shading.lighting import casts_shadows, find_shadows
from gpusim.optics.shading.looks import sampled
from gpusim.optics.shading.relighting import RelitPass
from gpusim.optics.shading.scene_buffers import Tables
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.speckled import may_be_speckled
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
        radiance = edges_twin(setup, bin_edges(view), interior)
        frame = Frame(told_from(view, origin), None, radiance=radiance)
    else:
        view, bands = _seen(device, surfaces, camera, lights, background)
        frame = Frame(told_from(view, origin), device, tuple(bands))
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
    height = camera.height
    late = LateSight.of(device, surfaces, camera, lights, _band_rows(camera, 0, height, lights))
    if late is not None:
        found = _draw(device, late.view, lights, background, surfaces, 0, height, late)
        if found is not None:
            return late.view, found
        late.resident.distrust()
    begun: list[Sight] = []

    def begin(view: View) -> None:
        if view.count <= MOST_TRIANGLES and _by_pixel(device, view, lights):
            # in a layer triangles write their own pixels once it is known what they look like
            wait = view.layer and may_glance(view, lights)
            begun.append(_begun(device, view, lights, 0, height, wait))

    view = look(surfaces, camera, lights is not None, begin)
    sight = begun[0] if begun else None
    if sight is not None:
        sight.complete(view)
    bands: list[Band] = []
    for first, stop, part in _parts(view, 0, height):
        bands += _draw(device, part, lights, background, surfaces, first, stop, sight) or []
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


def _by_pixel(device: Device, view: View, lights: Sequence[Light] | None) -> bool:
    """Whether it is worth while to find first which triangle each pixel sees."""
    return small_triangles(view) or (device.atomics64 and may_glance(view, lights))


def _likely(view: View, lights: Sequence[Light] | None, sight: Sight | None) -> View | None:
    """The view with the largest pixel guessed, where the device finds what its triangles look
    like."""
    if sight is None or sight.nearest is None:
        return None
    if sight.late and may_be_speckled(view, lights):
        return likely_speckled(view, lights)
    return sampled(view) if may_glance(view, lights) else None


def _begun(
    device: Device,
    view: View,
    lights: Sequence[Light] | None,
    first: int,
    stop: int,
    wait: bool = False,
) -> Sight:
    """Who sees what, of which the device finds the first band already unless it is to ``wait``."""
    rows = _band_rows(view.camera, first, stop, lights)
    sight = Sight(device, view, rows)
    if not wait:
        sight.begin(first, rows)
    return sight


def _draw(
    device: Device,
    view: View,
    lights: Sequence[Light] | None,
    background: float,
    surfaces: Sequence[Surface],
    first: int,
    stop: int,
    sight: Sight | None,
    guess: bool = True,
) -> list[Band] | None:
    """Rows ``first`` … ``stop - 1`` in bands of what a texture may hold.

    The device begins with what is ready, while the host works on what comes next. ``sight``: what
    it has begun with before, of these rows. ``guess``: the largest pixel may be guessed. None where
    the host has to look at all of a view that the device was to look at.
    """

    def certain() -> list[Band] | None:
        if sight is not None and sight.late:
            sight.release()
            return None
        return _draw(device, view, lights, background, surfaces, first, stop, sight, guess=False)

    rows = _band_rows(view.camera, first, stop, lights)
    shadowed = casts_shadows(lights or [])
    if sight is None and _by_pixel(device, view, lights):
        sight = _begun(device, view, lights, first, stop)
    # edges that the host is done with while the device shades
    simple = lights is None and Border.suits(view)
    edge_pass: EdgePass | None = None
    shade_pass: ShadePass | None = None
    begun: Buffer | None = None
    shaded = False
    # one thread beside this one: more would wait for the interpreter
    with Aside(view.count) as aside:
        # what the host does before the device begins there isn't worth to be held up by a thread
        waiting = sight is not None and sight.late
        found = None if simple or waiting else aside.begin(bin_edges, view)
        likely = _likely(view, lights, sight) if guess else None
        if likely is None and sight is not None and sight.late:
            return certain()
        try:
            setup = Setup.build(likely or view, lights, background, surfaces, device, False)
        except InputError:
            if likely is None:
                raise
            # maybe of what was guessed alone
            return certain()
        rastered = likely is None and not small_triangles(view)
        if sight is not None and rastered and fields_glanced(setup, sight) is None:
            sight.release()
            sight = None
        if sight is not None and likely is None and guess:
            sight.begin_late(first, rows)
        tables = Tables(device, setup, sight)
        speckled = likely is not None and may_be_speckled(likely, lights)
        if likely is not None and (not tables.glancing or tables.speckled != speckled):
            # without records nothing would tell whether the guess was right; and where light is
            # uneven speckle is shaded in a way that doesn't look at the triangles either
            return certain()
        # what hides lamps is looked for once the device knows which pixels ask; and the first of
        # several bands needn't wait for the edges either
        if shadowed or tables.glancing or rows < stop - first:
            shade_pass, begun, shaded = _begun_band(tables, sight, first, rows, shadowed)
        if shadowed:
            tables = tables.with_shadows(find_shadows(view, lights or [], surfaces, device))
        edges = bin_edges(view) if waiting else None if found is None else found()
        if edges is not None:
            edge_pass = EdgePass(tables, edges)
    if edge_pass is not None:
        edge_pass.begin()
    shade_pass = shade_pass or ShadePass(tables, rows, sight is not None, sight)
    bands = _bands(tables, shade_pass, edge_pass, range(first, stop, rows), stop, begun, shaded)
    if bands is None:
        return certain()
    if sight is not None:
        sight.release()
    return bands


def _begun_band(
    tables: Tables, sight: Sight | None, first: int, rows: int, shadowed: bool
) -> tuple[ShadePass, Buffer, bool]:
    """What the device shades bands by, and the first one, with which it begins: by all lamps;
    whether that is all of it."""
    shade_pass = ShadePass(tables, rows, sight is not None, sight, shadowed)
    begun = tables.device.kept.take(4 * rows * shade_pass.stride, f"radiance[{first}]")
    if tables.glancing and not shadowed:
        shade_pass.begin(begun, first, rows)
        return shade_pass, begun, False
    with tables.device.recording("optics.shade") as recording:
        shade_pass.record(recording, begun, first, rows)
    return shade_pass, begun, True


def _bands(
    tables: Tables,
    shade_pass: ShadePass,
    edge_pass: EdgePass | None,
    starts: range,
    stop: int,
    begun: Buffer | None,
    shaded: bool,
) -> list[Band] | None:
    """Bands of rows from ``starts`` on, up to ``stop``, edges and shadows and all; None where the
    view isn't what it was guessed to be. ``begun``: the first band, which may be ``shaded``."""
    device, setup, stride = tables.device, tables.setup, shade_pass.stride
    relit = None
    if setup.lighting.shadows is not None:
        relit = RelitPass(tables, shade_pass, min(starts.step, stop - starts.start))
    bands: list[Band] = []
    wrong = False
    for row0 in starts:
        count = min(starts.step, stop - row0)
        if relit is not None:
            relit.finish()
        radiance = begun or device.kept.take(4 * count * stride, f"radiance[{row0}]")
        with device.recording("optics.shade") as recording:
            if begun is None or not shaded:
                shade_pass.record(recording, radiance, row0, count)
            begun = None
            if not bands and edge_pass is not None:
                # before anything else is submitted that one would wait for as well
                edge_pass.fetch()
                wrong = tables.surprised
        if relit is not None:
            relit.record(radiance, row0, count)
        bands.append(Band(row0, count, stride, radiance))
        if wrong:
            device.kept.give(radiance)
            return None
    if edge_pass is None:
        border = Border.of(setup.view, setup.background)
        value = border.value.astype(np.float32)
        write_pixels(device, bands, setup.view.camera.width, border.pixel, value)
    else:
        # while the device looks for what hides lamps from other pixels
        edge_pass.resolve()
        if relit is not None:
            relit.finish()
        edge_pass.write(bands)
    return bands


def _all_are(kind: type | UnionType, values: object) -> bool:
    return isinstance(values, Sequence) and all(isinstance(value, kind) for value in values)
