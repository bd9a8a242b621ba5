"""The legend's colours stand beside their ticks."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.gpu import Device
from gpusim.visualization.color_scale import ColorScale, color_map
from gpusim.visualization.legend import draw_legend, legend_width
from gpusim.visualization.overlay import Overlay, pixels_of


def test_the_legend_has_its_colours_beside_their_ticks(device: Device) -> None:
    scale = ColorScale(-4.0, 4.0, (-4.0, -2.0, 0.0, 2.0, 4.0), "coolwarm", False, True)
    target = device.texture(200, 300, "rgba8unorm", "test.legend")
    overlay = Overlay(device)
    right = 10 + legend_width(overlay, scale, "Displacement z (mm)", 13)
    wide, tall = draw_legend(overlay, scale, "Displacement z (mm)", right, 10, 201, 13)
    assert wide < 180 and tall < 280
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    found = pixels_of(device, target)[..., :3] / 255.0
    colors = color_map("coolwarm")
    bar = found[:, 24]
    ends = [np.argmin(np.abs(bar - colors[k]).sum(axis=1)) for k in (-1, 0)]
    rows = np.flatnonzero((np.abs(bar[:, None] - colors[None]).sum(axis=2) < 0.02).any(axis=1))
    assert rows.max() - rows.min() + 1 >= 201 and ends[0] < ends[1]
    # marks are dark lines right of the bar: the middle one beside the middle colour
    dark = 45 + np.flatnonzero(found[45:265, 39].sum(axis=1) < 0.6)
    assert len(dark) == 5
    assert np.abs(bar[dark[2]] - colors[127]).max() < 0.02
    assert np.diff(dark) == pytest.approx(50.0, abs=1.0)
    assert np.abs(bar[dark] - colors[[255, 191, 127, 64, 0]]).max() < 0.03
