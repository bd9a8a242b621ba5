"""Chessboards as plain fields with strips along their lines: the same picture, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.geometry.polygon_clipping import half_planes
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import AreaLight
from gpusim.optics.paint import checker_lines
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.surface.paint import Checker, Plain
from gpusim.surface.surface import Surface

LIGHTS = [AreaLight((0.9, -2.0, 1.4), (0.1, 0.0, 0.0), (0.2, 0.1), 9.0)]


def board(columns: int | None, rows: int | None) -> list[Surface]:
    """A tilted board with a rod before it, whose shadow falls on the board."""
    x, z = np.array([-0.31, 0.29, 0.29, -0.31]), np.array([-0.2, -0.2, 0.21, 0.2])
    quad = np.stack([x, 0.08 / 0.6 * (x + 0.31) + 0.05 * (z + 0.2), z], axis=1)
    paint = Checker(
        0.061, columns=columns, rows=rows, origin=(0.09, 0.07), dark=0.06, light=0.8, ground=0.5
    )
    rod = np.array([[-0.1, -0.2, -0.3], [-0.07, -0.2, -0.3], [0.05, -0.2, 0.3], [0.02, -0.2, 0.3]])
    return [
        Surface(quad, np.array([[0, 1, 2, -1], [0, 2, 3, -1]]), paint=paint),
        Surface(rod, np.array([[0, 1, 2, 3]]), paint=Plain(0.3)),
    ]


def lines_of(setup: Setup) -> BoardLines | None:
    return BoardLines.of(setup.view, setup.traits.printed)


def camera(**changes: object) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0),
        50.0,
        (391, 262),
        (0.1, -1.1, 0.07),
        (0.0, 0.0, 0.01),
        **changes,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("lights", "columns", "rows", "alone"),
    # any two of the three choices meet
    [
        (None, 5, 4, False),
        (None, None, None, True),
        (LIGHTS, 5, 4, True),
        (LIGHTS, None, None, False),
    ],
)
def test_a_board_is_the_same_with_and_without(
    device: gs.Device,
    monkeypatch: pytest.MonkeyPatch,
    lights: list[AreaLight] | None,
    columns: int | None,
    rows: int | None,
    alone: bool,
) -> None:
    surfaces = board(columns, rows)[: 1 if alone else 2]
    view = look(surfaces, camera(), lit=lights is not None)
    lines = lines_of(Setup.build(view, lights, 0.0, surfaces))
    assert lines is not None and len(lines.parent) > 40
    part = gs.render(surfaces, camera(), lights, device=device).radiance
    monkeypatch.setattr(checker_lines, "MIN_FIELD", np.inf)
    whole = gs.render(surfaces, camera(), lights, device=device).radiance
    twin = gs.render(surfaces, camera(), lights, backend="numpy").radiance
    scale = float(twin.max())
    off = np.abs(part - whole)
    # where two strips overlap either may be seen, each as its own triangle has it
    assert off.max() <= 5e-5 * scale
    assert np.count_nonzero(off > 2e-6 * scale) <= 9
    assert np.abs(part - twin).max() <= max(3.0 / SAMPLES, 1e-4) * scale
    assert np.ptp(twin) > 0.5 * scale


def test_strips_cover_what_reaches_over_a_line() -> None:
    surfaces = board(5, 4)
    view = look(surfaces, camera(), lit=False)
    setup = Setup.build(view, None, 0.0)
    lines = BoardLines.of(setup.view, setup.traits.printed)
    assert lines is not None
    np.testing.assert_array_equal(lines.member, view.paint == 0)
    # strips are a small part of the board
    a, b = lines.screen[:, 1] - lines.screen[:, 0], lines.screen[:, 2] - lines.screen[:, 0]
    strips = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    c, d = (view.screen[view.paint == 0][:, k] - view.screen[view.paint == 0][:, 0] for k in (1, 2))
    whole = 0.5 * np.abs(c[:, 0] * d[:, 1] - c[:, 1] * d[:, 0]).sum()
    assert 0.01 * whole < strips < 0.25 * whole
    # every pixel centre whose square may reach over a line lies in one of them
    y, x = np.mgrid[: view.camera.height, : view.camera.width]
    ids = visibility_twin(view)
    own = np.flatnonzero((ids > 0).ravel() & (view.paint[ids.ravel().astype(int) - 1] == 0))
    cell, st, ex, ey, q = setup.coefficients.footprint(
        ids.ravel()[own].astype(int) - 1, x.ravel()[own] * 1.0, y.ravel()[own] * 1.0
    )
    st += cell * setup.table.paints["cell"][0]
    grid = (st - np.array([0.09, 0.07])) / 0.061
    line = np.clip(np.rint(grid), 0, [5, 4])
    away = (grid - line) * 0.061
    reach = 0.5 * (np.abs(ex + away * q[:, :1]) + np.abs(ey + away * q[:, 1:]))
    over = np.abs(away) < reach
    # beside the pattern's end a line ends as well
    inside = (grid > -0.01) & (grid < [5.01, 4.01])
    over &= inside[:, ::-1]
    at = np.stack([x.ravel()[own], y.ravel()[own]], axis=1)[over.any(axis=1)].astype(np.float64)
    assert len(at) > 1000
    planes = half_planes(lines.screen)
    height = np.einsum("nkc,mc->nmk", planes[..., :2], at) + planes[:, None, :, 2]
    assert (height.min(axis=2) >= -1e-9).any(axis=0).all()
    # in front of the board by a millionth, behind nothing else
    ratio = lines.inverse_depth / view.inverse_depth()[lines.parent].max(axis=1, keepdims=True)
    assert (ratio <= 1.01).all() and (ratio > 0.9).all()


@pytest.mark.parametrize("eye", [(0.1, -1.1, 0.07), (0.9, -0.25, 0.1)], ids=["front", "side"])
def test_strips_lie_in_front_where_cards_round_vertices(eye: tuple[float, float, float]) -> None:
    """Planes through vertices in 1/256 px: a card's depths, those of strips before their board."""
    seen = gs.Camera.from_lens((36.0, 24.0), 50.0, (391, 262), eye, (0.0, 0.0, 0.01))
    surfaces = board(None, None)[:1]
    view = look(surfaces, seen, lit=False)
    lines = lines_of(Setup.build(view, None, 0.0, surfaces))
    assert lines is not None and len(lines.parent) > 40

    def rounded(screen: np.ndarray, inverse_depth: np.ndarray, at: np.ndarray) -> np.ndarray:
        corners = np.rint(screen * 256.0) / 256.0
        full = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
        whole = np.abs(np.linalg.det(full)) > 1e-9
        planes = np.linalg.solve(full[whole], inverse_depth.astype(np.float32)[whole, :, None])
        result = np.full(len(screen), np.nan)
        result[whole] = planes[:, 0, 0] * at[whole, 0] + planes[:, 1, 0] * at[whole, 1]
        result[whole] += planes[:, 2, 0]
        return result

    for weights in np.random.default_rng(3).dirichlet((0.5, 0.5, 0.5), 20):
        at = np.einsum("k,nkd->nd", weights, lines.screen)
        strip = rounded(lines.screen, lines.inverse_depth, at)
        ground = rounded(view.screen_of(lines.parent), view.inverse_depth(lines.parent), at)
        before = (strip / ground - 1.0)[np.isfinite(strip)]
        assert before.size > 40 and before.min() > 5e-7 and before.max() < 2e-4


def test_boards_without_strips() -> None:
    surfaces = board(5, 4)
    bent = look(surfaces, camera(distortion=[-0.2, 0.05, 0.0, 0.0]), lit=False)
    assert lines_of(Setup.build(bent, None, 0.0)) is None
    small = Setup.build(look([Surface(surfaces[0].points, surfaces[0].faces, paint=Checker(0.004))],
                             camera(), lit=False), None, 0.0)  # fmt: skip
    assert lines_of(small) is None
    # a side face on which the paint is one line
    side = np.array([[0.0, -0.1, 0.0], [0.1, 0.1, 0.0], [0.1, 0.1, 0.1], [0.0, -0.1, 0.1]])
    frame = gs.PaintFrame(np.zeros(3), np.array([1.0, 1.0, 0.0]), np.array([1.0, 1.0, 1e-9]))
    view = look([Surface(side, np.array([[0, 1, 2, 3]]), {"a": Checker(0.06)},
                         frames={"a": frame})], camera(), lit=False)  # fmt: skip
    lines = lines_of(Setup.build(view, None, 0.0))
    assert lines is None or not lines.member.any()
