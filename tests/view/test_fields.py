"""Fields of a bar that is pulled, known in closed form; round limits; the legend's colours."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.view.content.body_state import BodyState
from gpusim.view.fields import (
    FIELDS,
    ColorScale,
    color_map,
    draw_legend,
    field_kind,
    format_value,
    legend_width,
    scale_of,
    surface_field,
)
from gpusim.view.overlay import Overlay, pixels_of
from tests.support.view_bodies import small_crane

E, NU, STRESS = 70e9, 0.3, 21e6


def pulled_bar() -> BodyState:
    """Stress 21 MPa along y, exactly, and a hundredth of it along z."""
    bar = gs.mesh.box(size=(0.1, 0.4, 0.2), divisions=(2, 3, 2))
    model = gs.Model(bar, gs.Isotropic(E, NU))
    own = np.array([0.0, STRESS, 0.01 * STRESS])
    strain = ((1.0 + NU) * own - NU * own.sum()) / E
    return BodyState(bar, bar.points * strain, model)


def test_stress_and_strain_of_a_pulled_bar() -> None:
    state = pulled_bar()
    own = np.array([0.0, 21.0, 0.21])
    mises = np.sqrt(0.5 * (21.0**2 + 20.79**2 + 0.21**2))
    expected = {
        "von_mises": mises, "element_von_mises": mises, "principal_stress_1": 21.0,
        "principal_stress_2": 0.21,
        "principal_stress_3": 0.0, "stress_xx": 0.0, "stress_yy": 21.0, "stress_zz": 0.21,
        "stress_xy": 0.0, "error_share": 0.0,
        "strain_yy": 1e3 * (own[1] - NU * own[2]) / (1e-6 * E),
        "principal_strain_1": 1e3 * (own[1] - NU * own[2]) / (1e-6 * E),
        "principal_strain_3": -1e3 * NU * (own[1] + own[2]) / (1e-6 * E),
    }  # fmt: skip
    for name, value in expected.items():
        values = field_kind(name).values(state)
        count = state.mesh.cell_count if FIELDS[name].by_cell else state.mesh.node_count
        assert values.shape == (count,)
        assert values == pytest.approx(value, rel=1e-9, abs=1e-8), name


def test_shear_strain_is_the_tensors() -> None:
    bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    u = np.stack([4e-4 * bar.points[:, 1], 0 * bar.points[:, 0], 0 * bar.points[:, 0]], axis=1)
    state = BodyState(bar, u, gs.Model(bar, gs.Isotropic(E, NU)))
    assert field_kind("strain_xy").values(state) == pytest.approx(0.2, rel=1e-9)
    assert field_kind("principal_strain_1").values(state) == pytest.approx(0.2, rel=1e-9)
    assert field_kind("stress_xy").values(state) == pytest.approx(4e-4 * E / 2.6 * 1e-6, rel=1e-9)


def test_displacement_and_stress_that_is_given() -> None:
    crane = small_crane()
    mesh, solution = crane.model.mesh, crane.solution
    stress = np.tile([5e6, 0, 0, 0, 0, 0], (mesh.node_count, 1))
    state = BodyState(mesh, solution.u, nodal_stress=stress)
    u = 1e3 * solution.u
    assert field_kind("displacement").values(state) == pytest.approx(np.hypot.reduce(u, axis=1))
    assert field_kind("displacement_z").values(state) == pytest.approx(u[:, 2])
    assert field_kind("von_mises").values(state) == pytest.approx(5.0)


def test_what_a_body_has_not_is_said() -> None:
    bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    state = BodyState(bar, 0 * bar.points)
    with pytest.raises(InputError, match="without a material"):
        field_kind("von_mises").values(state)
    with pytest.raises(InputError, match="got 'mises'; expected one of displacement, "):
        field_kind("mises")


def test_on_the_surface_by_node_and_by_element() -> None:
    skin = small_crane().skin
    nodes = surface_field(skin, FIELDS["von_mises"], skin.mesh.points[:, 2])
    assert nodes.values == pytest.approx(small_crane().surface.rest[:, 2]) and not nodes.by_face
    cells = surface_field(skin, FIELDS["error_share"], np.arange(skin.mesh.cell_count) + 0.0)
    assert (cells.values == skin.cell_of_piece).all() and cells.by_face


@pytest.mark.parametrize(
    ("values", "signed", "limits", "map_name"),
    [
        (np.linspace(0.3, 37.0, 400), False, (0.0, 40.0), "viridis"),
        (np.linspace(812.0, 858.0, 400), False, (810.0, 860.0), "viridis"),
        (np.linspace(-3.1, 0.4, 400), True, (-4.0, 4.0), "coolwarm"),
        (np.linspace(1.3, 9.4, 400), True, (0.0, 10.0), "viridis"),
        (np.linspace(-9.4, -1.3, 400), True, (-10.0, 0.0), "viridis"),
        (np.zeros(40), False, (0.0, 1.0), "viridis"),
        (np.full(40, 7.0), False, (0.0, 8.0), "viridis"),
    ],
)
def test_limits_are_round(
    values: np.ndarray, signed: bool, limits: tuple[float, float], map_name: str
) -> None:
    scale = scale_of([values, values[:3]], signed)
    assert scale.limits == pytest.approx(limits) and scale.colormap == map_name
    assert scale.ticks[0] == scale.low and scale.ticks[-1] == scale.high
    assert not scale.below and not scale.above


def test_a_few_values_beyond_do_not_stretch_the_colours() -> None:
    values = np.concatenate([np.linspace(0.0, 50.0, 5000), [4000.0]])
    scale = scale_of([values])
    assert scale.limits == (0.0, 50.0) and scale.above and not scale.below


def test_numbers_for_people() -> None:
    assert [format_value(v, 0.25) for v in (0.0, 0.25, -0.5)] == ["0", "0.25", "−0.5"]  # noqa: RUF001
    assert [format_value(v, 20.0) for v in (0.0, 40.0)] == ["0", "40"]
    assert format_value(3e-5, 1e-5) == "3×10⁻⁵" and format_value(2e6, 1e6) == "2×10⁶"  # noqa: RUF001


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
