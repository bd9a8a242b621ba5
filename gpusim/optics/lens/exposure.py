"""A photograph: the exact pinhole renderer behind a real lens and shutter.

Every moment of the exposure and every position on the lens is one closed-form rendering; they are
averaged on the device, on cells finer than the pixel if the lens has a point spread, and those are
weighted and summed into pixels. What the lens and the shutter don't do isn't run: a pinhole with
an instant shutter is `gpusim.optics.rendering.renderer.render` itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial, reduce
from itertools import groupby

import numpy as np

from gpusim.arrays.array_types import Float, Single
from gpusim.errors import InputError
from gpusim.gpu import Device, working_device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.view import View
from gpusim.optics.lens.convolution import (
    ConvolvePass,
    Target,
    accumulate,
    accumulate_twin,
    added,
    convolve_twin,
    multiplied,
    row_gains,
)
from gpusim.optics.lens.lit_moments import Part, lit_moments
from gpusim.optics.lens.psf import Convolved, Disc, Psf, SampledKernel, sample
from gpusim.optics.lens.shutter import (
    CameraAt,
    Shutter,
    SurfacesAt,
    moments,
    moments_for,
    motion,
    rolled,
)
from gpusim.optics.lens.thin_lens import Focus, Lens, focus_of, seen_through
from gpusim.optics.lens.tiles import Tile, largest_tile
from gpusim.optics.light.lights import Light
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.rendering.renderer import (
    MIN_ERROR,
    backdrop,
    picture_warnings,
    render,
)
from gpusim.optics.shading.spectrum import is_coloured_scene
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.surface.color import BANDS, in_band
from gpusim.surface.surface import Surface
from gpusim.validation import Finite, checked, require

PLACE_ERROR = 1.0 / 8.0
"""Over w n^2: how far the centroid of what is w px wide moves at most, as cells of 1 / n px that it
fills in part on one side don't tell where."""
SAME_IMAGE = SampledKernel(1, 0, ((np.ones(1), np.ones(1)),), 0.0)


@dataclass(frozen=True, eq=False)
class Exposure:
    """What one photograph is put together from.

    ``parts``: the renderings; ``sight``: surfaces and camera at the middle of the exposure, for the
    truth. ``facts`` say in words what was done and left out, ``warnings`` where less was done than
    the error asks for.
    """

    parts: tuple[Part, ...]
    sight: tuple[Sequence[Surface], Camera]
    kernel: SampledKernel
    facts: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether one rendering at the image's own pixels is all."""
        alone = len(self.parts) == 1 and self.kernel is SAME_IMAGE
        return alone and self.parts[0].weight == 1.0 and self.parts[0].gains is None


@checked
@one_blas_thread()
def photograph(
    surfaces: Sequence[Surface] | SurfacesAt,
    camera: Camera | CameraAt,
    lights: Sequence[Light] | None = None,
    *,
    lens: Lens | None = None,
    shutter: Shutter | None = None,
    time: Finite = 0.0,
    error: float = MIN_ERROR,
    background: float | str | Sequence[float] = 0.0,
    device: Device | None = None,
    backend: str = "auto",
    shortcuts: bool = True,
) -> Frame:
    """Photograph ``surfaces`` with a real lens and shutter.

    Parameters
    ----------
    surfaces, camera : or functions of the time (s) that return them; surfaces must keep their
        number of vertices.
    lens, shutter : None for a pinhole, and for an instant.
    time : when row 0 begins to collect light.
    error : RMS error in grey levels of 8 bit, of a picture half of whose pixels see full-contrast
        edges: it decides the cells per pixel and the lens positions.
    lights, background, device, backend, shortcuts : as for `render`.

    Returns
    -------
    Frame
        Its truth is that of the pinhole camera at the middle of the exposure, at the time of each
        row where the shutter rolls. ``facts`` say what was done, ``warnings`` what was left
        short: a motion or a blur so long that more than 256 renderings would be needed.

    Raises
    ------
    InputError, NoAdapter, OutOfDeviceMemory

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> lens = gs.Lens(psf=gs.psf.Gaussian(0.5))
    >>> gs.photograph([wall], camera, lens=lens, backend="numpy").radiance.shape
    (4, 6)
    """
    _check(surfaces, lens, shutter)
    lens, shutter, behind = lens or Lens(), shutter or Shutter(), backdrop(background)
    shines = any(in_band(behind, band) for band in BANDS)
    exposure = plan_exposure(surfaces, camera, lens, shutter, time, error, lights, shines)
    device = working_device("photograph", backend, device)
    backend = "numpy" if device is None else "gpu"

    def shoot(part: Part) -> Frame:
        return render(
            part.surfaces, part.camera, part.lights, error=error,
            background=behind if part.gains is None else 0.0, device=device, backend=backend,
            shortcuts=shortcuts,
        )  # fmt: skip

    if exposure.plain:
        frame = shoot(exposure.parts[0])
    else:
        paints = [paint for one in exposure.sight[0] for paint in one.paints.values()]
        planes = 3 if is_coloured_scene(paints, lights, behind) else 1
        view = local_view(*exposure.sight, lit=lights is not None)
        frame = reduce(added, _combined(exposure, shoot, planes, view, device))
    if lens.vignetting is not None:
        frame = multiplied(frame, partial(lens.vignetting.gains, exposure.sight[1]))
    frame.facts = dict(exposure.facts)
    frame.warnings = (*picture_warnings(*exposure.sight, lights), *exposure.warnings)
    return frame


def _check(surfaces: object, lens: Lens | None, shutter: Shutter | None) -> None:
    """Refuse what isn't to be photographed."""
    require(isinstance(lens, Lens | None), "photograph lens", repr(lens), "a Lens")
    require(isinstance(shutter, Shutter | None), "photograph shutter", repr(shutter), "a Shutter")
    fixed = [] if callable(surfaces) else surfaces
    if not (isinstance(fixed, Sequence) and all(isinstance(one, Surface) for one in fixed)):
        expected = "a list of Surface, or a function of the time that returns one"
        raise InputError(f"photograph surfaces; got {surfaces!r}; expected {expected}")


def plan_exposure(
    surfaces: Sequence[Surface] | SurfacesAt,
    camera: Camera | CameraAt,
    lens: Lens,
    shutter: Shutter,
    time: float,
    error: float,
    lights: Sequence[Light] | None = None,
    shines: bool = False,
) -> Exposure:
    """Decide moments, their lights, lens positions and cells per pixel; ``shines``: whether there
    is radiance without lamps."""
    tolerance = error * np.sqrt(2.0) / 255.0
    notes = _Notes()
    scenes, sight = _moments(surfaces, camera, shutter, time, notes, lights, shines)
    depths = np.concatenate([sight[1].to_camera(s.points)[:, 2] for s in sight[0]] or [np.zeros(0)])
    focus = focus_of(lens, sight[1], depths, tolerance)
    psf = lens.psf
    if lens.aperture:
        psf = _depth_of_field(lens, focus, tolerance, notes)
    kernel, side = _point_spread(lens, psf, tolerance, notes)
    if side != 1.0:
        scenes = [one._replace(camera=replace(one.camera, pixel_side=side)) for one in scenes]
    if lens.vignetting is not None:
        notes.facts["vignetting"] = "applied"
    positions = len(focus.points)
    share = 1.0 / positions
    if len(scenes) > 1 and positions > 1:
        notes.facts["renderings"] = (
            f"{len(scenes) * positions}: {positions} lens positions at each of "
            f"{len(scenes)} moments"
        )
    parts = [
        one._replace(weight=one.weight * share, camera=_at(one.camera, point, lens))
        for one in scenes
        for point in focus.points
    ]
    return Exposure(tuple(parts), sight, kernel, notes.facts, tuple(notes.warnings))


@dataclass(frozen=True)
class _Notes:
    """What is said of a photograph: see `Exposure`."""

    facts: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def _moments(
    surfaces: Sequence[Surface] | SurfacesAt,
    camera: Camera | CameraAt,
    shutter: Shutter,
    time: float,
    notes: _Notes,
    lights: Sequence[Light] | None,
    shines: bool,
) -> tuple[list[Part], tuple[Sequence[Surface], Camera]]:
    """Each moment of the exposure, and surfaces and camera of its middle."""
    surfaces_at: SurfacesAt = surfaces if callable(surfaces) else lambda _: surfaces
    camera_at: CameraAt = camera if callable(camera) else lambda _: camera
    middle = time + 0.5 * shutter.exposure_time
    sharp = camera_at(middle)
    require(isinstance(sharp, Camera), "photograph camera", repr(sharp), "a Camera")
    moves, travel, chosen = callable(surfaces) or callable(camera), 0.0, moments(Shutter(), 0.0)
    if moves:
        if shutter.exposure_time:
            travel = motion(surfaces_at, camera_at, time, shutter.exposure_time)
        chosen = shares, _ = moments(shutter, travel)
        notes.facts["motion"] = f"{travel:.3g} px during the exposure, {len(shares)} moments"
        wanted = moments_for(travel)
        if shutter.samples is None and len(shares) < wanted and shutter.exposure_time:
            remedy = f"{wanted} samples of the shutter" if wanted <= 4096 else "a shorter exposure"
            notes.warnings.append(
                f"motion of {travel:.4g} px in {len(shares)} moments: edges may go in steps of up "
                f"to {travel * np.diff(shares).max():.2g} px; {remedy} would show none"
            )
        if shutter.line_time:
            notes.facts["shutter"] = f"rolling, {shutter.line_time * 1e6:.4g} us a row"

    @cache
    def moment(share: float) -> tuple[Sequence[Surface], Camera]:
        at = time + share * shutter.exposure_time
        if moves and shutter.line_time:
            return rolled(surfaces_at, camera_at, at, shutter.line_time)
        return surfaces_at(at), camera_at(at)

    rows = time + shutter.line_time * np.arange(sharp.height, dtype=np.float64)
    parts = lit_moments(chosen, moment, lights, shutter, rows, shines)
    if parts[0].lights is not lights:
        whose = "each row's" if shutter.line_time else "the"
        notes.facts["flicker"] = f"mean light of {whose} exposure, {len(parts)} renderings"
    return parts, moment(0.5)


def _depth_of_field(lens: Lens, focus: Focus, tolerance: float, notes: _Notes) -> Psf | None:
    """The point spread with that of depth of field, where one disc serves for all of it."""
    psf, count = lens.psf, len(focus.points)
    words = f"blur up to {focus.largest:.3g} px"
    if focus.disc:
        psf = Disc(focus.disc) if psf is None else Convolved(psf, Disc(focus.disc))
        words += ", all at one depth: one disc"
    elif count == 1:
        words += ": left out"
    else:
        words += f", {count} lens positions, edge error {focus.edge_error:.1e}"
        if lens.positions is None and not focus.edge_error <= tolerance:
            notes.warnings.append(
                f"blur of {focus.largest:.4g} px by {count} lens positions: edge error "
                f"{focus.edge_error:.1e}; expected {tolerance:.1e}, by more positions of the lens"
            )
    notes.facts["depth of field"] = words
    return psf


def _point_spread(
    lens: Lens, psf: Psf | None, tolerance: float, notes: _Notes
) -> tuple[SampledKernel, float]:
    """The kernel that cells are summed by, and the side of pixels' squares that have none."""
    if psf is not None:
        kernel = sample(
            psf, fill_factor=lens.fill_factor, tolerance=tolerance, n=lens.samples_per_px
        )
        notes.facts["point spread"] = (
            f"{kernel.n} x {kernel.n} cells a pixel, {kernel.taps} across the kernel, edge error "
            f"{kernel.edge_error:.1e}, what is w px wide in place to "
            f"{PLACE_ERROR / kernel.n**2:.2g} / w px"
        )
        return kernel, 1.0
    side = float(np.sqrt(lens.fill_factor))
    if side != 1.0:
        notes.facts["fill factor"] = (
            f"{lens.fill_factor:.4g}: a square of {side:.4g} px, in closed form"
        )
    return SAME_IMAGE, side


def _at(camera: Camera, point: Float, lens: Lens) -> Camera:
    if lens.focus_distance is None or not point.any():
        return camera
    return seen_through(camera, point, lens.focus_distance)


def _combined(
    exposure: Exposure, shoot: Callable[[Part], Frame], planes: int, view: View,
    device: Device | None,
) -> Iterator[Frame]:  # fmt: skip
    """The weighted sum of all parts that have the same gains, behind the lens, and times these."""
    for _, parts in groupby(exposure.parts, lambda part: id(part.gains)):
        layer = replace(exposure, parts=tuple(parts))
        if device is None:
            combined = _combine_twin(layer, shoot, planes)
            frame = Frame.of_planes([Frame(view, None, radiance=plane) for plane in combined])
        else:
            frame = Frame.of_bands(view, device, list(_combine(layer, shoot, device, planes)))
        gains = layer.parts[0].gains
        yield frame if gains is None else multiplied(frame, row_gains(gains, frame.width))


def _combine(
    exposure: Exposure,
    shoot: Callable[[Part], Frame],
    device: Device,
    planes: int,
) -> Iterator[Band]:
    kernel, camera = exposure.kernel, exposure.sight[1]
    columns, rows = largest_tile(camera, kernel)
    work = ConvolvePass(device, kernel, columns, rows) if kernel is not SAME_IMAGE else None
    for row0 in range(0, camera.height, rows):
        count = min(rows, camera.height - row0)
        stride = camera.width
        outs = tuple(device.empty(4 * count * stride, f"radiance[{row0}]") for _ in range(planes))
        for column0 in range(0, camera.width, columns):
            tile = Tile(column0, min(columns, camera.width - column0), row0, count)
            size = tile.cells(camera, kernel)
            targets = [Target(out, column0, stride) for out in outs]
            sums = targets
            if work is not None:
                area = 4 * size.width * size.height
                sums = [Target(device.empty(area, "photograph.cells"), 0, size.width) for _ in outs]
            for part in exposure.parts:
                drawn = shoot(part._replace(camera=tile.cells(part.camera, kernel)))
                shown = drawn.planes * (planes // len(drawn.planes))
                for plane, own in zip(shown, sums, strict=True):
                    for band in plane.bands:
                        place = Target(own.buffer, own.first + band.row0 * own.stride, own.stride)
                        accumulate(device, band.buffer, band.stride, (band.rows, size.width), place,
                                   weight=part.weight)  # fmt: skip
                drawn.release()
            if work is not None:
                for own, target in zip(sums, targets, strict=True):
                    work.run(own.buffer, tile.columns, tile.rows, target)
                    own.buffer.release()
        yield Band(row0, count, stride, outs)
    if work is not None:
        work.release()


def _combine_twin(exposure: Exposure, shoot: Callable[[Part], Frame], planes: int) -> list[Single]:
    camera, kernel = exposure.sight[1], exposure.kernel
    whole = Tile(0, camera.width, 0, camera.height)
    size = whole.cells(camera, kernel)
    sums = [np.zeros((size.height, size.width)) for _ in range(planes)]
    for part in exposure.parts:
        drawn = shoot(part._replace(camera=whole.cells(part.camera, kernel)))
        shown = drawn.planes * (planes // len(drawn.planes))
        sums = [
            accumulate_twin(own, plane.radiance, part.weight)
            for own, plane in zip(sums, shown, strict=True)
        ]
    if kernel is not SAME_IMAGE:
        sums = [convolve_twin(kernel, cells) for cells in sums]
    return [cells.astype(np.float32) for cells in sums]
