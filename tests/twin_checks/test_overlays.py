"""The checks of the window's programs see one value that the device got wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import TwinMismatch
from gpusim.gpu import Buffer, Device, twin_checks


@pytest.mark.parametrize(
    ("stage", "label", "place"),
    [
        ("visualization/overlay", "overlay.quads", 8),  # red of the first
        ("visualization/field_colors", "view.values", 3),
        ("visualization/field_colors", "view.colors", 5),
        ("view/picture/display", "twin.band 1", 64 * 5 + 11),  # grey and red, first rows
        ("view/picture/display", "twin.band 6", 64 * 4 + 11),  # blue, last rows
        ("view/picture/enlarge", "twin.band 6", 64 * 4 + 11),
    ],
)
def test_one_changed_value_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, stage: str, label: str, place: int
) -> None:
    buffer = Device.buffer
    found = []

    def changed(self: Device, array: npt.NDArray[Any], name: str) -> Buffer:
        found.append(name)
        if label in (name, f"{name} {found.count(name)}"):
            array = np.array(array)
            array.view(np.float32).reshape(-1)[place] += 0.1
        return buffer(self, array, name)

    monkeypatch.setattr(Device, "buffer", changed)
    with pytest.raises(TwinMismatch, match=r"of .* values off"):
        twin_checks()[stage](device)
