"""report.html and the figures, on small asymmetric images."""

# ruff: noqa: RUF001  (typographic signs are what is tested)
from __future__ import annotations

import base64
import json
import math
import re
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export import write_image
from gpusim.report import (
    FieldPicture,
    Figure,
    FramePair,
    Link,
    LoadPath,
    Measurement,
    Overlay,
    Report,
    ReportPaths,
    Series,
    SolutionSummary,
    Stage,
    write_report,
)
from gpusim.report.figures import (
    draw_convergence,
    draw_errors,
    draw_overlay,
    draw_series,
)
from gpusim.report.html import SLIDE_BYTES, page_pair, slides_of

pytestmark = pytest.mark.drawn

VOID = {"meta", "link", "img", "input", "br", "source", "hr"}


class Page(HTMLParser):
    """Collects texts, references and tags, and checks that tags are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value or "" for key, value in attrs if key in ("src", "href", "srcset")]
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] not in ("style", "script"):
            self.text += data.replace("\u202f", " ")


def make_report(folder: Path, bits: int = 8) -> Report:
    """A report with everything in it; images are 57 wide and 33 high."""
    dtype = np.uint8 if bits == 8 else np.uint16
    ramp = np.linspace(0, np.iinfo(dtype).max, 33 * 57).reshape(33, 57).astype(dtype)
    reference = write_image(folder / "images/front/0000.png", ramp)
    deformed = write_image(folder / "images/front/0001.png", ramp[::-1])
    x = np.array([10.0, 20.0, 40.0])
    measured = np.array([-1.0, np.nan, -4.02])
    points = np.array([[5.0, 6.0], [20.0, 8.0], [50.0, 30.0]])
    moved = np.array([[0.5, -0.25], [np.nan, np.nan], [0.0, 3.0]])
    return Report(
        scene="crane <b>",
        adapter="llvmpipe",
        status="done",
        description="A & B",
        stages=(
            Stage("mesh", "run", "1 body", 0.25),
            Stage("solve", "reused", "nothing it depends on changed", 0.001),
            Stage("shadow", "skipped", "no light casts shadows", 0.0),
        ),
        solution=SolutionSummary(52341, 3, True, 3e-7),
        measurements=(
            Measurement.compare("tip", "mm", -4.02, -4.0, tolerance_relative=1e-3),
            Measurement.compare("middle", "mm", math.nan, -2.0),
            Measurement.compare("quarter", "mm", -0.5003, -0.5, tolerance_relative=1e-3),
            Measurement.compare("mean exx", "um/m", 320.0, 1e-9),
            Measurement.compare("scale", "mm/px", 0.2001, 0.2, tolerance_relative=1e-3),
        ),
        warnings=("marker beam-02 was lost",),
        facts={"Driver": "Mesa"},
        scene_text='name = "crane" # <script>alert(1)</script>\n',
        frames=(FramePair("front", reference, deformed, "13 N", (("m1", 5, 6, 5.5, 5.75),)),),
        series=(Series("beam line", x, measured, -x / 10, "x (mm)", "deflection", "mm", 0.2),),
        overlays=(Overlay("Tracked markers", reference, points, moved, 0.2),),
        residuals=(1.0, 0.1, 0.0, 1e-7),
        tolerance=1e-6,
        links=(Link("Truth", folder / "truth #1.h5"),),
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ReportPaths]:
    """The full report, written once: its folder and what `write_report` answered."""
    folder = tmp_path_factory.mktemp("out")
    return folder, write_report(make_report(folder, 16), folder)


def test_the_page_is_complete_and_self_contained(written: tuple[Path, ReportPaths]) -> None:
    folder, paths = written
    text = paths.html.read_text("utf-8")
    assert "http" not in text and "@import" not in text and "//cdn" not in text
    assert not re.search(r"url\((?!data:)", text)
    page = Page(text)
    outside = [link for link in page.references if not link.startswith("data:")]
    assert set(outside) == {
        "images/front/0000.png",
        "images/front/0001.png",
        "truth%20%231.h5",
        "report.json",
        *(path.relative_to(folder).as_posix() for path in paths.figures),
    }
    for words in (
        "crane <b>",
        "A & B",
        "marker beam-02 was lost",
        "−4.0200",
        "−0.500 %",
        "beyond 0.10 %",
        "not measured",
        "52 341",
        "no light casts shadows",
        "nothing it depends on changed",
        "57 × 33 px",
        "<script>alert(1)</script>",
        "Mesa",
    ):
        assert words in page.text, words
    assert "10¹³" not in page.text  # of a truth that is zero but for rounding
    assert "<b>" not in text.replace("<b>mesh</b>", "")  # the scene's name was escaped
    assert "nan" not in page.text.lower().split()
    assert sum(link.startswith("data:image/") for link in page.references) == 2 + 2 + 4
    assert "table" in page.tags and "details" in page.tags


def test_files_are_whole_and_named_in_the_answer(written: tuple[Path, ReportPaths]) -> None:
    folder, paths = written
    assert paths.json.read_text("utf-8") == make_report(folder, 16).to_json()
    assert len(paths.figures) == 4
    for path in paths.figures:
        picture = cv2.imread(str(path))
        assert picture is not None and picture.shape[1] == 1440
        assert picture.std() > 5.0  # something was drawn
    assert not list(folder.rglob("*.part"))
    first = paths.html.read_bytes()
    assert write_report(make_report(folder, 16), folder).html.read_bytes() == first


def test_many_lines_stand_side_by_side_below_their_numbers(
    written: tuple[Path, ReportPaths], tmp_path: Path
) -> None:
    few = written[1].html.read_text(encoding="utf-8")
    assert few.index("line-1") < few.index('scope="col">Quantity') and "several" not in body(few)
    report = make_report(tmp_path)
    series = tuple(replace(report.series[0], name=f"line {k}") for k in range(4))
    overlays = tuple(replace(report.overlays[0], title=f"points {k}") for k in range(4))
    many = replace(report, series=series, overlays=overlays)
    page = write_report(many, tmp_path).html.read_text(encoding="utf-8")
    assert page.index('scope="col">Quantity') < page.index("line-4")
    assert body(page).count('<div class="several">') == 2 and "<h2>In the picture</h2>" in page


def body(page: str) -> str:
    """Without style and script."""
    return page.partition("<body")[2]


def test_a_failed_run_says_what_and_why(tmp_path: Path) -> None:
    report = Report(
        "crane",
        "llvmpipe",
        "failed",
        stages=(
            Stage("solve", "failed", "stagnated", 2.0),
            Stage("render", "skipped", "no solution", 0.0),
        ),
        failure="solve: not converged after 7 iterations",
    )
    page = Page(write_report(report, tmp_path).html.read_text("utf-8"))
    assert "The run failed" in page.text
    assert "not converged after 7 iterations" in page.text
    assert "stagnated" in page.text and "no solution" in page.text
    assert "figure" not in page.tags and "table" not in page.tags


def test_the_headline_is_the_first_quantity_even_if_it_was_not_measured(tmp_path: Path) -> None:
    lost = Measurement.compare("tip", "mm", np.nan, 3.0, tolerance_relative=0.001)
    scale = Measurement.compare("scale", "mm/px", 0.2, 0.2, tolerance_relative=0.001)
    report = Report(scene="x", adapter="none", status="done", stages=(), solution=None,
                    measurements=(lost, scale))  # fmt: skip
    page = write_report(report, tmp_path).html.read_text(encoding="utf-8")
    cards = page[page.index('class="cards"') :].split("</section>")[0]
    assert "tip, measured" in cards and "scale" not in cards
    assert 'class="card bad"' in cards and 'class="card good"' not in cards
    assert not (tmp_path / "figures" / "errors.png").exists()  # a bar for one error says nothing


def test_an_empty_report_still_makes_a_page(tmp_path: Path) -> None:
    page = Page(write_report(Report("a", "b", "done"), tmp_path).html.read_text("utf-8"))
    assert "a" in page.text and "Measured against true" not in page.text


def test_a_missing_picture_is_named_and_the_json_is_there(tmp_path: Path) -> None:
    absent = partial(Figure, tmp_path / "absent.png", "Extra", "none")
    report = Report("crane", "llvmpipe", "done", figures=(absent,))
    with pytest.raises(InputError, match=r"absent\.png: can't be read"):
        write_report(report, tmp_path)
    told = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert told["status"] == "failed" and "absent.png" in told["warnings"][0]
    assert not (tmp_path / "report.html").exists()
    assert not list(tmp_path.rglob("*.part"))


def decoded(uri: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize(("bits", "said"), [(8, 8), (12, 12), (12, 0), (16, 16), (16, 0)])
def test_crops_show_the_named_pixels_unchanged(tmp_path: Path, bits: int, said: int) -> None:
    dtype = np.uint8 if bits == 8 else np.uint16
    shape = (190, 330)
    image = np.random.default_rng(1).integers(0, 2**bits, shape).astype(dtype)
    other = image[::-1, ::-1]
    a = write_image(tmp_path / "a.png", image)
    b = write_image(tmp_path / "b.png", other)
    crops = (
        ("inner", 100.2, 80.0, 200.0, 90.0),
        ("corner", 0, 189, 329, 0),
        ("x", np.nan, 0, 0, 0),
    )
    pair = page_pair(FramePair("front", a, b, "", crops, said))
    assert (pair.width, pair.height, pair.bits) == (330, 190, bits)
    assert [label for label, _, _ in pair.crops] == ["inner", "corner"]
    eight, eight_other = ((array >> (bits - 8)).astype(np.uint8) for array in (image, other))
    (_, inner, inner_other), (_, corner, corner_other) = pair.crops
    assert np.array_equal(decoded(inner)[::4, ::4], eight[44:116, 64:136])
    assert np.array_equal(decoded(inner_other)[3::4, 3::4], eight_other[54:126, 164:236])
    assert np.array_equal(decoded(corner)[::4, ::4], eight[118:, :72])
    assert np.array_equal(decoded(corner_other)[::4, ::4], eight_other[:72, 258:])
    assert decoded(pair.reference).shape == shape
    assert decoded(pair.reference).mean() == pytest.approx(eight.mean(), abs=1.5)
    least = page_pair(FramePair("front", a, b, "", bits=said), room=9000)
    assert len(least.deformed) < 1.5 * 9000 < len(pair.deformed)


def test_frames_and_crops_keep_their_colours(tmp_path: Path) -> None:
    """In OpenCV's order, as they are decoded here; red comes first in the files."""
    image = np.random.default_rng(1).integers(0, 4096, (190, 330, 3), np.uint16)
    image[..., 0] //= 4
    path = write_image(tmp_path / "a.png", image)
    pair = page_pair(FramePair("front", path, path, "", (("inner", 100, 80, 100, 80),), 12))
    assert (pair.width, pair.height) == (330, 190)
    eight = (image[..., ::-1] >> 4).astype(np.uint8)
    assert np.array_equal(decoded(pair.crops[0][1])[::4, ::4], eight[44:116, 64:136])
    blue, _, red = decoded(pair.reference).mean(axis=(0, 1))  # noise, of which JPEG keeps little
    assert red < 0.4 * blue


def test_frames_of_two_sizes_are_refused(tmp_path: Path) -> None:
    a = write_image(tmp_path / "a.png", np.zeros((33, 57), np.uint8))
    b = write_image(tmp_path / "b.png", np.zeros((57, 33), np.uint8))
    with pytest.raises(InputError, match=r"got \(33, 57\) and \(57, 33\)"):
        page_pair(FramePair("front", a, b, ""))


def test_captions_state_the_numbers(tmp_path: Path) -> None:
    report = make_report(tmp_path)
    line = draw_series(report.series[0], tmp_path / "a.png")
    assert line.caption == (
        "2 of 3 points measured; difference to the truth 0.014 mm RMS, at most 0.020 mm (0.10 px)."
    )
    tracked = draw_overlay(report.overlays[0], tmp_path / "b.png")
    assert tracked.photo
    assert tracked.caption == (
        "2 of 3 points tracked; displacements drawn 2 times their length, the longest is"
        " 3.00 px = 0.6 mm; crosses mark those that were lost."
    )
    solved = draw_convergence(report.residuals, tmp_path / "c.png")
    assert "before each of 4 iterations, the last one 1.0×10⁻⁷." in solved.caption


def test_figures_of_awkward_data(tmp_path: Path) -> None:
    zero = np.zeros(2)
    nothing = Series("s", zero, np.full(2, np.nan), zero, "x", "y", "mm")
    assert draw_series(nothing, tmp_path / "a.png").caption == "0 of 2 points measured."
    exact = Series("s", np.arange(2.0), zero, zero, "x", "y", "mm", 0.1)
    assert "at most 0 mm" in draw_series(exact, tmp_path / "b.png").caption
    draw_convergence([math.nan], tmp_path / "c.png")
    draw_errors([Measurement.compare("a", "mm", 1.0, 1.0)], tmp_path / "d.png")
    with pytest.raises(InputError, match="expected at least one"):
        draw_errors([Measurement.compare("a", "mm", 1.0, 0.0)], tmp_path / "e.png")
    with pytest.raises(InputError, match="not empty"):
        draw_convergence([], tmp_path / "e.png")
    image = write_image(tmp_path / "i.png", np.zeros((33, 57), np.uint16))
    still = Overlay("o", image, np.ones((1, 2)), np.zeros((1, 2)))
    assert draw_overlay(still, tmp_path / "f.png").caption == "1 of 1 points tracked."
    assert not (tmp_path / "e.png").exists()


def textured(folder: Path, count: int) -> list[tuple[str, Path]]:
    """Pictures that JPEG makes little of, the k-th with its number as its mean."""
    rng = np.random.default_rng(3)
    noise = rng.integers(-40, 40, (400, 600))
    return [
        (f"time {k}", write_image(folder / f"{k}.png", (noise + 60 + k).astype(np.uint8)))
        for k in range(count)
    ]


def test_a_slider_thins_out_ends_with_the_last_and_keeps_to_its_share(
    tmp_path: Path,
) -> None:
    pictures = textured(tmp_path, 60)
    shown = slides_of("camera front", "", pictures, 0.2)
    assert [slide.label for slide in shown.slides] == [f"time {k}" for k in range(2, 60, 3)]
    assert shown.shown == "1 in 3 of 60 frames"
    assert sum(len(slide.uri) for slide in shown.slides) < 1.5 * 0.2 * SLIDE_BYTES
    for slide in (shown.slides[0], shown.slides[-1]):
        number = int(slide.label.split()[1])
        assert decoded(slide.uri).mean() == pytest.approx(60 + number, abs=1.5)
    few = slides_of("camera front", "", pictures[:3], 1.0)
    assert few.shown == "3 frames" and decoded(few.slides[0].uri).shape == (400, 600)


def test_frames_and_figures_over_frames_have_sliders(tmp_path: Path) -> None:
    pictures = textured(tmp_path, 3)
    maps = tuple(
        partial(Figure, path, "exx", f"map {k}", frame=label)
        for k, (label, path) in enumerate(pictures)
    )
    alone = partial(Figure, pictures[0][1], "a plot", "alone")
    pair = FramePair("front", pictures[0][1], pictures[2][1], "", frames=tuple(pictures))
    report = Report("a", "b", "done", figures=(alone, *maps), frames=(pair,))
    text = write_report(report, tmp_path).html.read_text("utf-8")
    page = Page(text)
    assert text.count("data-slides>") == 2 and text.count('class="shown"') == 2
    assert page.text.count("exx") == 1 and "map 2 3 frames." in page.text
    assert page.tags.count("output") == 2 and page.tags.count("dialog") == 1
    # the last frame is what is seen without the script, and on paper
    last = re.findall(r'data-label="([^"]*)" class="shown"', text)
    assert last == ["time 2", "time 2"]


def test_a_scene_that_measures_nothing_begins_with_its_bodies(tmp_path: Path) -> None:
    write_image(tmp_path / "fields/displacement.png", np.full((40, 60, 3), 200, np.uint8))
    field = FieldPicture("displacement", "displacement", "mm", 1.958, "bar", (240.0, 10.0, 0.0), 1,
                         5.0, "fields/displacement.png")  # fmt: skip
    path = LoadPath("bar", (240.0, 10.0, 0.0), "load factor", (0, 1, 2), (0.0, 0.5, 1.0),
                    (0.0, 0.979, 1.958), (0.0, 25.0, 50.0))  # fmt: skip
    report = Report("a", "b", "done", fields=(field,), load_path=path,
                    highlights={"Largest displacement": ("1.958 mm", "at the end")},
                    solution=SolutionSummary(3600, 1, True, 1e-9))  # fmt: skip
    paths = write_report(report, tmp_path)
    text = paths.html.read_text("utf-8")
    cards, rest = text[text.index('class="cards"') :].split("</section>", 1)
    assert (
        "1.958 mm" in cards and "3\u202f600" not in cards
    )  # the number of unknowns is no headline
    assert rest.lstrip().startswith("<section>\n  <h2>Deformed body")
    assert "displacement: largest 1.958 mm, at (240.0, 10.00, 0) mm of bar." in Page(text).text
    assert tmp_path / "figures/load-path.png" in paths.figures
    assert path.stiffness == pytest.approx(50.0 / 1.958)
    told = json.loads(paths.json.read_text("utf-8"))
    assert told["fields"][0]["position_mm"] == [240.0, 10.0, 0.0]
    assert told["load_path"]["reaction_N"] == [0.0, 25.0, 50.0]
    measured = write_report(
        Report("a", "b", "done", fields=(field,),
               measurements=(Measurement.compare("tip", "mm", 1.9, 2.0),)), tmp_path
    ).html.read_text("utf-8")  # fmt: skip
    assert measured.index("Measured against true") < measured.index("Deformed body")
