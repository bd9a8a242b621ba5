"""report.html: one self-contained page, readable without network, server or script."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.export.images import Picture, encoded_picture, read_image
from gpusim.files.input_file import read_input
from gpusim.files.picture_file import read_picture
from gpusim.printable import printable
from gpusim.report.model import Figure, FramePair, Measurement, Report, Stage
from gpusim.report.stage_rows import stage_rows
from gpusim.report.text import duration, number, percent, signed_percent
from gpusim.validation import require

if TYPE_CHECKING:
    from jinja2 import Environment, Template

_PHOTO_WIDTH = 1800  # px
_PAGE_WIDTH = 1600  # px of a down-scaled frame, at most: sharp on a wide screen
_CROP = 72  # px of a full-resolution crop per side
_CROP_ZOOM = 4
_MAX_CROPS = 4
_SERIES = 3  # frames: first and last are shown beside each other anyway
_SLIDES = 25  # of a slider; more frames are thinned out
SECTIONS = (
    "explanations", "series", "overlays", "errors", "load_path", "convergence", "other"
)  # fmt: skip
"""Of the page, with figures."""
SLIDE_BYTES, PAIR_BYTES = 1_200_000, 1_200_000  # of all sliders and pairs of a page
FILM_BYTES = 2_000_000  # of one film

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Slide:
    """A picture of a slider: what is said of it, the file, and its data URI."""

    label: str
    path: Path
    uri: str


@dataclass(frozen=True)
class Slides:
    """A slider over frames: its ``slides``, and which frames these are of ``count``."""

    title: str
    caption: str
    slides: tuple[Slide, ...]
    count: int

    @property
    def shown(self) -> str:
        """Which frames there are."""
        step = -(-(self.count - 1) // (_SLIDES - 1))
        return f"1 in {step} of {self.count} frames" if step > 1 else f"{self.count} frames"


def slides_of(
    title: str, caption: str, pictures: Sequence[tuple[str, Path]], share: float, bits: int = 0
) -> Slides:
    """A slider of pictures, each with what is said of it, the last among them.

    They are made small enough for a ``share`` of what a page may hold. Raises InputError if one
    can't be read.
    """
    count = len(pictures)
    step = max(1, -(-(count - 1) // (_SLIDES - 1)))
    shown = [pictures[k] for k in range((count - 1) % step, count, step)]

    room = share * SLIDE_BYTES / len(shown)

    def slide(picture: tuple[str, Path]) -> Slide:
        label, path = picture
        image = np.ascontiguousarray(read_picture(path))
        return Slide(label, path, _jpeg_uri(image, _PAGE_WIDTH, 80, bits, room))

    with ThreadPoolExecutor() as pool:
        slides = tuple(pool.map(slide, shown))
    return Slides(title, caption, slides, count)


@dataclass(frozen=True)
class PagePair:
    """A frame pair as data URIs, ready for the page; crops are (label, reference, deformed)."""

    source: FramePair
    width: int
    height: int
    bits: int
    reference: str
    deformed: str
    crops: tuple[tuple[str, str, str], ...]


def page_pair(pair: FramePair, room: float = math.inf) -> PagePair:
    """Read both images and return what the page embeds, each in ``room`` bytes.

    Raises InputError if an image can't be read or the two differ in size.
    """
    reference, deformed = read_image(pair.reference), read_image(pair.deformed)
    what, got = f"frame pair of camera {pair.camera!r}", f"{reference.shape} and {deformed.shape}"
    require(reference.shape == deformed.shape, what, got, "two images of one size")
    height, width = reference.shape[:2]
    bits = pair.bits or max(_bits_of(reference), _bits_of(deformed))
    crops = tuple(
        (label, _crop_uri(reference, x0, y0, bits), _crop_uri(deformed, x1, y1, bits))
        for label, x0, y0, x1, y1 in pair.crops[:_MAX_CROPS]
        if np.isfinite([x0, y0, x1, y1]).all()
    )
    return PagePair(
        pair,
        width,
        height,
        bits,
        _jpeg_uri(reference, _PAGE_WIDTH, 86, bits, room),
        _jpeg_uri(deformed, _PAGE_WIDTH, 86, bits, room),
        crops,
    )


def file_uri(path: Path) -> str:
    """Return a PNG file as a data URI."""
    try:
        return data_uri("image/png", read_input(path, "a figure").data)
    except InputError as error:
        raise InputError(f"figure: {path}: can't be read ({error})") from None


def film_uri(path: Path, folder: Path) -> str:
    """Return a film as the page has it: in itself, or if it is large beside it."""
    data = read_input(path, "a film").data
    return data_uri("video/mp4", data) if len(data) <= FILM_BYTES else link(path, folder)


def photo_uri(path: Path) -> str:
    """Return a picture file as the data URI of a JPEG no wider than the page shows it sharply."""
    return _jpeg_uri(np.ascontiguousarray(read_picture(path)), _PHOTO_WIDTH, 88)


def _jpeg_uri(
    image: Picture, widest: int, quality: int, bits: int = 0, room: float = math.inf
) -> str:
    """Down-scale by area average and encode as JPEG, in about ``room`` bytes; levels of ``bits``
    become 8."""
    width = float(min(widest, image.shape[1]))
    data = _jpeg(image, width, quality, bits)
    if len(data) > room:
        data = _jpeg(image, width * math.sqrt(room / len(data)), quality, bits)
    return data_uri("image/jpeg", data)


def _jpeg(image: Picture, width: float, quality: int, bits: int) -> bytes:
    small = reduced(image, fitting(image.shape, width), bits)
    return encoded_picture(small, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality])


def fitting(shape: tuple[int, ...], width: float, height: float = math.inf) -> tuple[int, int]:
    """Width and height of a picture (H, W, …), made smaller to at most these."""
    factor = min(1.0, width / shape[1], height / shape[0])
    return max(1, round(factor * shape[1])), max(1, round(factor * shape[0]))


def reduced(image: Picture, size: tuple[int, int], bits: int = 0) -> Bytes:
    """``image`` as 8 bit of ``size`` (width, height), by area average; of ``bits`` (0: as few as
    hold its grey levels)."""
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return _eight_bit(small, bits or _bits_of(image))


def _crop_uri(image: Picture, x: float, y: float, bits: int) -> str:
    """Cut a square around (x, y) and enlarge each pixel to a square, so that pixels can be seen."""
    height, width = image.shape[:2]
    side = min(_CROP, height, width)
    left = min(max(round(x) - side // 2, 0), width - side)
    top = min(max(round(y) - side // 2, 0), height - side)
    part = _eight_bit(image[top : top + side, left : left + side], bits)
    large = part.repeat(_CROP_ZOOM, axis=0).repeat(_CROP_ZOOM, axis=1)
    return data_uri("image/png", encoded_picture(large, ".png"))


def _bits_of(image: Picture) -> int:
    """8 to 16: as few as hold its grey levels, which cameras with 10, 12 or 14 don't shift up."""
    return max(8, int(image.max(initial=0)).bit_length())


def _eight_bit(image: npt.NDArray[Any], bits: int) -> Bytes:
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    return np.asarray(np.minimum(image.astype(np.uint16) >> (bits - 8), 255), dtype=np.uint8)


def data_uri(media: str, data: bytes) -> str:
    """A file as a page holds it."""
    return f"data:{media};base64,{base64.b64encode(data).decode('ascii')}"


@cache
def page_template(name: str) -> Template:
    """The template ``name`` of the folder ``page``; what it is given goes to its ``render``."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # at the end of a run

    environment = Environment(
        loader=PackageLoader("gpusim.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    formats = (number, percent, signed_percent, aligned, duration, file_uri, photo_uri, film_uri,
               link)  # fmt: skip
    environment.filters.update({one.__name__: one for one in formats})
    return environment


def aligned(item: Measurement) -> tuple[str, str, str]:
    """Return measured, truth and error with as many decimals as show the error to three digits, if
    these are seven digits in all at most."""
    known = math.isfinite(item.error) and item.error != 0.0
    decimals = 2 - math.floor(math.log10(abs(item.error))) if known else -1
    if decimals < 0 or max(abs(item.measured), abs(item.truth)) * 10.0**decimals >= 1e7:
        return number(item.measured), number(item.truth), number(item.error, 3)
    texts = (f"{value:.{decimals}f}" for value in (item.measured, item.truth, item.error))
    measured, truth, error = (text.replace("-", "\N{MINUS SIGN}") for text in texts)
    return measured, truth, error


def _shown(value: object) -> object:
    """What a template's expression becomes: texts that other people wrote made printable."""
    if value is None:
        return ""
    if isinstance(value, str) and not hasattr(value, "__html__"):
        return printable(value, keep="\n\t")
    return value


def link(path: Path, folder: Path) -> str:
    """Return a URL of ``path`` relative to ``folder``."""
    relative = os.path.relpath(Path(path).resolve(), Path(folder).resolve())
    return quote(Path(relative).as_posix())


def render_html(report: Report, figures: Mapping[str, Sequence[Figure]], folder: Path) -> str:
    """Return the page as text, with the ``figures`` of its `SECTIONS`.

    Pictures are embedded; links to full-size files are relative to ``folder``, where the page will
    be written. Raises InputError if a picture can't be read.
    """
    room = PAIR_BYTES / max(1, 2 * len(report.frames))
    several = [pair for pair in report.frames if len(pair.frames) >= _SERIES]
    together = [list(alike) for _, alike in groupby(figures.get("other", ()), _slider)]
    share = 1.0 / max(1, len(several) + sum(len(alike) > 1 for alike in together))
    maps = [
        slides_of(alike[0].title, alike[-1].caption, [(f.frame, f.path) for f in alike], share)
        if len(alike) > 1 else alike[0]
        for alike in together
    ]  # fmt: skip
    sliders = [
        slides_of(f"camera {pair.camera}", "", pair.frames, share, pair.bits) for pair in several
    ]
    return page_template("report.html.j2").render(
        folder=folder,
        report=report,
        figures={name: figures.get(name, ()) for name in SECTIONS},
        maps=maps,
        sliders=sliders,
        pairs=[page_pair(pair, room) for pair in report.frames],
        headline=report.measurements[0] if report.measurements else None,
        total=sum(stage.seconds for stage in report.stages if math.isfinite(stage.seconds)),
        bars=_bars(report.stages),
    )


def _slider(figure: Figure) -> object:
    """What figures of one slider have in common."""
    return figure.title if figure.frame else figure


def _bars(stages: Sequence[Stage]) -> list[tuple[Stage, float]]:
    """Pair each row of stages with the length of its bar, per cent of the longest."""
    rows = []
    for name, alike in stage_rows(stages):
        pictures = f"; {len(alike)} pictures" if len(alike) > 1 else ""
        seconds = sum(stage.seconds for stage in alike)
        rows.append(Stage(name, alike[0].state, alike[0].reason + pictures, seconds))
    longest = max((s.seconds for s in rows if math.isfinite(s.seconds)), default=0.0)
    return [
        (row, 100.0 * row.seconds / longest if longest > 0 and math.isfinite(row.seconds) else 0)
        for row in rows
    ]
