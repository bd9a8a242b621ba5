"""What `gs.render` refuses, before any work on a device."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError

PLATE = gs.Surface(
    np.array([[-0.3, 0, -0.2], [0.3, 0, -0.2], [0.3, 0, 0.2], [-0.3, 0, 0.2]]),
    np.array([[0, 1, 2, 3]]),
)
K = np.array([[100.0, 0, 28], [0, 100, 16], [0, 0, 1]])
CAMERA = gs.Camera(57, 33, K)
LAMP = gs.PointLight((0.0, 0.0, 0.0), 1.0)


class NoDevice(gs.Device):
    """Any use of it fails."""

    def __init__(self) -> None:
        pass

    def __getattribute__(self, name: str) -> Any:
        if name.startswith("__"):
            return object.__getattribute__(self, name)
        raise AssertionError(f"the device was used: {name}")


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ({"surfaces": []}, ("surfaces", "[]", "list of Surface")),
        ({"surfaces": PLATE}, ("surfaces", "list of Surface")),
        ({"surfaces": [PLATE, 3]}, ("surfaces", "3", "list of Surface")),
        ({"surfaces": None}, ("surfaces", "None", "list of Surface")),
        ({"camera": "left"}, ("camera", "'left'", "Camera")),
        ({"lights": LAMP}, ("lights", "PointLight", "list of lights")),
        ({"lights": ["sun"]}, ("lights", "sun", "list of lights")),
        ({"error": 0.2}, ("error", "0.2", "0.25")),
        ({"error": float("nan")}, ("error", "nan", "0.25")),
        ({"background": -1.0}, ("background", "-1.0", "0 up")),
        ({"background": float("inf")}, ("background", "inf", "0 up")),
        ({"backend": "cuda"}, ("backend", "'cuda'", "'gpu' or 'numpy'")),
        ({"camera": gs.Camera(8193, 33, K)}, ("width", "8193", "8192")),
        ({"camera": gs.Camera(57, 40000, K)}, ("height", "40000", "8192")),
    ],
)
def test_refused_before_any_work(arguments: dict[str, Any], parts: tuple[str, ...]) -> None:
    values = {"surfaces": [PLATE], "camera": CAMERA, "device": NoDevice(), **arguments}
    with pytest.raises(InputError) as caught:
        gs.render(values.pop("surfaces"), values.pop("camera"), **values)
    for part in parts:
        assert part in str(caught.value)


def test_the_device_that_fails_would_be_seen() -> None:
    with pytest.raises(AssertionError, match="the device was used"):
        gs.render([PLATE], CAMERA, device=NoDevice())  # type: ignore[arg-type]


def test_no_lights_at_all_is_dark_not_unlit() -> None:
    camera = gs.Camera.from_lens((36, 24), 30, (57, 33), (0, -1, 0), (0, 0, 0))
    assert gs.render([PLATE], camera, [], backend="numpy").radiance.max() == 0.0
    assert gs.render([PLATE], camera, None, backend="numpy").radiance.max() == np.float32(0.5)


@pytest.mark.parametrize("lights", [[], [gs.EnvironmentLight()]])
def test_a_black_picture_says_that_nothing_shines(lights: list[gs.EnvironmentLight]) -> None:
    camera = gs.Camera.from_lens((36, 24), 50, (9, 7), (0, -1, 0), (0, 0, 0))
    for take in (gs.render, gs.photograph):
        frame = take([PLATE], camera, lights, backend="numpy")
        assert not frame.radiance.any()
        (text,) = frame.warnings
        assert "every surface is black" in text and "None" in text
        for others in (None, [*lights, gs.AmbientLight(0.1)]):
            assert take([PLATE], camera, others, backend="numpy").warnings == ()
