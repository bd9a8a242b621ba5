"""Arguments of the Python API that can't be used: one InputError that names the argument."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.validation import (
    Portion,
    Positive,
    checked,
    count_of,
    one_of,
    real_numbers,
    require,
    require_one_of,
    within,
)

K = np.array([[30.0, 0.0, 5.0], [0.0, 31.0, 3.5], [0.0, 0.0, 1.0]])
CORNERS = np.array([[-1.0, -0.7, 4.0], [1.1, -0.6, 4.0], [0.2, 0.9, 4.3]])
WRONG: tuple[Any, ...] = (
    "a", "", None, object(), [1, "x"], {}, float("nan"), True, 3 + 4j, [[1, 2], [3]],
    np.zeros((2, 2)), ["a", "b", "c"], [None] * 3, -1,
)  # fmt: skip


def a_camera(**changes: Any) -> gs.Camera:
    return gs.Camera(**{"width": 11, "height": 8, "K": K, **changes})


def a_surface(**changes: Any) -> gs.Surface:
    return gs.Surface(**{"points": CORNERS, "faces": np.array([[0, 2, 1]]), **changes})


def a_photograph(**changes: Any) -> gs.Frame:
    given = {"surfaces": [a_surface()], "camera": a_camera(), "backend": "numpy"}
    return gs.photograph(**{**given, **changes})


MAKERS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Camera": (gs.Camera, {"width": 11, "height": 8, "K": K}),
    "from_lens": (gs.Camera.from_lens, {
        "sensor_mm": (8.0, 6.0), "focal_mm": 12.0, "resolution": (8, 6), "eye": (0.0, -1.0, 0.0),
        "target": (0.0, 0.0, 0.1),
    }),
    "Lens": (gs.Lens, {}),
    "Shutter": (gs.Shutter, {}),
    "Sensor": (gs.Sensor, {}),
    "Vignetting": (gs.Vignetting, {}),
    "PointLight": (gs.PointLight, {"position": (0.0, 0.0, 1.0), "power": 2.0}),
    "SpotLight": (gs.SpotLight, {"position": (0, 0, 1), "target": (0, 0, 0), "power": 2.0}),
    "AreaLight": (gs.AreaLight, {
        "position": (0, 0, 1), "target": (0, 0, 0), "size": (0.3, 0.2), "power": 2.0,
    }),
    "SunLight": (gs.SunLight, {"direction": (0.0, 0.3, -1.0), "irradiance": 900.0}),
    "AmbientLight": (gs.AmbientLight, {"radiance": 0.3}),
    "EnvironmentLight": (gs.EnvironmentLight, {"sky": 0.3}),
    "Gaussian": (gs.psf.Gaussian, {"sigma": 0.7}),
    "Airy": (gs.psf.Airy, {"wavelength": 5.5e-7, "f_number": 8.0, "pitch": 3.4e-6}),
    "MeasuredPsf": (gs.psf.MeasuredPsf, {"kernel": np.ones((3, 5))}),
    "Surface": (gs.Surface, {"points": CORNERS, "faces": np.array([[0, 2, 1]])}),
    "Checker": (gs.paint.Checker, {"size": 0.2}),
    "Speckle": (gs.paint.Speckle, {"diameter": 0.2}),
    "Image": (gs.paint.Image, {"pixels": np.ones((3, 4)), "texel": 0.2}),
    "Aruco": (gs.paint.Aruco, {"centres": [[0.1, 0.2]], "ids": (3,), "size": 0.2}),
    "RingCodes": (gs.paint.RingCodes, {"centres": [[0.1, 0.2]], "codes": (5,), "diameter": 0.2}),
    "render": (gs.render, {"surfaces": [], "camera": None, "backend": "numpy"}),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_wrong_types_are_input_errors(name: str) -> None:
    """Each argument in turn gets what no signature allows; some of it is right for some."""
    make, good = MAKERS[name]
    refused = 0
    for key in inspect.signature(make).parameters:
        for value in WRONG:
            try:
                make(**{**good, key: value})
            except InputError as error:
                assert "got" in str(error) and "expected" in str(error), (key, value, error)
                refused += 1
    assert refused >= 3 * len(good) + 3


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: a_camera().project("a"), "project; got 'a'; expected an array of real numbers"),
        (lambda: a_camera().undistort(["a", "b"]), "undistort; got ['a', 'b']; expected an array"),
        (lambda: gs.Lens("a"), "Lens psf; got 'a'; expected a Psf"),
        (lambda: gs.Lens(fill_factor="a"), "Lens fill_factor; got 'a'; expected a number"),
        (lambda: gs.Shutter("a"), "Shutter exposure_time; got 'a'; expected a number"),
        (lambda: gs.Shutter(samples=2.5), "got 2.5; expected a whole number or None"),
        (
            lambda: gs.PointLight("here", 1.0),
            "position; got 'here'; expected 3 numbers: three finite",
        ),
        (lambda: gs.PointLight((0, 0, 1), "60 W"), "power; got '60 W'; expected a number"),
        (lambda: gs.PointLight((0, 0, 1), 1.0, shadows="no"), "'no'; expected True or False"),
        (lambda: a_photograph(shuter=None), "'shuter'; expected some of surfaces, camera"),
        (lambda: a_photograph(shuter=None), "(did you mean shutter?)"),
        (lambda: a_photograph(surfaces="wall"), "photograph surfaces; got 'wall'; expected a list"),
        (lambda: a_photograph(time="late"), "photograph time; got 'late'; expected a number"),
        (lambda: gs.render([a_surface()]), "missing a required argument: 'camera'"),
        (lambda: gs.render([], None, error="low"), "render error; got 'low'; expected a number"),
        (lambda: gs.SunLight(), "missing a required argument: 'direction'"),
    ],
)
def test_messages_say_which_argument(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert words in str(caught.value)


def test_what_stands_for_numbers_is_taken() -> None:
    light = gs.PointLight(np.array([0.0, 1.0, 2.0]), np.float32(3.0))  # type: ignore[arg-type]
    assert light.power == 3.0
    assert gs.Shutter(np.array(0.25), samples=4.0).exposure_time == 0.25  # type: ignore[arg-type]
    assert real_numbers([[1, 2.5]], "x").tolist() == [[1.0, 2.5]]
    assert a_camera(width=11.0).width == 11
    frame = a_photograph()
    assert 0.0 < float(frame.radiance.max()) <= 0.5


def test_annotations_that_say_nothing_checkable_are_left_alone() -> None:
    @checked
    def join(items: dict[str, int], scale: float = 1.0, *, label: str | None = None) -> str:
        return f"{items} {scale} {label}"

    assert join({"a": 1}, 2, label="x") == "{'a': 1} 2 x"
    assert join("anything") == "anything 1.0 None"  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"join label; got 3; expected a text or None"):
        join({}, label=3)  # type: ignore[arg-type]


@checked
def mixed(
    share: Portion,
    scale: Positive | Annotated[str, one_of("auto")] = "auto",
    *,
    count: Annotated[int, within(2, 9, "parts")] | None = None,
) -> str:
    return f"{share} {scale} {count}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"share": 0.0}, "mixed share; got 0.0; expected above 0, up to 1"),
        ({"share": np.nan}, "mixed share; got nan; expected above 0, up to 1"),
        ({"share": "a"}, "mixed share; got 'a'; expected a number: above 0, up to 1"),
        ({"scale": np.inf}, "mixed scale; got inf; expected above 0 or 'auto'"),
        ({"scale": "much"}, "mixed scale; got 'much'; expected above 0 or 'auto'"),
        ({"scale": []}, "mixed scale; got []; expected a number or a text: above 0 or 'auto'"),
        ({"count": 1}, "mixed count; got 1; expected 2 to 9 parts"),
        ({"count": 2.5}, "mixed count; got 2.5; expected a whole number or None: 2 to 9 parts"),
    ],
)
def test_rules_beside_types_are_checked(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        mixed(**{"share": 0.5, **arguments})
    assert str(caught.value) == message
    assert mixed(1.0, 2, count=9) == "1.0 2 9" and mixed(0.1) == "0.1 auto None"


def test_one_number_in_an_array_is_a_number() -> None:
    assert hash(gs.paint.Checker(np.array(0.2))) == hash(gs.paint.Checker(0.2))


def test_what_is_required_is_said_in_one_form() -> None:
    require(True, "x", 1, "2")
    with pytest.raises(InputError, match=r"^x; got 1; expected 2$"):
        require(False, "x", 1, "2")
    require_one_of("x", "a", ("a", "b"))
    with pytest.raises(InputError, match=r"^x; got 'c'; expected one of a, b$"):
        require_one_of("x", "c", ("a", "b"))


@pytest.mark.parametrize("value", [0, 1.5, np.nan, np.inf, True, "3", None])
def test_a_count_is_a_whole_number_from_1_up(value: Any) -> None:
    assert count_of("x", 2.0) == count_of("x", np.int32(2)) == 2
    with pytest.raises(InputError, match=r"^x; got .*; expected a whole number >= 1$"):
        count_of("x", value)


def test_a_mesh_and_a_surface_are_shown_by_their_counts() -> None:
    points = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1, 3)], float)
    first = np.array([0, 1, 4, 3, 6, 7, 10, 9])
    mesh = gs.Mesh(points, {"hex8": np.stack([first, first + 1])}, {"left": [0, 3]})
    assert repr(mesh) == "Mesh(12 nodes, 2 hex8, 1 named sets)"
    assert repr(a_surface()) == "Surface('surface', 3 points, 1 faces, surface: Plain)"
