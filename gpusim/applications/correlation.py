"""Pictures correlated, and what was found written as tables, maps and a page."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from gpusim.applications.correlation_output import (
    CorrelationOutput,
    CorrelationSettings,
    Progress,
    ResultWriter,
    described,
    silent,
)
from gpusim.arrays.array_types import Bool
from gpusim.choices import StrainKind, SurfaceStrain
from gpusim.errors import InputError
from gpusim.export.calibrated_cameras import cameras_in_file
from gpusim.export.correlation import FORMATS
from gpusim.files.atomic_files import PathLike
from gpusim.files.frame_source import Frames, FrameSource, read_frames, read_still
from gpusim.files.output_folder import claim
from gpusim.files.picture_file import picture_file, read_grey
from gpusim.gpu import working_device
from gpusim.measure import (
    CalibratedCamera,
    DicResult,
    MappedResult,
    StereoResult,
    StrainResult,
    dic_sequence,
    lens_mapping,
    mapped,
    stereo_dic,
    stereo_shape,
    strain,
    surface_strain,
)
from gpusim.measure.images import check_image

USUAL = CorrelationSettings()
STRAINS = (*get_args(StrainKind), "none")
SURFACE_STRAINS = (*get_args(SurfaceStrain), "none")


def correlate_files(
    reference: PathLike | npt.NDArray[Any],
    deformed: Frames | FrameSource,
    output: PathLike,
    settings: CorrelationSettings = USUAL,
    *,
    progress: Progress = silent,
    keep_results: bool = True,
) -> CorrelationOutput:
    """Measure how pictures moved against the first one; write tables, maps and ``report.html``.

    Each picture has its ``<number>_<name>.csv`` (or other formats) and ``<number>_<name>.png``; of
    more than 100 pictures 25 maps are drawn. Pictures are read one at a time. All but the pictures
    is checked before the first is measured.

    Parameters
    ----------
    reference : a file, or a picture (H, W).
    deformed : pictures after it, as ``read_frames`` takes them: folder, files, stack, arrays.
    output : a folder, made if need be.
    settings : how they are correlated.
    progress : called with ("dic", how much is done 0..1, a text).
    keep_results : return them, too; False: a series of any length needs little memory.

    Raises
    ------
    InputError
        Files or settings that are wrong, pictures of different sizes.

    Examples
    --------
    >>> settings = gs.applications.CorrelationSettings(step=20, backend="numpy")
    >>> done = gs.applications.correlate_files("before.png", ["after.png"], "dic", settings)
    >>> done.report["images"][0]["measured"], [path.name for path in done.files]
    (35, ['0001_after.csv', '0001_after.png', 'report.json', 'report.html'])
    """
    with claim(output):
        _check_settings(settings, STRAINS)
        check_files(reference, deformed)
        frames = read_frames(deformed)
        if isinstance(reference, np.ndarray):
            first, name = check_image(reference, "reference"), "reference"
        else:
            first, name = read_still(reference), str(reference)
        lens = None
        if settings.calibration is not None:
            (lens,) = cameras_of(settings, settings.calibration, [first.shape], "calibration")
        options, notes = prepared(first, name, settings)
        pictures = {"deformed": frames}
        written = ResultWriter(Path(output), first, pictures, notes, settings.formats, progress)

        def keep(number: int, result: DicResult) -> None:
            found: StrainResult | None = None
            result, flat = (result, result) if lens is None else undistorted(result, lens)
            if settings.strain != "none":
                found = strain(flat, window=settings.strain_window, kind=settings.strain)
            written.add(number, result, found, keep=keep_results)

        progress("dic", 0.0, f"{len(frames)} images")
        images = alike(frames, first.shape, name)
        motion = _motion_options(settings)
        dic_sequence(first, images, progress=keep, keep_results=False, **options, **motion)
        return written.finished()


def correlate_pairs(
    lefts: Frames | FrameSource,
    rights: Frames | FrameSource,
    rig: PathLike,
    output: PathLike,
    settings: CorrelationSettings = USUAL,
    *,
    progress: Progress = silent,
    keep_results: bool = True,
) -> CorrelationOutput:
    """Measure a surface in space from pairs of pictures, the reference pair first; lengths are mm.

    With one pair only its shape is measured. What is written is as in ``correlate_files``.

    Parameters
    ----------
    lefts, rights : pictures of the two cameras, as ``read_frames`` takes them.
    rig : calibration file of both cameras.
    output, settings, progress : as in ``correlate_files``.
    keep_results : return them all; False: the first one alone.

    Raises
    ------
    InputError
        As ``correlate_files``, or not as many pictures of both cameras.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> right = np.array([[1, 0, 0, -0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    >>> rig = [gs.Camera(160, 120, np.array(K, float), name="left"),
    ...        gs.Camera(160, 120, np.array(K, float), None, right, "right")]
    >>> _ = gs.write_calibration("rig.yaml", rig, "kalibr")
    >>> lefts, rights = (["left.png", "left-1.png"], ["right.png", "right-1.png"])
    >>> settings = gs.applications.CorrelationSettings(step=20, backend="numpy")
    >>> done = gs.applications.correlate_pairs(lefts, rights, "rig.yaml", "stereo", settings)
    >>> print(f"U {done.report['images'][0]['U_mean']:.2f} mm")
    U 1.00 mm
    """
    with claim(output):
        if settings.calibration is not None:
            raise InputError("`calibration`: the cameras are in `rig`; expected one of the two")
        _check_settings(settings, SURFACE_STRAINS, " with `rig`")
        check_files(lefts, rights)
        one, two = read_frames(lefts), read_frames(rights)
        if not 0 < len(one) == len(two):
            raise InputError(
                f"lefts, rights: got {len(one)} and {len(two)} pictures; expected pairs"
            )
        left, right = one[0], two[0]
        cameras = cameras_of(settings, rig, [left.shape, right.shape], "rig")
        options, notes = prepared(left, one.names[0], settings)
        notes["stereo"] = str(rig)
        moved = len(one) > 1
        pictures = {"left": one[1:], "right": two[1:]} if moved else {"left": one, "right": two}
        written = ResultWriter(Path(output), left, pictures, notes, settings.formats, progress)

        def keep(number: int, result: StereoResult) -> None:
            found: StrainResult | None = None
            if settings.strain != "none" and moved:
                kind: Any = settings.strain
                found = surface_strain(result, window=settings.strain_window, kind=kind)
            written.add(number, result, found, keep=keep_results or number == 0)

        progress("dic", 0.0, f"{len(one)} pairs")
        if moved:
            lefts = alike(one[1:], left.shape, one.names[0])
            rights = alike(two[1:], right.shape, two.names[0])
            options |= _motion_options(settings)
            options |= {"progress": keep, "keep_results": False}
            stereo_dic(left, right, lefts, rights, (cameras[0], cameras[1]), **options)
        else:
            keep(0, stereo_shape(left, right, (cameras[0], cameras[1]), **options))
        return written.finished(stand_off_warnings(Path(rig), cameras, written.results))


def prepared(
    first: npt.NDArray[Any], name: str, settings: CorrelationSettings
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of every correlation with the picture ``first`` as its reference, and what reports
    and tables repeat of them."""
    device = working_device("correlate", settings.backend)
    names = ("subset", "step", "roi", "blur_px", "min_zncc", "tolerance")
    options = {name: getattr(settings, name) for name in names}
    options |= {"mask": read_mask(settings.mask, first.shape), "device": device}
    options["backend"] = "numpy" if device is None else "gpu"
    return options, described(name, settings, device)


def _motion_options(settings: CorrelationSettings) -> dict[str, Any]:
    """Arguments of those that follow a motion."""
    names = ("shape", "update", "start", "search_px", "apart_px")
    return {name: getattr(settings, name) for name in names}


def undistorted(result: DicResult, lens: CalibratedCamera) -> tuple[DicResult, MappedResult]:
    """The result with the lens undone, at its places in the picture; and where they really are."""
    flat = mapped(result, lens_mapping(lens))
    own = replace(
        result,
        displacement=flat.displacement,
        gradient=flat.gradient,
        sigma=flat.sigma,
        status=flat.status,
    )
    return own, flat


def cameras_of(
    settings: CorrelationSettings, path: PathLike, shapes: Sequence[tuple[int, ...]], argument: str
) -> list[CalibratedCamera]:
    """The cameras of pictures of such ``shapes``, from a file."""
    sizes = [(shape[1], shape[0]) for shape in shapes]
    return cameras_in_file(f"`{argument}`: {path}", path, sizes, unit=settings.calibration_unit)


def alike(
    frames: FrameSource, shape: tuple[int, ...], reference: str
) -> Iterator[npt.NDArray[Any]]:
    """The pictures; InputError for one that isn't of the reference's size: then the same pixel
    isn't the same place of the sensor."""
    for name, picture in zip(frames.names, frames, strict=True):
        if picture.shape[:2] != shape[:2]:
            got, expected = (f"{size[1]} x {size[0]} px" for size in (picture.shape, shape))
            raise InputError(
                f"image file: {name}: not of {Path(reference).name}'s size; got {got}; expected "
                f"{expected}"
            )
        yield picture


def check_files(*sources: object) -> None:
    """InputError that names all files that are missing."""
    every = [one for each in sources for one in (each if isinstance(each, list) else [each])]
    paths = [one for one in every if isinstance(one, str | os.PathLike)]
    missing = [str(path) for path in paths if not picture_file(path)[0].exists()]
    if missing:
        raise InputError(
            f"image file{'s' if len(missing) > 1 else ''} not found: {', '.join(missing)}"
        )


def _check_settings(settings: CorrelationSettings, strains: Sequence[str], where: str = "") -> None:
    """Refuse what would be found wrong only after a picture has been measured."""
    for name, value, known, rest in (
        ("strain", settings.strain, strains, where),
        *(("formats", value, FORMATS, "") for value in settings.formats),
    ):
        if value not in known:
            raise InputError(f"`{name}`: got {value}; expected {', '.join(known)}{rest}")
    if settings.strain_window < 3 or settings.strain_window % 2 == 0:
        raise InputError(
            f"`strain_window`: got {settings.strain_window}; expected an odd number >= 3"
        )


def read_mask(path: PathLike | None, shape: tuple[int, ...]) -> Bool | None:
    if path is None:
        return None
    image = read_grey(path)
    if image.shape != shape:
        raise InputError(
            f"`mask`: {path}: got {image.shape[1]}x{image.shape[0]} px; expected "
            f"{shape[1]}x{shape[0]} as the reference"
        )
    return np.asarray(image > 0)


NEAREST, FURTHEST = 5.0, 1e6  # mm: a microscope's object is further, a bridge nearer
LEAST_BASELINE = 0.5  # mm


def stand_off_warnings(
    calibration: Path, cameras: Sequence[CalibratedCamera], results: Sequence[StereoResult]
) -> list[str]:
    """One line if the rig's cameras or what they saw are implausibly near or far; else none.

    Lengths of the ``cameras`` and ``results`` are mm, by the unit of the file ``calibration``.
    """
    depths = [result.shape[result.ok, 2] for result in results]
    depth = float(np.median(np.concatenate(depths))) if any(map(len, depths)) else np.nan
    baseline = float(np.linalg.norm(cameras[1].camera_from_rig[:3, 3]))
    plausible = baseline >= LEAST_BASELINE and not (depth < NEAREST or depth > FURTHEST)
    if plausible:
        return []
    away = f"what they see is {depth:.3g} mm away" if np.isfinite(depth) else "nothing was measured"
    return [
        f"{calibration}: its cameras are {baseline:.3g} mm apart and {away}: the unit of its "
        "lengths looks wrong; say it with --calibration-unit"
    ]
