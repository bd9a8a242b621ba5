"""``gpusim dic``: pictures correlated, written as tables, maps and a page."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.cli.console import ProgressDisplay, out
from gpusim.errors import InputError, NotConverged
from gpusim.export.correlation import read_grey, write_correlation
from gpusim.export.files import safe_name, write_text
from gpusim.gpu import Device
from gpusim.measure import DicResult, dic_sequence, strain
from gpusim.measure.dic import Start
from gpusim.measure.sequence import Update
from gpusim.measure.strain import StrainKind
from gpusim.measure.warp import Shape
from gpusim.report.correlation import correlation_page, summary
from gpusim.report.maps import draw_maps
from gpusim.report.model import Figure

__all__ = ["Choices", "correlate_files"]

_SCHEMA = 1


@dataclass(frozen=True)
class Choices:
    """What the command line says beside the files; names as in ``dic`` and ``strain``."""

    subset: int
    step: int
    shape: Shape
    roi: str | None
    mask: Path | None
    update: Update
    start: Start
    search_px: int
    blur_px: float
    min_zncc: float
    tolerance: float
    strain: StrainKind | Literal["none"]
    strain_window: int
    formats: tuple[str, ...]
    backend: str


def correlate_files(
    reference: Path,
    deformed: Sequence[Path],
    folder: Path,
    choices: Choices,
    quiet: bool,
    as_json: bool,
) -> None:
    """Correlate files and write ``<number>_<name>.csv`` (or other formats), maps, ``report.html``.

    Everything is checked before the first image is measured. Raises InputError for files and
    choices that are wrong, NotConverged, after all is written, if an image has no point measured.
    """
    _check_choices(choices)
    missing = [str(path) for path in (reference, *deformed) if not path.is_file()]
    if missing:
        raise InputError(
            f"image file{'s' if len(missing) > 1 else ''} not found: {', '.join(missing)}"
        )
    first = read_grey(reference)
    roi = _roi(choices.roi)
    mask = None if choices.mask is None else _mask(choices.mask, first.shape)
    device = Device() if choices.backend == "gpu" else None
    rows: list[dict[str, Any]] = []
    figures: list[tuple[str, Figure]] = []
    settings = _settings(reference, choices, device)
    with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
        clock = time.perf_counter()

        def keep(number: int, result: DicResult) -> None:
            nonlocal clock
            found = None
            if choices.strain != "none":
                found = strain(result, window=choices.strain_window, kind=choices.strain)
            seconds = time.perf_counter() - clock
            path = deformed[number]
            name = f"{number + 1:04d}_{safe_name(path.stem)}"
            notes = settings | {"reference": str(reference), "deformed": str(path)}
            for suffix in choices.formats:
                write_correlation(folder / f"{name}.{suffix}", result, found, notes)
            row = summary(str(path), result, found, seconds)
            figures.append((path.name, draw_maps(first, result, found, folder / f"{name}.png")))
            rows.append(row)
            progress(
                "dic", (number + 1) / len(deformed), f"{path.name}: {row['measured']} measured"
            )
            clock = time.perf_counter()

        dic_sequence(
            first,
            (read_grey(path) for path in deformed),
            update=choices.update,
            subset=choices.subset,
            step=choices.step,
            roi=roi,
            mask=mask,
            progress=keep,
            shape=choices.shape,
            start=choices.start,
            search_px=choices.search_px,
            blur_px=choices.blur_px,
            min_zncc=choices.min_zncc,
            tolerance=choices.tolerance,
            device=device,
        )
    report = {"schema": _SCHEMA, "version": __version__, "settings": settings, "images": rows}
    text = json.dumps(report, indent=2)
    write_text(folder / "report.json", text + "\n")
    write_text(folder / "report.html", correlation_page(reference.name, rows, figures, settings))
    if as_json:
        out(text)
    elif not quiet:
        _print(rows, folder)
    empty = [row["image"] for row in rows if row["measured"] == 0]
    if empty:
        raise NotConverged(
            f"dic: no point could be measured in {', '.join(empty)}; "
            f"{folder / 'report.html'} says why"
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
    return {
        "reference": str(reference),
        "subset": choices.subset,
        "step": choices.step,
        "shape": choices.shape,
        "roi": choices.roi or "all",
        "mask": str(choices.mask or "none"),
        "update": choices.update,
        "start": choices.start,
        "search_px": choices.search_px,
        "blur_px": choices.blur_px,
        "min_zncc": choices.min_zncc,
        "tolerance": choices.tolerance,
        "strain": choices.strain,
        "strain_window": choices.strain_window,
        "adapter": "none (NumPy)" if device is None else str(device.info.get("device", "")),
        "version": __version__,
    }


def _print(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    wide = max(5, max(len(Path(row["image"]).name) for row in rows)) + 2
    out()
    out(f"{'image':<{wide}}{'measured':>16}{'mean u':>10}{'mean v':>10}{'sigma':>10}")
    for row in rows:
        name, share = Path(row["image"]).name, f"{row['measured']} of {row['points']}"
        numbers = "".join(
            f"{'':>10}" if row[key] is None else f"{row[key]:>10.4f}"
            for key in ("u_mean", "v_mean", "sigma_median")
        )
        out(f"{name:<{wide}}{share:>16}{numbers}")
        lost = {k: n for k, n in row["counts"].items() if k != "OK"}
        if lost:
            out(f"{'':<{wide}}  " + ", ".join(f"{n} {k.lower()}" for k, n in lost.items()))
    out()
    out(f"Report: {folder / 'report.html'}")
