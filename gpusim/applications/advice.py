"""Settings advised for a picture file, and why written as a page."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.applications.correlation import check_files, read_mask
from gpusim.files.atomic_files import PathLike, write_text
from gpusim.files.frame_source import read_still
from gpusim.files.output_folder import claim, inside
from gpusim.measure import ImageNoise, advise
from gpusim.report.advice import advice_page, advice_summary, draw_advice
from gpusim.report.text import plain_data
from gpusim.validation import FromZero, checked


@checked
def advise_files(
    picture: PathLike,
    output: PathLike | None = None,
    *,
    still: PathLike | None = None,
    mask: PathLike | None = None,
    roi: tuple[int, int, int, int] | None = None,
    noise: FromZero | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Find the settings that err least on a picture; with an ``output``, write a page about it.

    Returns what report.json holds: ``settings``, the ``command`` that uses them, the ``reason``.

    Parameters
    ----------
    picture : a file, the reference of the correlation.
    output : a folder, made if need be, for report.html, report.json and the figure.
    still : a second picture of the same scene at rest, for the noise.
    mask : a picture whose black pixels aren't used.
    noise : standard deviation of the picture's noise, grey levels, if it is known.
    roi, options : as of ``gs.measure.advise``.

    Raises
    ------
    InputError
        As ``gs.measure.advise``, or files that are wrong.

    Examples
    --------
    >>> report = gs.applications.advise_files("before.png", detail_px=60, backend="numpy")
    >>> report["command"].split(" --subset")[0]
    'gpusim dic before.png DEF... -o OUT'
    """
    check_files(picture, *([] if still is None else [still]))
    image = read_still(picture)
    known = None if noise is None else ImageNoise(noise**2)
    second = None if still is None else read_still(still)
    pixels = read_mask(mask, image.shape)
    advice = advise(image, still=second, roi=roi, mask=pixels, noise=known, **options)
    given = {"roi": roi and ",".join(map(str, roi)), "mask": mask} | advice.settings
    words = [f"--{name.replace('_', '-')} {shlex.quote(str(value))}"
             for name, value in given.items() if value is not None]  # fmt: skip
    command = " ".join(["gpusim dic", shlex.quote(str(picture)), "DEF... -o OUT", *words])
    head = {"schema": 1, "version": __version__, "picture": Path(picture).name, "command": command}
    report: dict[str, Any] = plain_data(head | advice_summary(advice))
    if output is not None:
        with claim(output) as folder:
            figure = draw_advice(advice, inside(folder, "advice.png"))
            write_text(inside(folder, "report.json"), json.dumps(report, indent=2) + "\n")
            write_text(inside(folder, "report.html"), advice_page(report, figure))
    return report
