"""Rectangles, lines, triangles and letters are where they should be, and as dense."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image, ImageDraw, ImageFont

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.visualization.glyphs import GlyphAtlas
from gpusim.visualization.overlay import Overlay, decoded, display_color, pixels_of

WIDTH, HEIGHT = 97, 61


def drawn(device: Device, overlay: Overlay, format: str = "rgba8unorm") -> npt.NDArray[Any]:
    target = device.texture(WIDTH, HEIGHT, format, "test.overlay")
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    return pixels_of(device, target)


def test_a_rectangle_at_whole_pixels_is_sharp(device: Device) -> None:
    overlay = Overlay(device)
    overlay.rectangle(7, 5, 31, 13, "#204060")
    expected = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    expected[5:18, 7:38] = (0x20, 0x40, 0x60, 255)
    assert (drawn(device, overlay) == expected).all()


def test_what_is_there_stays_and_the_last_is_on_top(device: Device) -> None:
    target = device.texture(WIDTH, HEIGHT, "rgba8unorm", "test.overlay")
    overlay = Overlay(device)
    overlay.rectangle(0, 0, WIDTH, HEIGHT, "#640000")
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    overlay.rectangle(10, 10, 20, 20, "#00c80080")
    overlay.rectangle(20, 20, 20, 20, "blue")
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    found = pixels_of(device, target)
    assert found[5, 5].tolist() == [100, 0, 0, 255]
    assert np.abs(found[15, 15].astype(int) - [50, 100, 0, 255]).max() <= 1
    assert found[25, 25].tolist() == [0, 0, 255, 255]
    with device.recording("test") as recording:
        overlay.draw(target, recording)  # it was forgotten
    assert (pixels_of(device, target) == found).all()
    with device.recording("test") as recording:
        for x in (0, 50):
            overlay.rectangle(x, 50, 7, 5, "white")
            overlay.draw(target, recording)
    found = pixels_of(device, target)
    assert (found[50:55, [0, 6, 50, 56]] == 255).all() and (found[50:55, [7, 57], 0] == 100).all()


@pytest.mark.parametrize("turned", [False, True])
def test_a_triangle_covers_its_area(device: Device, turned: bool) -> None:
    corners = np.array([[12.3, 8.1], [80.6, 21.4], [33.9, 52.7]])
    overlay = Overlay(device)
    overlay.polygon(corners[::-1] if turned else corners, "white")
    (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
    area = 0.5 * abs(ax * by - ay * bx)
    assert drawn(device, overlay)[..., 3].sum() / 255.0 == pytest.approx(area, rel=2e-3)


@pytest.mark.parametrize("width", [0.6, 1.0, 2.5])
def test_a_line_is_as_long_and_wide_as_it_should_be(device: Device, width: float) -> None:
    ends = np.array([[9.2, 11.7], [88.1, 44.3]])
    overlay = Overlay(device)
    overlay.line(ends, "white", width)
    length = float(np.hypot(*(ends[1] - ends[0])))
    found = drawn(device, overlay)[..., 3] / 255.0
    assert found.sum() == pytest.approx(width * length, rel=0.01)
    middle = (found[..., None] * np.mgrid[:HEIGHT, :WIDTH].transpose(1, 2, 0)).sum((0, 1))
    # its ends are hard: each is up to half a pixel off
    assert middle / found.sum() + 0.5 == pytest.approx(ends.mean(axis=0)[::-1], abs=0.3)


def test_pieces_of_a_line_have_no_gaps(device: Device) -> None:
    share = np.linspace(0.0, 1.0, 14)[:, None]
    points = (1 - share) * [9.2, 11.7] + share * [88.1, 44.3]
    overlay = Overlay(device)
    overlay.line(points, "white", 2.0)
    pieces = drawn(device, overlay).astype(int)
    overlay.line(points[[0, -1]], "white", 2.0)
    assert np.abs(drawn(device, overlay) - pieces).max() <= 2


def test_letters_are_those_of_pillow(device: Device) -> None:
    overlay = Overlay(device)
    overlay.text(5, 30, "Hg 12.5 µ°", 15, "white", anchor="ls")
    found = drawn(device, overlay)[..., 3]
    folder = Path(find_spec("matplotlib").submodule_search_locations[0])  # type: ignore[union-attr,index]
    font = ImageFont.truetype(
        str(folder / "mpl-data/fonts/ttf/DejaVuSans.ttf"), 15, layout_engine=0
    )
    picture = Image.new("L", (WIDTH, HEIGHT))
    ImageDraw.Draw(picture).text((5, 30), "Hg 12.5 µ°", 255, font, anchor="ls")
    assert found.max() == 255 and (found == np.asarray(picture)).all()


def test_anchors_and_lines(device: Device) -> None:
    overlay, lines = Overlay(device), "HH\nHHHH"
    boxes = {}
    for anchor in ("la", "mm", "rd"):
        overlay.text(48, 30, lines, 12, "white", anchor=anchor)
        rows, columns = np.nonzero(drawn(device, overlay)[..., 3])
        boxes[anchor] = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    assert abs(boxes["la"][0] - 49) <= 1 and boxes["la"][1] == 30
    assert abs(boxes["rd"][2] - 47) <= 1 and boxes["rd"][3] == 30
    middle = boxes["mm"]
    assert abs(middle[0] + middle[2] - 96) <= 2 and abs(middle[1] + middle[3] - 60) <= 2
    assert overlay.text_width(lines, 12) == pytest.approx(4 * overlay.text_width("H", 12))


RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x391, 0x3A2), (0x3A3, 0x3CA), (0x2190, 0x2196))
SIGNS = "–—‘’“”•…′″‰⁰⁴⁵⁶⁷⁸⁹⁺⁻₀₁₂₃₄₅₆₇₈₉∂∆∇∑−√∞∠∥⊥≈≠≤≥▲▶▼◀■□●○✓✗"  # noqa: RUF001
CHARACTERS = "".join(chr(code) for first, stop in RANGES for code in range(first, stop)) + SIGNS


def letter(atlas: GlyphAtlas, character: str, size: int) -> np.ndarray:
    """(H, W) coverage."""
    glyph = atlas.glyph(character, size)
    return atlas.coverage[glyph.first :][: glyph.width * glyph.height].reshape(
        glyph.height, glyph.width
    )


def test_a_character_without_a_letter_is_a_box() -> None:
    atlas = GlyphAtlas()
    box = atlas.glyph("漢", 16)
    picture = letter(atlas, "漢", 16)
    assert (picture == letter(atlas, "\ue123", 16)).all() and box.advance >= box.width
    assert (picture[[0, -1], 1:-2] == 255).all() and (picture[1:-1, 2:-3] == 0).all()


@pytest.mark.parametrize("size", [11, 16])
def test_there_is_a_letter_for_every_character(size: int) -> None:
    atlas = GlyphAtlas()
    box = letter(atlas, "漢", size)
    for character in CHARACTERS:
        picture = letter(atlas, character, size)
        assert atlas.glyph(character, size).advance > 0.0
        assert picture.size or character in " \u00a0\u00ad"
        assert picture.shape != box.shape or (picture != box).any(), character


def test_a_target_with_the_curve_of_srgb_shows_the_same(device: Device) -> None:
    found = []
    for format in ("rgba8unorm", "rgba8unorm-srgb"):
        overlay = Overlay(device)
        overlay.rectangle(7, 5, 31, 13, "#204060")
        found.append(drawn(device, overlay, format).astype(int))
    assert np.abs(found[0] - found[1]).max() <= 1
    assert decoded(np.array([0.5]))[0] == pytest.approx(0.21404, abs=1e-5)


def test_what_cannot_be_drawn() -> None:
    assert display_color((0.1, 0.2, 0.3)) == (0.1, 0.2, 0.3, 1.0)
    for wrong in ("#12", "no colour", (1.0, 2.0, 0.0), (0.1, 0.2), float("nan")):
        with pytest.raises(InputError, match="expected '#rrggbb'"):
            display_color(wrong)  # type: ignore[arg-type]


def test_nothing_is_drawn_of_what_is_not_finite(device: Device) -> None:
    overlay = Overlay(device)
    overlay.line([(1, 1), (np.nan, 4), (9, 9), (9, 9)], "white")
    overlay.polygon([(1, 1), (5, np.inf), (9, 9)], "white")
    assert len(overlay.quads()) == 0
    overlay.line([(1, 1), (np.nan, 4), (9, 9), (9, 19)], "white")
    assert len(overlay.quads()) == 1
    overlay.clear()
    assert len(overlay.quads()) == 0
    with pytest.raises(InputError, match="anchor"):
        overlay.text(1, 1, "x", 12, "white", anchor="xx")
    with pytest.raises(InputError, match=r"corners; got shape \(1, 5, 2\)"):
        overlay.polygon(np.zeros((5, 2)), "white")
