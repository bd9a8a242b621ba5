"""The render benchmark: its references, what it compares, how it tells of peers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from benchmarks.render.cases import IMAGE_CASES, lamp_sides
from benchmarks.render.disc_texture import disc_texture
from benchmarks.render.measure import (
    IMAGE_PEERS,
    RenderResult,
    run_image_peer,
    run_render_bench,
)
from benchmarks.render.tables import ratios, write_render
from gpusim.bench import image_cases
from gpusim.bench.image_cases import ImageCase, Soup, find_image_cases
from gpusim.bench.images import (
    ImagePoint,
    ImageResult,
    compare,
    describe,
    reference_windows,
)
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.gpu import Device


def small(name: str, side: int = 32) -> ImageCase:
    """A case with one small window."""
    case = IMAGE_CASES[name]("small")
    r0, r1, c0, c1 = case.windows[0]
    r0, c0 = (r0 + r1 - side) // 2, (c0 + c1 - side) // 2
    return replace(case, windows=((r0, r0 + side, c0, c0 + side),))


def window(case: ImageCase, image: np.ndarray) -> list[np.ndarray]:
    return [image[a:b, c:d].astype(np.float64) for a, b, c, d in case.windows]


def test_the_reference_of_a_half_plane_is_its_area() -> None:
    camera = gs.Camera(40, 30, np.array([[50.0, 0, 19.5], [0, 50.0, 14.5], [0, 0, 1.0]]))
    edge, slope = 17.3, 0.21  # the plate ends at x = edge + slope y
    points = [[-9.5, -9.5], [-9.5, 59.5], [edge + slope * 59.5, 59.5], [edge - slope * 9.5, -9.5]]
    corners = np.array([[(x - 19.5) / 50, (y - 14.5) / 50, 1.0] for x, y in points])
    triangles = np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]])
    case = ImageCase("edge", camera, [], Soup(triangles, np.array([0.8, 0.8])),
                     windows=((3, 27, 5, 35),))  # fmt: skip
    (got,) = reference_windows(case)
    y, x = np.mgrid[3:27, 5:35].astype(float)
    fine = np.clip(edge + slope * (y[..., None] + (np.arange(64) + 0.5) / 64 - 0.5)
                   - x[..., None] + 0.5, 0, 1)  # fmt: skip
    assert np.abs(got - 0.8 * fine.mean(axis=-1)).max() <= 2e-3
    turned = replace(case, soup=Soup(triangles[:, ::-1], case.soup.albedo))
    assert not reference_windows(turned)[0].any()  # a back side


@pytest.mark.parametrize(
    ("name", "rms"),
    [("board", 3e-4), ("crane", 6e-4), ("speckle", 3e-3), ("faces-1e3", 5e-4), ("sheet-1e4", 3e-4)],
)
def test_gpusim_and_the_reference_draw_the_same_scene(
    name: str, rms: float, device: Device
) -> None:
    case = small(name)
    want = reference_windows(case, n=32)
    frame = gs.render(case.surfaces, case.camera, device=device)
    off = compare(window(case, frame.radiance), want)
    assert want[0].std() > 0.05 and off.rms <= rms


def test_a_known_shift_is_found_and_noise_is_not_one() -> None:
    y, x = np.mgrid[:96, :128].astype(float)

    def image(dx: float, dy: float) -> np.ndarray:
        return 0.5 + 0.4 * np.sin(0.31 * (x - dx)) * np.cos(0.23 * (y - dy))

    off = compare([image(0.013, -0.007)], [image(0, 0)])
    assert off.shift_rms == pytest.approx(np.hypot(0.013, 0.007) / np.sqrt(2), rel=0.02)
    assert off.bias == pytest.approx(0.013, rel=0.02)
    noise = np.random.default_rng(3).normal(0, 0.01, x.shape)
    noisy = compare([image(0, 0) + noise], [image(0, 0)])
    assert noisy.rms == pytest.approx(0.01, rel=0.05) and noisy.bias <= noisy.shift_rms


def test_lamps_shine_towards_their_target() -> None:
    for lamp in IMAGE_CASES["board-lit"]("small").lights:
        centre, a, b = lamp_sides(lamp)
        out = np.cross(a, b)
        towards = np.array(lamp.target) - centre
        assert out @ towards == pytest.approx(np.linalg.norm(out) * np.linalg.norm(towards))
        assert 4 * np.linalg.norm(out) == pytest.approx(lamp.size[0] * lamp.size[1])


def test_the_texture_covers_what_the_discs_do() -> None:
    paint = IMAGE_CASES["speckle"]("small").speckle
    assert paint is not None
    image = disc_texture(paint, (0.2, 0.12), 1e-3)
    assert image.shape == (120, 200)
    covered = (paint.ground - image.mean() / 255) / (paint.ground - paint.dot)
    assert abs(covered - paint.coverage) <= 0.03


def result() -> RenderResult:
    points = [
        ImagePoint("gpusim", 0.05, 2e-4, 1e-4, 1e-5),
        ImagePoint("riley, 16 samples", 0.07, 9e-3, 2e-3, 1e-3),
        ImagePoint("Exact, 9 samples", 1.0, 1e-4, 1e-4, 1e-5),
    ]
    case = ImageResult("board", 300, 200, 12, False, points, ["Cycles: missing: no such file"])
    faces = ImageResult("faces-1e3", 300, 200, 2000, False, points[:2])
    return RenderResult("a machine", [case, faces])


def test_ratios_say_who_reaches_the_error_and_at_what_cost(tmp_path: Path) -> None:
    told = ratios(result().cases[0])
    assert told == [
        "riley doesn't reach gpusim's image RMS: 45 times it in 1.4 times its time "
        "(riley, 16 samples)",
        "Exact, 9 samples reaches gpusim's image RMS in 20 times its time",
    ]
    table, figure = write_render(result(), tmp_path)
    text = table.read_text()
    assert "| riley, 16 samples | 0.070 | 1167 | 9.0e-03 | 2.0e-03 | 1.0e-03 | 1.4 |" in text
    assert "Cycles: missing" in text and figure.stat().st_size > 5000


def test_a_user_gets_time_against_error_of_an_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("board", "board-lit"):
        tiny = small(name)
        monkeypatch.setitem(image_cases.IMAGE_CASES, name, lambda size, tiny=tiny: tiny)
    arguments = ["bench", "render", "--case", "board", "-o", str(tmp_path)]
    ended = CliRunner().invoke(app, arguments)
    assert ended.exit_code == 0 and "board-lit: gpusim" in ended.output, ended.output
    rows = [row for row in (tmp_path / "render.md").read_text().splitlines() if "| gpusim" in row]
    unlit, lit = ([cell.strip() for cell in row.split("|")] for row in rows)
    assert float(unlit[4]) <= 3e-4 and lit[4:7] == ["-"] * 3
    assert "no reference" in describe(ImagePoint("gpusim", 0.2, *[float("nan")] * 3))


def test_a_peer_is_given_the_scene_in_camera_axes_and_its_failure_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: Device
) -> None:
    board = small("board")
    monkeypatch.setitem(IMAGE_CASES, "board", lambda size: board)
    monkeypatch.setenv("GPUSIM_PEERS_PYTHON", str(tmp_path / "no-python"))
    found = run_render_bench(["board"], "small", tmp_path, peers=IMAGE_PEERS[:1], tell=print)
    (case,) = found.cases
    own = case.own()
    assert own is not None and own.rms <= 3e-4 and own.seconds > 0
    assert len(case.failures) == 1 and case.failures[0].startswith("riley: missing")
    with np.load(tmp_path / "board-small" / "problem.npz") as stored:
        corners, windows = stored["corners"], stored["windows"]
    facts = json.loads((tmp_path / "board-small" / "problem.json").read_text())
    assert (facts["width"], facts["lit"], len(windows)) == (750, False, 1)
    assert (corners[..., 2] > 0.5).all()
    # a peer that fails after its start
    script = tmp_path / "riley_raster.py"
    script.write_text("raise SystemExit('no licence')")
    monkeypatch.delenv("GPUSIM_PEERS_PYTHON")
    (failed,) = run_image_peer(IMAGE_PEERS[0], tmp_path, [4], scripts=tmp_path)
    assert failed == {"failed": "no licence"}


def test_cases_are_found_by_the_beginning_of_their_name() -> None:
    assert find_image_cases("crane") == ["crane", "crane-lit"]
    with pytest.raises(InputError, match=r"got 'brd'; expected one of board, board-lit"):
        find_image_cases("brd", IMAGE_CASES)


def test_a_peer_that_is_asked_for_by_name_may_take_more_samples() -> None:
    for peer in IMAGE_PEERS:
        more = peer.asked()
        assert replace(more, most_samples=peer.most_samples) == peer
        assert (more.most_samples > peer.most_samples) == (peer.name == "Cycles")
    cycles = next(peer for peer in IMAGE_PEERS if peer.name == "Cycles")
    case = IMAGE_CASES["crane-lit"]("standard")
    assert cycles.most_samples < 16 * case.pixels < cycles.asked().most_samples
