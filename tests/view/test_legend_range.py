"""A legend over a frame, over all of them, or held; typed, and stepped by keys."""

from __future__ import annotations

from pathlib import Path

import pytest

import gpusim as gs
from gpusim.view.screenshot import look_as_asked, screenshot
from gpusim.view.viewer import Viewer


def test_the_range_over_frames(run_viewer: Viewer) -> None:
    viewer = run_viewer
    viewer.show_field("displacement")
    loaded = viewer.color_scale.limits
    viewer.show_frame(0)
    assert viewer.color_scale.limits != loaded  # each frame's own: nothing has moved
    viewer.key("n")  # held as it is now
    unloaded = viewer.color_scale.limits
    viewer.show_frame(1)
    assert viewer.color_scale.limits == unloaded
    viewer.key("n")  # of all frames
    assert viewer.color_scale.limits == loaded
    viewer.show_frame(0)
    assert viewer.color_scale.limits == loaded
    viewer.show_field("displacement_z")
    assert viewer.color_scale.limits == (-loaded[1], 0.0)
    viewer.key("n")
    assert viewer.legend_range.kind == "frame" and viewer.color_scale.limits == unloaded


def test_keys_make_it_narrower_and_wider(run_viewer: Viewer) -> None:
    viewer = run_viewer
    viewer.show_field("von_mises")
    low, high = viewer.color_scale.limits
    before = screenshot(viewer)
    viewer.key("<")
    assert viewer.color_scale.limits == (low / 2, high / 2) and viewer.color_scale.above
    assert (screenshot(viewer) != before).mean() > 0.01
    viewer.show_field("stress_xx")  # MPa, too
    assert viewer.color_scale.limits == (low / 2, high / 2)
    viewer.show_field("displacement")  # another unit: as far as it reaches
    assert viewer.color_scale.limits != (low / 2, high / 2)
    viewer.key(">")
    viewer.key("r")
    viewer.show_field("von_mises")
    assert viewer.color_scale.limits == (low, high)


def test_typed_limits(run_viewer: Viewer) -> None:
    look_as_asked(run_viewer, None, 1, "stress_xx", legend=(-30.0, 45.0))
    assert run_viewer.color_scale.limits == (-30.0, 45.0)
    assert run_viewer.color_scale.colormap == "viridis"  # zero isn't in the middle
    with pytest.raises(gs.InputError, match="view --legend; got no --field"):
        look_as_asked(run_viewer, None, None, None, legend=(0.0, 1.0))


@pytest.mark.parametrize(
    "legend",
    [(3.0, 1.0), (0.0, float("nan")), (float("nan"), 0.0), (-float("inf"), 0.0), (-1e308, 1e308),
     (0.0, 1e300), (0.0, 5e-324), (1.0, 1.0 + 1e-12)],
)  # fmt: skip
def test_limits_that_no_legend_has(run_viewer: Viewer, legend: tuple[float, float]) -> None:
    expected = r"view --legend; got .*; expected LOW HIGH, growing by 1e-06 of the larger one"
    with pytest.raises(gs.InputError, match=expected):
        look_as_asked(run_viewer, None, None, "von_mises", legend=legend)


@pytest.mark.parametrize("legend", [(-1e30, 1e30), (0.0, 1e-30), (1.0, 1.00001)])
def test_the_widest_and_narrowest_limits_are_drawn(
    run_viewer: Viewer, legend: tuple[float, float]
) -> None:
    look_as_asked(run_viewer, None, 1, "stress_xx", legend=legend)
    screenshot(run_viewer)
    assert run_viewer.color_scale.limits == legend
    for key in "<>":  # no further than that
        for _ in range(300):
            run_viewer.key(key)
        low, high = run_viewer.color_scale.limits
        assert -1e30 <= low < high <= 1e30
    screenshot(run_viewer)


def test_keys_that_are_asked_for(run_folder: Path, run_viewer: Viewer) -> None:
    look_as_asked(run_viewer, None, None, "von_mises", keys=["k", "PageUp", "t", "space"])
    assert run_viewer.cut is not None and run_viewer.cut.share == pytest.approx(0.55)
    assert run_viewer.shown["fields"] and run_viewer.playing and not run_viewer.message
    with pytest.raises(gs.InputError, match="view --keys; got 'Q'; expected one of 1, 3"):
        look_as_asked(run_viewer, None, None, None, keys=["Q"])
