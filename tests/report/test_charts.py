"""Charts: what isn't zero is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpusim.export.images import read_image
from gpusim.report import Chart, draw_chart
from gpusim.report.style import MEASURED, TRUTH


def share_of(color: str, picture: np.ndarray) -> float:
    """Of the pixels that have a colour "#rrggbb"."""
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return float((np.abs(picture.astype(int) - wanted) <= 2).all(axis=-1).mean())


def test_curves_are_drawn_and_zeros_are_left_out(tmp_path: Path) -> None:
    x = np.linspace(0.0, 1.0, 50)
    curves = {"still": 0.0 * x, "moved": 1.0 + x, "quick": (1.0 + x) ** 2}
    chart = Chart("Motion", "Of a point.", "Time (s)", "mm", x.tolist(),
                  {name: values.tolist() for name, values in curves.items()})  # fmt: skip
    for log in (False, True):
        figure = draw_chart(Chart(**{**vars(chart), "log": log}), tmp_path / "chart.png")
        assert (figure.title, figure.caption) == ("Motion", "Of a point.")
        picture = read_image(tmp_path / "chart.png")
        assert min(share_of(TRUTH, picture), share_of(MEASURED, picture)) > 1e-3
