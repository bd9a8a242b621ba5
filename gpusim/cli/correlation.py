"""``gpusim dic``: pictures correlated, written as tables, maps and a page."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.cli.console import Destination, out
from gpusim.errors import InputError, NotConverged
from gpusim.export.correlation import write_correlation, write_stereo
from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.files.picture_file import pages_of, picture_file, read_grey
from gpusim.gpu import Device, working_device
from gpusim.measure import (
    CalibratedCamera,
    DicResult,
    MappedResult,
    StereoResult,
    StrainResult,
    dic_sequence,
    lens_mapping,
    mapped,
    rig_camera,
    stereo_dic,
    stereo_shape,
    strain,
    surface_strain,
)
from gpusim.measure.correlation.dic import Start
from gpusim.measure.correlation.sequence import Update
from gpusim.measure.correlation.strain import StrainKind
from gpusim.measure.correlation.warp import Shape
from gpusim.optics.calibration.formats import read_calibration
from gpusim.report.correlation import (
    correlation_page,
    draw_maps,
    draw_stereo_maps,
    stereo_summary,
    summary,
)
from gpusim.report.model import Figure

__all__ = ["Choices", "correlate_files", "correlate_pairs"]

_SCHEMA = 1
UNSAID = ("formats", "backend")
"""Choices that a report's settings don't repeat; and words for those that aren't made."""
MISSING = {
    "roi": "all",
    "mask": "none",
    "calibration": "none",
    "calibration_unit": "as the file says",
}
SURFACE_STRAINS = ("green-lagrange", "hencky", "none")


@dataclass(frozen=True)
class Choices:
    """What the command line says beside the files; names as in ``dic`` and ``strain``."""

    subset: int
    step: int
    shape: Shape
    roi: str | None
    mask: Path | None
    calibration: Path | None
    calibration_unit: str | None
    update: Update
    start: Start
    search_px: int
    blur_px: float
    min_zncc: float
    apart_px: float
    tolerance: float
    strain: StrainKind | Literal["none"]
    strain_window: int
    formats: tuple[str, ...]
    backend: str


@dataclass
class Output:
    """What a correlation writes: tables and a map of each result, a page and JSON of all."""

    destination: Destination
    choices: Choices
    settings: dict[str, Any]
    rows: list[dict[str, Any]] = field(default_factory=list)
    figures: list[tuple[str, Figure]] = field(default_factory=list)

    def path(self, number: int, picture: Path, suffix: str) -> Path:
        """The file of a result, counted from 1."""
        name = f"{number:04d}_{safe_name(picture.stem)}.{suffix}"
        return inside(self.destination.folder, name)

    def finish(self, title: str, warnings: Sequence[str] = ()) -> None:
        """Report, and say so if an image has no point measured."""
        rows, settings, folder = self.rows, self.settings, self.destination.folder
        report = {"schema": _SCHEMA, "version": __version__, "settings": settings, "images": rows,
                  "warnings": list(warnings)}  # fmt: skip
        text = json.dumps(report, indent=2)
        write_text(inside(folder, "report.json"), text + "\n")
        page = correlation_page(title, rows, self.figures, settings, warnings)
        write_text(inside(folder, "report.html"), page)
        if self.destination.as_json:
            out(text)
        elif not self.destination.quiet:
            _print(rows, folder)
            for warning in warnings:
                out(f"warning: {warning}")
        empty = [row["image"] for row in rows if row["measured"] == 0]
        if empty:
            raise NotConverged(
                f"dic: no point could be measured in {', '.join(empty)}; "
                f"{folder / 'report.html'} says why"
            )


def correlate_files(
    reference: Path, deformed: Sequence[Path], choices: Choices, destination: Destination
) -> None:
    """Correlate files and write ``<number>_<name>.csv`` (or other formats), maps, ``report.html``.

    Everything is checked before the first image is measured. Raises InputError for files and
    choices that are wrong, NotConverged, after all is written, if an image has no point measured.
    """
    _check_choices(choices)
    _check_files([reference, *deformed])
    deformed = [page for path in deformed for page in pages_of(path)]
    first = read_grey(reference)
    lens = None
    if choices.calibration is not None:
        (lens,) = _cameras(choices, choices.calibration, [first.shape], "--calibration")
    roi = _roi(choices.roi)
    mask = None if choices.mask is None else _mask(choices.mask, first.shape)
    device = working_device("--backend", choices.backend)
    output = Output(destination, choices, _settings(reference, choices, device))
    with destination.progress() as progress:
        clock = time.perf_counter()
        progress("dic", 0.0, f"{len(deformed)} images")

        def keep(number: int, result: DicResult) -> None:
            nonlocal clock
            found: StrainResult | None = None
            flat: DicResult | MappedResult = result
            if lens is not None:
                result, flat = _undistorted(result, lens)
            if choices.strain != "none":
                found = strain(flat, window=choices.strain_window, kind=choices.strain)
            seconds = time.perf_counter() - clock
            path = deformed[number]
            notes = output.settings | {"reference": str(reference), "deformed": str(path)}
            for suffix in choices.formats:
                write_correlation(output.path(number + 1, path, suffix), result, found, notes)
            row = summary(str(path), result, found, seconds)
            figure = draw_maps(first, result, found, output.path(number + 1, path, "png"))
            output.figures.append((path.name, figure))
            output.rows.append(row)
            progress(
                "dic", (number + 1) / len(deformed), f"{path.name}: {row['measured']} measured"
            )
            clock = time.perf_counter()

        dic_sequence(
            first,
            (_alike(path, first.shape, reference) for path in deformed),
            roi=roi,
            mask=mask,
            progress=keep,
            **_motion_options(choices),
            **_subset_options(choices, device),
        )
    output.finish(reference.name)


def correlate_pairs(
    pictures: Sequence[Path], calibration: Path, choices: Choices, destination: Destination
) -> None:
    """Correlate pairs, left before right, the reference pair first; lengths are mm.

    With one pair only its shape is measured. Raises as ``correlate_files`` does.
    """
    _check_choices(choices)
    if len(pictures) % 2:
        raise InputError(
            f"--stereo: got {len(pictures)} pictures; expected pairs: LEFT_REF RIGHT_REF "
            "LEFT_1 RIGHT_1 …"
        )
    if choices.calibration is not None:
        raise InputError("--calibration: the cameras are in --stereo; expected one of the two")
    if choices.strain not in SURFACE_STRAINS:
        raise InputError(
            f"--strain: got {choices.strain}; expected {', '.join(SURFACE_STRAINS)} with --stereo"
        )
    _check_files(pictures)
    lefts, rights = pictures[0::2], pictures[1::2]
    left, right = read_grey(lefts[0]), read_grey(rights[0])
    one, two = _cameras(choices, calibration, [left.shape, right.shape], "--stereo")
    mask = None if choices.mask is None else _mask(choices.mask, left.shape)
    device = working_device("--backend", choices.backend)
    settings = _settings(lefts[0], choices, device) | {"stereo": str(calibration)}
    output = Output(destination, choices, settings)
    common = _subset_options(choices, device) | {"roi": _roi(choices.roi), "mask": mask}
    with destination.progress() as progress:
        clock = time.perf_counter()
        progress("dic", 0.0, f"{len(lefts)} pairs")
        if len(lefts) == 1:
            results = [stereo_shape(left, right, (one, two), **common)]
        else:
            results = stereo_dic(
                left,
                right,
                (_alike(path, left.shape, lefts[0]) for path in lefts[1:]),
                (_alike(path, right.shape, rights[0]) for path in rights[1:]),
                (one, two),
                **_motion_options(choices),
                **common,
            )
        seconds = (time.perf_counter() - clock) / len(results)
        seen = list(zip(lefts, rights, strict=True))[-len(results) :]
        for number, (result, pair) in enumerate(zip(results, seen, strict=True), start=1):
            found = None
            if choices.strain != "none" and len(results) == len(lefts) - 1:
                kind: Any = choices.strain
                found = surface_strain(result, window=choices.strain_window, kind=kind)
            notes = settings | {"reference": str(lefts[0]), "left": str(pair[0]),
                                "right": str(pair[1])}  # fmt: skip
            for suffix in choices.formats:
                write_stereo(output.path(number, pair[0], suffix), result, found, notes)
            figure = draw_stereo_maps(left, result, found, output.path(number, pair[0], "png"))
            output.figures.append((f"{pair[0].name}, {pair[1].name}", figure))
            row = stereo_summary(str(pair[0]), result, found, seconds)
            output.rows.append(row)
            progress("dic", number / len(results), f"{pair[0].name}: {row['measured']} points")
    output.finish(lefts[0].name, stand_off_warnings(calibration, (one, two), results))


def _subset_options(choices: Choices, device: Device | None) -> dict[str, Any]:
    """Arguments of every correlation."""
    names = ("subset", "step", "blur_px", "min_zncc", "tolerance")
    own = {name: getattr(choices, name) for name in names}
    return own | {"device": device, "backend": "numpy" if device is None else "gpu"}


def _motion_options(choices: Choices) -> dict[str, Any]:
    """Arguments of those that follow a motion."""
    names = ("shape", "update", "start", "search_px", "apart_px")
    return {name: getattr(choices, name) for name in names}


def _undistorted(result: DicResult, lens: CalibratedCamera) -> tuple[DicResult, MappedResult]:
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


def _cameras(
    choices: Choices, path: Path, shapes: Sequence[tuple[int, ...]], option: str
) -> list[CalibratedCamera]:
    """As many cameras from a calibration file as there are picture sizes; lengths in mm."""
    cameras = read_calibration(path, (shapes[0][1], shapes[0][0]), choices.calibration_unit)
    if len(cameras) < len(shapes):
        raise InputError(f"{option}: {path}: got {len(cameras)} cameras; expected {len(shapes)}")
    result = []
    first = np.linalg.inv(cameras[0].camera_from_world)
    for camera, shape in zip(cameras, shapes, strict=False):
        if (camera.height, camera.width) != tuple(shape):
            raise InputError(
                f"{option}: {path}: camera {camera.name!r} has {camera.width}x{camera.height} px; "
                f"expected {shape[1]}x{shape[0]} as its pictures"
            )
        pose = camera.camera_from_world @ first
        result.append(
            rig_camera((camera.width, camera.height), camera.K, camera.distortion, pose[:3, :3],
                       1000.0 * pose[:3, 3], camera.name)
        )  # fmt: skip
    return result


def _alike(path: Path, shape: tuple[int, ...], reference: Path) -> npt.NDArray[Any]:
    """The picture at ``path``; InputError if it isn't of the reference's size: then the same pixel
    isn't the same place of the sensor."""
    picture = read_grey(path)
    if picture.shape != shape:
        got, expected = (f"{size[1]} x {size[0]} px" for size in (picture.shape, shape))
        raise InputError(
            f"image file: {path}: not of {reference.name}'s size; got {got}; expected {expected}"
        )
    return picture


def _check_files(paths: Sequence[Path]) -> None:
    missing = [str(path) for path in paths if not picture_file(path)[0].exists()]
    if missing:
        raise InputError(
            f"image file{'s' if len(missing) > 1 else ''} not found: {', '.join(missing)}"
        )


def _check_choices(choices: Choices) -> None:
    if choices.strain_window < 3 or choices.strain_window % 2 == 0:
        raise InputError(
            f"--strain-window: got {choices.strain_window}; expected an odd number >= 3"
        )


def _roi(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--roi: got {text!r}; expected X0,Y0,X1,Y1 in whole pixels") from None
    return x0, y0, x1, y1


def _mask(path: Path, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    image = read_grey(path)
    if image.shape != shape:
        raise InputError(
            f"--mask: {path}: got {image.shape[1]}x{image.shape[0]} px; expected "
            f"{shape[1]}x{shape[0]} as the reference"
        )
    return np.asarray(image > 0)


def _settings(reference: Path, choices: Choices, device: Device | None) -> dict[str, Any]:
    given = {key: value for key, value in vars(choices).items() if key not in UNSAID}
    given |= {key: str(given[key] or word) for key, word in MISSING.items()}
    adapter = "none (NumPy)" if device is None else str(device.info.get("device", ""))
    return {"reference": str(reference), **given, "adapter": adapter, "version": __version__}


def _print(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    wide = max(5, max(len(Path(row["image"]).name) for row in rows)) + 2
    flat = ("u_mean", "v_mean", "sigma_median")
    keys = flat if flat[0] in rows[0] else ("U_mean", "V_mean", "W_mean", "sigma_median_mm")
    heads = [key.replace("_mean", "").replace("_median", "").replace("_", " ") for key in keys]
    out()
    unit = "px" if keys == flat else "mm"
    titles = "".join(f"{head if 'sigma' in head else f'mean {head} {unit}':>11}" for head in heads)
    out(f"{'image':<{wide}}{'measured':>16}{titles}")
    for row in rows:
        name, share = Path(row["image"]).name, f"{row['measured']} of {row['points']}"
        numbers = "".join(f"{'':>11}" if row[key] is None else f"{row[key]:>11.4f}" for key in keys)
        out(f"{name:<{wide}}{share:>16}{numbers}")
        lost = {k: n for k, n in row["counts"].items() if k != "OK"}
        if lost:
            out(f"{'':<{wide}}  " + ", ".join(f"{n} {k.lower()}" for k, n in lost.items()))
    out()
    out(f"Report: {folder / 'report.html'}")


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
