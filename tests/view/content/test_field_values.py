"""Fields by name: the truth is that of truth.h5, and all that is listed can be shown."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.view.content.field_values import field_names, field_values
from gpusim.view.content.loading import load_content
from gpusim.view.viewer import Viewer
from gpusim.visualization.field_colors import corner_values, interpolated, surface_field


@pytest.mark.parametrize(
    ("name", "layer", "component", "factor", "tolerance"),
    [
        ("truth_depth", "depth", None, 1e3, 1e-4),
        ("truth_flow_y", "flow", 1, 1.0, 2e-4),
        ("truth_displacement_z", "displacement", 2, 1e3, 1e-6),
        ("truth_reference_x", "reference", 0, 1e3, 1e-5),
    ],
)
def test_the_truth_is_that_of_a_run(
    run_folder: Path, name: str, layer: str, component: int | None, factor: float, tolerance: float
) -> None:
    """At every pixel, of what a run has found pixel by pixel; depth is stored as float32."""
    content = load_content(run_folder)
    camera = content.cameras[0]
    frame = gs.render(content.surfaces(1), camera, backend="numpy")
    found = field_values(content, name, 1)
    fields = [surface_field(content.skins[0], found.values[0])]
    shown = interpolated(
        frame.view, frame.ids(), corner_values(frame.view, content.surfaces(1), fields)
    )
    with h5py.File(run_folder / "truth.h5") as file:
        truth = factor * file[f"camera/side/frame/0001/{layer}"][()]
    truth = truth if component is None else truth[..., component]
    own = np.isfinite(truth)
    assert own.sum() > 3000 and np.ptp(truth[own]) > 10 * tolerance
    np.testing.assert_allclose(shown[own], truth[own], rtol=0, atol=tolerance)


def test_all_that_is_listed_can_be_shown(run_viewer: Viewer) -> None:
    names = field_names(run_viewer.content)
    assert {"displacement", "von_mises", "strain_xy", "element_von_mises", "truth_flow"} <= {*names}
    for name in names:
        run_viewer.show_field(name)
        assert run_viewer.field_values is not None
        assert np.isfinite(run_viewer.field_values.values[0]).all(), name
    with pytest.raises(gs.InputError, match=r"truth_normal_x.*expected one of displacement"):
        run_viewer.show_field("truth_normal_x")


def test_the_truth_is_that_of_the_camera_that_is_looked_through(
    run_folder: Path, run_viewer: Viewer
) -> None:
    content = run_viewer.content
    assert content is not None
    other = gs.Camera.from_lens((36, 24), 50, (600, 400), (0.1, 0.7, 0.2), (0.1, 0, 0), name="back")
    content.cameras = (*content.cameras, other)
    content.__dict__.pop("depths_of_field", None)
    content.grey_weights = lambda number: None  # type: ignore[method-assign]
    content.__dict__["depths_of_field"] = [None, None]
    run_viewer.show_field("truth_depth")
    assert run_viewer.field_values is not None
    assert run_viewer.field_values.field.label() == "side: depth (mm)"
    run_viewer.look_through(1)
    nodes = content.skins[0].mesh.points + content.displacement(0, 1)
    wanted = 1e3 * (nodes - other.eye) @ other.camera_from_world[2, :3]
    np.testing.assert_allclose(run_viewer.field_values.values[0], wanted, rtol=1e-12)
    run_viewer.look_through(None)
    assert run_viewer.field_values.field.label() == "back: depth (mm)"
