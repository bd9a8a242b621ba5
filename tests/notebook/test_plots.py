"""``plot()``: axes in and out, labels with units, and nothing shown."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

import gpusim as gs
from gpusim.notebook.page import quantity
from gpusim.report.model import Measurement, Report, Series
from tests.support.measure_images import speckles
from tests.support.small_scene import small_scene

CAMERA = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, -2, 0.5), (0, 0, 0.5))


@pytest.fixture(autouse=True)
def quiet(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Without a display; `show` must not be called."""
    matplotlib.use("Agg")
    monkeypatch.setattr(pyplot, "show", lambda *_: pytest.fail("shown"))
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def solution() -> gs.Solution:
    bar = gs.mesh.box(size=(1.0, 0.2, 0.1), divisions=(4, 1, 1))
    fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    forces = np.zeros((2, *bar.points.shape))
    forces[0, -1, 0], forces[1, -1, 2] = 10.0, -20.0
    return gs.solve(gs.Model(bar, gs.Isotropic(1e6, 0.0), fixed=fixed, forces=forces))


def labels(axes: Any) -> list[str]:
    return [
        axes.get_xlabel(),
        axes.get_ylabel(),
        *([axes.get_zlabel()] if axes.name == "3d" else []),
    ]


def test_a_mesh_and_a_surface() -> None:
    mesh = gs.mesh.box(size=(30, 20, 10), divisions=(3, 2, 1))
    axes = mesh.plot(unit="mm", alpha=0.5)
    assert labels(axes) == ["x (mm)", "y (mm)", "z (mm)"]
    assert axes.get_xlim() == (0.0, 30.0) and axes.get_zlim() == (0.0, 10.0)
    wall = gs.Surface([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 1, 2, 3]])
    assert wall.plot(axes) is axes
    _, flat = pyplot.subplots()
    with pytest.raises(gs.InputError, match="ax; got axes of two dimensions; expected three"):
        mesh.plot(flat)


def test_a_solution(solution: gs.Solution) -> None:
    axes = solution.plot(field="z", case=1, scale=3.0, unit="mm")
    assert axes.get_title() == "displacements drawn 3 times"
    bar = axes.figure.axes[1]
    assert bar.get_ylabel() == "displacement along z (mm)"
    assert solution.plot().figure.axes[1].get_ylabel() == "von Mises stress (Pa)"
    with pytest.raises(gs.InputError, match="case; got 2; expected 0 to 1"):
        solution.plot(case=2)
    with pytest.raises(gs.InputError, match="field; got 'stress'; expected one of"):
        solution.plot(field="stress")


def test_a_frame() -> None:
    wall = gs.Surface([[-1, 0, 0], [1, 0, 0], [1, 0, 1], [-1, 0, 1]], [[0, 1, 2, 3]])
    frame = gs.render([wall], CAMERA, backend="numpy")
    axes = frame.plot(cmap="viridis")
    assert labels(axes) == ["column (px)", "row (px)"]
    assert np.array_equal(axes.images[0].get_array(), frame.radiance)
    assert axes.images[0].get_cmap().name == "viridis"
    with pytest.raises(gs.InputError, match="released"):
        gs.Frame(frame.view, None).plot()


def test_a_map() -> None:
    before, after = (speckles(120, 90, shift=shift) for shift in ((0.0, 0.0), (0.3, -0.2)))
    result = gs.measure.dic(before, after, subset=21, step=12, backend="numpy")
    axes = result.plot(component="v", image=before)
    assert labels(axes) == ["x (px)", "y (px)"]
    assert len(axes.images) == 2 and axes.get_ylim()[0] > axes.get_ylim()[1]  # y down
    shown = axes.images[1].get_array()
    assert abs(np.nanmean(shown.filled(np.nan)) + 0.2) < 0.01
    mine = pyplot.subplots()[1]
    assert gs.measure.strain(result, window=3).plot(mine, component="exy") is mine
    with pytest.raises(gs.InputError, match="component; got 'w'; expected one of"):
        result.plot(component="w")


def test_a_map_with_colours_of_its_own() -> None:
    """Luminance, matplotlib's keywords in the values' unit, and pictures that can't be the one."""
    before, after = (speckles(120, 90, shift=shift) for shift in ((0.0, 0.0), (0.3, -0.2)))
    result = gs.measure.dic(before, after, subset=21, step=12, backend="numpy")
    colored = np.stack([before, before // 2, before // 4], axis=-1)
    axes = result.plot(image=colored, vmin=0.0, vmax=1e-4, alpha=0.5)
    assert axes.images[0].get_array().ndim == 2
    assert axes.images[1].get_clim() == (0.0, 1e-4) and axes.images[1].get_alpha() == 0.5
    assert result.plot(vmax=2.0).images[0].get_clim()[1] == 2.0
    limits = pyplot.Normalize(-1.0, 3.0)
    assert result.plot(norm=limits).images[0].norm is limits
    strain = gs.measure.strain(result, window=3)
    assert strain.plot(component="exx", vmin=-1e-3, vmax=1e-3).images[0].get_clim() == (-1e-3, 1e-3)
    for image, words in (
        (before[:40], "got 120 x 40 px; expected the reference picture: points reach x"),
        (before[:, :50], "got 50 x 90 px"), (before[..., None], r"expected \(H, W\)"),
        (before.astype(complex), "complex128"),
    ):  # fmt: skip
        with pytest.raises(gs.InputError, match=rf"DicResult.plot: image; .*{words}"):
            result.plot(image=image)
    for limits in ({"vmin": np.nan}, {"vmin": 2.0, "vmax": 1.0}, {"vmax": -5.0}):
        with pytest.raises(gs.InputError, match=r"plot: vmin, vmax; got .*growing"):
            result.plot(**limits)
    mapped = gs.measure.mapped(result, lambda pixels: pixels / 800.0)
    with pytest.raises(gs.InputError, match=r"MappedResult\.plot: image; got one beside points"):
        mapped.plot(image=before)


def test_numbers_that_are_none(solution: gs.Solution) -> None:
    for scale in (np.nan, np.inf, "much"):
        with pytest.raises(gs.InputError, match=r"Solution\.plot: scale; got .*finite"):
            solution.plot(scale=scale)
    with pytest.raises(gs.InputError, match=r"Camera\.plot: reach; got nan"):
        CAMERA.plot(reach=np.nan)


def test_a_deflection_line() -> None:
    scale = gs.measure.scale_coefficient([[0, 0], [100, 0]], [[0, 0], [50, 0]])
    line = gs.measure.deflection_line([0, 50], [[0, 0], [100, 0]], [[0, 0], [0, 4]], scale)
    axes = line.plot(true=[0.0, -2.1])
    assert labels(axes) == ["position along the member (mm)", "deflection (mm)"]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["true", "measured"]
    true, measured = axes.lines[:2]
    assert true.get_ydata().tolist() == [0.0, -2.1]
    assert np.allclose(measured.get_ydata(), [0.0, -2.0])
    with pytest.raises(gs.InputError, match="true; got shapes"):
        line.plot(true=[1.0])


def test_a_report() -> None:
    x = np.array([0.0, 10.0, 20.0])
    lines = tuple(
        Series(name, x, 2.0 * x, k * x, "position (mm)", "deflection", "mm")
        for name, k in (("a", 1.9), ("b", 2.1))
    )
    tip = Measurement.compare("tip", "mm", 1.0, 2.0)
    report = Report("bar", "x", "done", series=lines, measurements=(tip,))
    axes = report.plot(series="b", label="mine")
    assert labels(axes) == ["position (mm)", "deflection (mm)"]
    assert axes.lines[0].get_ydata().tolist() == (2.1 * x).tolist()
    assert axes.lines[1].get_label() == "mine"
    bars = Report("bar", "x", "done", measurements=(tip,)).plot()
    assert bars.get_xlabel() == "Error relative to the truth (%)"
    assert bars.patches[0].get_width() == pytest.approx(-50.0)
    with pytest.raises(gs.InputError, match="series; got 'c'; expected one of"):
        report.plot(series="c")
    with pytest.raises(gs.InputError, match="nothing was measured"):
        Report("bar", "x", "done").plot()


def test_a_camera_and_a_scene() -> None:
    axes = CAMERA.plot(plane="xz", reach=2.0)
    assert labels(axes) == ["x (m)", "z (m)"]
    eye = axes.lines[-1]
    assert (eye.get_xdata()[0], eye.get_ydata()[0]) == pytest.approx((0.0, 0.5))
    with pytest.raises(gs.InputError, match="plane; got 'zx'"):
        CAMERA.plot(plane="zx")
    odd = gs.Camera(20, 10, [[9, 0, 9], [0, 9, 4], [0, 0, 1]], name="$\\frac$")
    odd.plot().figure.canvas.draw()  # no formula
    scene = small_scene()
    axes = scene.plot()
    assert labels(axes) == ["x (mm)", "y (mm)"]
    places = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])
    assert places.min(axis=0).tolist() == [0.0, 0.0] and places.max(axis=0).tolist() == [
        240.0,
        20.0,
    ]


def test_stress_of_a_hot_body_is_drawn_without_its_free_strain() -> None:
    bar = gs.mesh.box(size=(1.0, 0.2, 0.1), divisions=(4, 1, 1))
    left = np.isclose(bar.points[:, 0], 0.0) & (bar.points[:, 1] < 1e-9)
    fixed = np.zeros(bar.points.shape, dtype=bool)
    fixed[:, 0] = np.isclose(bar.points[:, 0], 0.0)
    fixed[left, 1] = True
    fixed[:, 2] = np.isclose(bar.points[:, 2], 0.0)
    wood = gs.Orthotropic((9e9, 1e9, 1e9), (0.1,) * 3, (1e9,) * 3, 0.0, (1e-3, 0.0, 0.0))
    change = np.stack([np.zeros(len(bar.points)), np.full(len(bar.points), 20.0)])
    forces = np.zeros((2, *bar.points.shape))
    hot = gs.solve(gs.Model(bar, wood, fixed=fixed, forces=forces, temperature=change))
    for case in (0, 1):
        axes = hot.plot(field="von_mises", case=case)
        assert axes.figure.axes[-1].get_ylim()[1] < 1e-3 * 9e9 * 1e-3 * 20.0
    assert "von Mises" in str(hot._repr_html_())


def test_a_solution_at_large_displacements_tells_what_is_stored_and_what_was_done() -> None:
    bar = gs.mesh.box(size=(1.0, 0.2, 0.1), divisions=(4, 1, 1))
    fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    pull = gs.fem.traction(bar, gs.mesh.select_faces(bar, name="x_max"), (1e9, 0, 0))
    model = gs.Model(bar, gs.Hencky(200e9, 0.0), fixed, pull)
    solution = gs.fem.solve(model, geometry="nonlinear", factors=[0.5, 1.0])
    told = str(solution._repr_html_())
    for name, value in (("stored energy", solution.strain_energy),
                        ("work of loads and supports", solution.external_work)):  # fmt: skip
        assert f">{name}</th>" in told and f">{quantity(value[0])}</td>" in told
    assert "energy balance" not in told
