"""Insides of chessboard fields drawn without the pattern: the same picture, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics import plain_cells
from gpusim.optics.light import AreaLight
from gpusim.optics.plain_cells import PlainCells
from gpusim.optics.setup import Setup
from gpusim.optics.view import look
from gpusim.surface.paint import Checker, Plain
from gpusim.surface.surface import Surface

LIGHTS = [AreaLight((0.9, -2.0, 1.4), (0.1, 0.0, 0.0), (0.2, 0.1), 9.0)]


def board(columns: int | None, rows: int | None) -> list[Surface]:
    """A tilted board with a rod before it, whose shadow falls on the board."""
    quad = np.array([[-0.31, 0.0, -0.2], [0.29, 0.08, -0.2], [0.29, 0.1, 0.21], [-0.31, 0.02, 0.2]])
    paint = Checker(
        0.061, columns=columns, rows=rows, origin=(-0.19, -0.13), dark=0.06, light=0.8, ground=0.5
    )
    rod = np.array([[-0.1, -0.2, -0.3], [-0.07, -0.2, -0.3], [0.05, -0.2, 0.3], [0.02, -0.2, 0.3]])
    return [
        Surface(quad, np.array([[0, 1, 2, -1], [0, 2, 3, -1]]), paint=paint),
        Surface(rod, np.array([[0, 1, 2, 3]]), paint=Plain(0.3)),
    ]


def camera(**changes: object) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0),
        50.0,
        (391, 262),
        (0.1, -1.1, 0.07),
        (0.0, 0.0, 0.01),
        **changes,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("lights", [None, LIGHTS])
@pytest.mark.parametrize("columns,rows", [(5, 4), (None, None)])
def test_a_board_is_the_same_with_and_without(
    device: gs.Device,
    monkeypatch: pytest.MonkeyPatch,
    lights: list[AreaLight] | None,
    columns: int | None,
    rows: int | None,
) -> None:
    surfaces = board(columns, rows)
    setup = Setup.build(look(surfaces, camera(), lit=lights is not None), lights, 0.0, surfaces)
    cells = PlainCells.of(setup)
    assert cells is not None and len(cells.parent) > 40
    assert set(cells.albedo) == ({0.06, 0.8, 0.5} if columns else {0.06, 0.8})
    part = gs.render(surfaces, camera(), lights, device=device).radiance
    monkeypatch.setattr(plain_cells, "LEAST", np.inf)
    assert PlainCells.of(setup) is None
    whole = gs.render(surfaces, camera(), lights, device=device).radiance
    twin = gs.render(surfaces, camera(), lights, backend="numpy").radiance
    scale = float(twin.max())
    assert np.abs(part - whole).max() <= 2e-6 * scale
    assert np.abs(part - twin).max() <= max(3.0 / 512, 1e-4) * scale
    assert np.ptp(twin) > 0.5 * scale


def test_insides_lie_inside() -> None:
    surfaces = board(5, 4)
    view = look(surfaces, camera(), lit=False)
    setup = Setup.build(view, None, 0.0)
    cells = PlainCells.of(setup)
    assert cells is not None
    # most of the board is even: what is left are a few pixels beside the lines
    a, b = cells.screen[:, 1] - cells.screen[:, 0], cells.screen[:, 2] - cells.screen[:, 0]
    even = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    c, d = (view.screen[view.paint == 0][:, k] - view.screen[view.paint == 0][:, 0] for k in (1, 2))
    whole = 0.5 * np.abs(c[:, 0] * d[:, 1] - c[:, 1] * d[:, 0]).sum()
    assert 0.6 * whole < even < 0.95 * whole
    # in front of the board by a millionth, behind nothing else
    ratio = cells.inverse_depth / view.inverse_depth()[cells.parent].max(axis=1, keepdims=True)
    assert (ratio <= 1.0 + 3e-6).all() and (ratio > 0.9).all()
    bent = look(surfaces, camera(distortion=[-0.2, 0.05, 0.0, 0.0]), lit=False)
    assert PlainCells.of(Setup.build(bent, None, 0.0)) is None
    small = Setup.build(look([Surface(surfaces[0].points, surfaces[0].faces, paint=Checker(0.004))],
                             camera(), lit=False), None, 0.0)  # fmt: skip
    assert PlainCells.of(small) is None
