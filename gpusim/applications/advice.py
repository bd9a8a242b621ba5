"""Settings advised for a picture file, and why written as a page."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.applications.correlation import check_files, read_mask
from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import PathLike, write_text
from gpusim.files.output_folder import claim, inside
from gpusim.files.picture_file import read_grey
from gpusim.measure import Advice, ImageNoise, advise
from gpusim.report.advice import advice_page, advice_summary, draw_advice
from gpusim.report.text import plain_data
from gpusim.validation import FromZero, checked


@dataclass(frozen=True)
class AdviceOutput:
    """What is advised, what report.json holds, and the files that were written.

    Examples
    --------
    >>> done = gs.applications.advise_files("before.png", detail_px=60, backend="numpy")
    >>> done.report["command"].split(" --subset")[0], done.files
    ('gpusim dic before.png DEF... -o OUT', [])
    """

    advice: Advice
    report: dict[str, Any]
    files: Sequence[Path] = field(default_factory=list)
    __repr__ = field_summary


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
) -> AdviceOutput:
    """Find the settings that err least on a picture; with an ``output``, write a page about it.

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
    >>> done = gs.applications.advise_files("before.png", "advice", detail_px=60, backend="numpy")
    >>> [path.name for path in done.files]
    ['advice.png', 'report.json', 'report.html']
    """
    check_files(picture, *([] if still is None else [still]))
    image = read_grey(picture)
    known = None if noise is None else ImageNoise(noise**2)
    second = None if still is None else read_grey(still)
    pixels = read_mask(mask, image.shape)
    advice = advise(image, still=second, roi=roi, mask=pixels, noise=known, **options)
    given = {"roi": roi and ",".join(map(str, roi)), "mask": mask} | advice.settings
    words = [f"--{name.replace('_', '-')} {shlex.quote(str(value))}"
             for name, value in given.items() if value is not None]  # fmt: skip
    command = " ".join(["gpusim dic", shlex.quote(str(picture)), "DEF... -o OUT", *words])
    head = {"schema": 1, "version": __version__, "picture": Path(picture).name, "command": command}
    report = plain_data(head | advice_summary(advice))
    if output is None:
        return AdviceOutput(advice, report)
    with claim(output) as folder:
        figure = draw_advice(advice, inside(folder, "advice.png"))
        text = json.dumps(report, indent=2) + "\n"
        page = advice_page({k: v for k, v in report.items() if k != "version"}, figure)
        files = [figure.path, write_text(inside(folder, "report.json"), text),
                 write_text(inside(folder, "report.html"), page)]  # fmt: skip
    return AdviceOutput(advice, report, files)
