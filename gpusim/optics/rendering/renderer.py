"""Rendering one frame: view, visibility, interior shading, edge pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import UnionType

import numpy as np

from gpusim.arrays.array_types import Single
from gpusim.errors import InputError
from gpusim.gpu import Device, working_device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.plate_border import PlateBorderPass
from gpusim.optics.edge_pixels.resolve import EdgePixelPass, edges_twin
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.culling import wound_inwards
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import EnvironmentLight, Light, is_light
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.rendering.frame_plan import FramePlan, plan_frame
from gpusim.optics.rendering.frame_programs import frame_programs
from gpusim.optics.rendering.local_origin import local, seen_from_origin
from gpusim.optics.shading.relighting import RelightingPass
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import ShadingPass, shade_twin
from gpusim.optics.shading.spectrum import is_coloured_scene
from gpusim.optics.shading.tile_light import LightTiles
from gpusim.optics.shadow.single_layer import without_shadows
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.surface.color import BANDS, Color, color, in_band
from gpusim.surface.surface import Surface
from gpusim.validation import checked, require

MAX_SIDE = 8192
"""px, of an image."""

MAX_TRIANGLES = 4_000_000
"""Triangles set up at once: their records fill most of a portable texture (2^25 texels)."""

MIN_PART_ROWS = 16
"""Of an image, below which rows aren't parted further."""

MIN_ERROR = 0.25
"""Grey levels of 8 bit (RMS) that closed forms reach."""


@checked
@one_blas_thread()
def render(
    surfaces: Sequence[Surface],
    camera: Camera,
    lights: Sequence[Light] | None = None,
    *,
    error: float = MIN_ERROR,
    background: float | str | Sequence[float] = 0.0,
    device: Device | None = None,
    backend: str = "auto",
    shortcuts: bool = True,
) -> Frame:
    """Render ``surfaces`` as ``camera`` sees them.

    Parameters
    ----------
    lights : None shows each paint's albedo as radiance, the form in which geometry is verified;
        otherwise the lights' reflection, with the shadows of all ``surfaces``.
    error : largest error wanted, in grey levels of 8 bit (RMS); the closed forms reach 0.25, so
        smaller values are refused.
    background : radiance where no surface is: a number, red, green and blue, or "#rrggbb".
    backend : ``"auto"``: on the device where an adapter is found, else by the NumPy twins, with one
        warning; ``"gpu"``: on a device or not at all; ``"numpy"``: the float64 twins.
    device : the device to take; None: the process-wide one.
    shortcuts : False goes without all that is there for speed alone (`rendering.frame_plan`): the
        same picture but for rounding, slower.

    Returns
    -------
    Frame
        Each pixel is the mean radiance over its square: paint patterns and edges are integrated
        in closed form, light varies smoothly and is taken at the centre. Its ``warnings`` name
        closed surfaces whose faces are wound inwards, and lights that don't shine.

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
    _check(surfaces, camera, lights, error)
    behind = backdrop(background)
    device = working_device("render", backend, device)
    moved, camera_there, lights, origin = local(surfaces, camera, lights)
    if lights is not None and shortcuts:
        lights = without_shadows(moved, lights, camera_there.eye)
    scene = _Scene(moved, lights, behind)
    view = look(moved, camera_there, scene.lights is not None)
    shown = seen_from_origin(view, origin)
    if device is None:
        planes = _frame_twin(view, scene)
        frame = Frame.of_planes([Frame(shown, None, radiance=plane) for plane in planes])
    else:
        bands: list[Band] = []
        for rows, part in _parts(view, range(camera.height)):
            plan = plan_frame(part, lights, len(rows), scene.coloured)
            plan = plan if shortcuts else plan.without_shortcuts()
            bands += _draw(device, part, scene, plan, rows)
        frame = Frame.of_bands(shown, device, bands)
    frame.warnings = picture_warnings(moved, camera_there, lights)
    return frame


@dataclass(frozen=True)
class _Scene:
    """What a view is of: all surfaces, lights (None: albedo), and the radiance behind them."""

    surfaces: Sequence[Surface]
    lights: Sequence[Light] | None
    background: Color

    @property
    def coloured(self) -> bool:
        """Whether something in it isn't grey."""
        paints = [paint for surface in self.surfaces for paint in surface.paints.values()]
        return is_coloured_scene(paints, self.lights, self.background)


def picture_warnings(
    surfaces: Sequence[Surface], camera: Camera, lights: Sequence[Light] | None
) -> tuple[str, ...]:
    """What is doubtful of a picture, before it is looked at."""
    wound = wound_inwards(surfaces, camera)
    if lights is None or not all(map(_is_dark, lights)):
        return wound
    text = f"lights: got {lights!r}: every surface is black; expected some that shines, or None"
    return (f"{text}, which shows the paints' albedo", *wound)


def _is_dark(light: Light) -> bool:
    """Whether it is surroundings of no radiance; all other lights have some."""
    if not isinstance(light, EnvironmentLight):
        return False
    return not (light.sky or light.ground or (light.image is not None and light.image.any()))


def backdrop(background: float | str | Sequence[float]) -> Color:
    """The radiance behind a scene, from what people write. Raises InputError."""
    try:
        found = color(background)
    except InputError:
        found = -1.0
    from_zero = min(in_band(found, band) for band in BANDS) >= 0.0
    expected = "a radiance from 0 up: a number, three (red, green, blue), or '#rrggbb'"
    require(from_zero, "render background", repr(background), expected)
    return found


def _draw(device: Device, view: View, scene: _Scene, plan: FramePlan, rows: range) -> list[Band]:
    """Some ``rows`` of a view, in bands; the host resolves its edge pixels while the device lights
    all others."""
    setup = Setup.build(view, scene.lights, scene.background, scene.surfaces, device)
    device.programs.begin(frame_programs(setup, plan))
    lines = None
    if plan.checker_lines and setup.lighting.openness is None:
        lines = BoardLines.of(view, setup.traits.printed)
    buffers = SceneBuffers(device, setup, lines, fine=plan.deferred)
    tiles = LightTiles.of(setup) if plan.tile_light else None
    lit_by_all = ShadingPass(buffers, plan.rows, plan.deferred, tiles=tiles, marked=plan.shadowed)
    shading = RelightingPass(lit_by_all) if plan.shadowed else lit_by_all
    edge_pixels: EdgePixelPass | PlateBorderPass
    if plan.plate_border:
        edge_pixels = PlateBorderPass(device, view, setup.background)
    else:
        edge_pixels = EdgePixelPass(buffers, find_edge_pixels(view))
    bands = [
        Band.of(device, row0, min(plan.rows, rows.stop - row0), shading.stride, len(setup.bands))
        for row0 in rows[:: plan.rows]
    ]

    edge_pixels.find()
    for band in bands:
        shading.draw(band)
    edge_pixels.host_pass()
    shading.finish()
    edge_pixels.write(bands)
    return bands


def _frame_twin(view: View, scene: _Scene) -> Single:
    """Radiance (planes, H, W) in NumPy."""
    setup = Setup.build(view, scene.lights, scene.background, scene.surfaces)
    interior = shade_twin(setup, visibility_twin(view))
    return edges_twin(setup, find_edge_pixels(view), interior)


def _parts(view: View, rows: range) -> Iterator[tuple[range, View]]:
    """Rows of the image with no more triangles over them than one binding holds."""
    whole = len(rows) == view.camera.height
    part = view if whole else view.over_rows(rows.start, rows.stop)
    if part.count <= MAX_TRIANGLES or len(rows) <= MIN_PART_ROWS:
        yield rows, part
        return
    middle = (rows.start + rows.stop) // 2
    yield from _parts(view, range(rows.start, middle))
    yield from _parts(view, range(middle, rows.stop))


def _check(
    surfaces: Sequence[Surface],
    camera: Camera,
    lights: Sequence[Light] | None,
    error: float,
) -> None:
    """Refuse what isn't to be rendered."""
    if not _all_are(Surface, surfaces) or not surfaces:
        raise InputError(f"render surfaces; got {surfaces!r}; expected a list of Surface")
    if not isinstance(camera, Camera):
        raise InputError(f"render camera; got {camera!r}; expected a Camera")
    if lights is not None and not (
        isinstance(lights, Sequence) and all(is_light(light) for light in lights)
    ):
        raise InputError(f"render lights; got {lights!r}; expected a list of lights, or None")
    if not (np.isfinite(error) and error >= MIN_ERROR):
        raise InputError(f"render error; got {error}; expected at least {MIN_ERROR} grey levels")
    for name, size in (("width", camera.width), ("height", camera.height)):
        require(size <= MAX_SIDE, f"render: image {name}", size, f"at most {MAX_SIDE} px")


def _all_are(kind: type | UnionType, values: object) -> bool:
    return isinstance(values, Sequence) and all(isinstance(value, kind) for value in values)
