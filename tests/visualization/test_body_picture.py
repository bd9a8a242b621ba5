"""Pictures of bodies: colours are the legend's, everything is in view, the scale holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.export.field_catalogue import Field
from gpusim.gpu import Device
from gpusim.visualization.body_picture import (
    PLACE,
    SHOWN,
    SIZE,
    BodyPictures,
    DisplacedBody,
    exaggeration,
    extremes,
)
from gpusim.visualization.color_scale import scale_of
from gpusim.visualization.legend import legend_width
from gpusim.visualization.turntable import ISOMETRIC

HEIGHT = Field("height", "m", lambda state: state, "nodes", signed=True)
SLOPE = np.array([1.7, -0.4, 0.9])


def plate(u: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> DisplacedBody:
    """Coarse: few lines on it. Shifted by ``u`` where x is largest."""
    mesh = gs.mesh.box(size=(0.3, 0.2, 0.05), divisions=(2, 2, 1))
    moved = mesh.points[:, :1] / 0.3 * np.array(u)
    return DisplacedBody("plate", gs.Skin(mesh, gs.mesh.boundary_faces(mesh)), moved)


def pixels(pictures: BodyPictures, points: np.ndarray) -> np.ndarray:
    return np.rint(PLACE.window(pictures.camera.project(points)) - 0.5).astype(int)


def test_a_pixel_has_the_legends_colour_of_its_value(device: Device) -> None:
    body = plate((0.0, 0.0, 0.004))
    pictures = BodyPictures(device, [body], ISOMETRIC)
    mesh = body.skin.mesh
    values = mesh.points @ SLOPE
    picture = pictures.draw(HEIGHT, [values])
    scale = scale_of([values], True)
    # on the top, away from the borders of elements; a linear field is interpolated exactly
    x, y = (one.reshape(-1) for one in np.meshgrid([0.06, 0.12, 0.2], [0.04, 0.08]))
    top = np.stack([x, y, np.full_like(x, 0.05)], axis=1)
    lifted = top + np.outer(x / 0.3, pictures.factor * np.array([0.0, 0.0, 0.004]))
    column, row = pixels(pictures, lifted).T
    shown = picture[row, column].astype(float)
    share = (top @ SLOPE - scale.low) / (scale.high - scale.low)
    expected = 255.0 * scale.colors[np.rint(255.0 * share).astype(int)]
    assert np.abs(shown - expected).max() <= 3.0  # a step of the table, and rounding
    # and the same colours stand in the legend, at the height of the value
    bar = round(picture.shape[1] - 22 - legend_width(pictures.overlay, scale, "m", SIZE)) + SIZE
    table = np.rint(255.0 * scale.colors)
    known = np.abs(picture[:, bar, None].astype(float) - table).max(axis=2).min(axis=1) <= 1.0
    first, last = np.flatnonzero(known)[[0, -1]]
    assert known[first : last + 1].all() and last - first > 200
    at = np.rint(last - share * (last - first)).astype(int)
    assert np.abs(shown - picture[at, bar]).max() <= 6.0


def test_everything_is_in_view_beside_legend_and_scale(device: Device) -> None:
    for view in (ISOMETRIC, ISOMETRIC.side("front"), ISOMETRIC.side("top")):
        pictures = BodyPictures(device, [plate((0.0, 0.02, 0.03))], view)
        shown = np.concatenate([pictures.bodies[0].rest.points, pictures.surfaces[0].points])
        at = PLACE.window(pictures.camera.project(shown))
        width, height = pictures.size
        assert (at > 10.0).all() and (at < [width - 150.0, height - 80.0]).all()
        assert 440 <= height <= 860
        ids = pictures.frame.ids()
        assert ids.any() and not ids[[0, -1]].any() and not ids[:, [0, -1]].any()


def test_the_scale_bar_is_as_long_as_it_says(device: Device) -> None:
    pictures = BodyPictures(device, [plate()], ISOMETRIC)
    picture = pictures.draw(HEIGHT, [pictures.bodies[0].skin.mesh.points[:, 0]])
    dark = np.flatnonzero(picture[pictures.size[1] - 37, 120:600].max(axis=1) < 90)
    length = dark[-1] - dark[0] + 1
    right = pictures.camera.camera_from_world[0, :3]
    ends = np.array(pictures.view.pivot) + np.outer([0.0, 0.1], right)
    per_metre = np.diff(pictures.camera.project(ends)[:, 0])[0] / 0.1
    assert length / per_metre == pytest.approx(0.05, abs=1.5 / per_metre)


def test_displacements_are_drawn_a_round_number_of_times() -> None:
    points = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    assert exaggeration(points, np.array([0.0, 1e-3])) == 200.0
    assert 200.0 * 1e-3 <= SHOWN * 5.0 < 500.0 * 1e-3
    assert exaggeration(points, np.array([0.0, 1.0])) == 1.0
    assert exaggeration(points, np.zeros(2)) == 1.0


def test_the_largest_and_smallest_values_and_where_they_are() -> None:
    x = plate().skin.mesh.points[:, 0]
    found = extremes(HEIGHT, [x - 0.1, 3.0 * x - 0.2])
    assert found["largest"].value == pytest.approx(0.7) and found["largest"].body == 1
    assert x[found["largest"].node] == pytest.approx(0.3)
    assert found["smallest"].value == pytest.approx(-0.2) and found["smallest"].body == 1
    assert list(extremes(replace(HEIGHT, signed=False), [x - 0.1])) == ["largest"]
    assert list(extremes(HEIGHT, [x - 1e-3, x])) == ["largest"]  # the other is small beside it
    assert list(extremes(HEIGHT, [-x])) == ["smallest"] and extremes(HEIGHT, [0.0 * x]) == {}


@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf])
def test_what_isnt_known_is_no_extreme(unknown: float) -> None:
    first, second = np.array([1.0, -3.0, 2.0, unknown]), np.array([unknown, 5.0, -4.0])
    assert extremes(HEIGHT, [first, second]) == {"largest": (5.0, 1, 1), "smallest": (-4.0, 1, 2)}
    second[:] = unknown
    for values in ([first, second], [second, first]):
        found = extremes(HEIGHT, values)
        assert {word: one.value for word, one in found.items()} == {
            "largest": 2.0, "smallest": -3.0
        }  # fmt: skip
    assert extremes(HEIGHT, [second]) == {}


def test_a_picture_of_a_field_that_isnt_known_everywhere(device: Device) -> None:
    pictures = BodyPictures(device, [plate()], ISOMETRIC)
    height = pictures.bodies[0].skin.mesh.points[:, 2]
    blank = pictures.draw(HEIGHT, [np.full_like(height, np.nan)])
    some = pictures.draw(HEIGHT, [np.where(height > 0.02, height, np.nan)])
    top = pixels(pictures, np.array([[0.06, 0.04, 0.05]]))[0]
    colors = some[top[1], top[0]], blank[top[1], top[0]]
    assert np.ptp(colors[0]) > 50 and np.ptp(colors[1]) < 10  # coloured; grey
