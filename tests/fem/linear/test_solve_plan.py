"""The plan of a solve: its choices and their reasons."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble, model_lattice
from gpusim.fem.assembly.system import make_system
from gpusim.fem.linear.solve_plan import Clock, Options, SolvePlan, plan_solve
from gpusim.fem.model.model import resolve_formulation
from gpusim.mesh import box


def held(divisions: tuple[int, int, int], nu: float = 0.3, load: float = 1.0) -> Model:
    mesh = box((1.0, 0.9, 1.1), divisions)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    return Model(mesh, [Isotropic(1.0, nu)], fixed, load * np.ones(mesh.points.shape))


def planned(
    model: Model, method: str = "auto", backend: str = "numpy", formulation: str | None = None
) -> SolvePlan:
    rules = resolve_formulation(model, formulation)
    assembled = assemble(model, rules, model_lattice(model))
    options = Options(method, None, backend, 1e-6, None, None, None, rules, Clock())
    return plan_solve(model, assembled, make_system(model, assembled), options)


@pytest.mark.parametrize(
    ("model", "options", "attempts", "word"),
    [
        (held((2, 2, 2)), {}, ("direct",), "of multigrid's time"),
        (held((2, 2, 2)), {"method": "direct"}, ("direct",), "asked for"),
        (held((2, 2, 2)), {"method": "multigrid"}, ("multigrid",), "asked for"),
        (held((2, 2, 2), load=0.0), {"method": "direct"}, ("none",), "no load"),
        (held((24, 24, 24)), {}, ("multigrid", "direct"), "at least"),
        (held((4, 4, 4), 0.4999), {"method": "multigrid"}, ("multigrid",), "displacements alone"),
        (held((4, 4, 4), 0.4999), {"method": "multigrid", "formulation": "bbar"},
         ("pressures", "multigrid"), "pressures together"),
    ],
)  # fmt: skip
def test_attempts_have_reasons(
    model: Model, options: dict[str, Any], attempts: tuple[str, ...], word: str
) -> None:
    plan = planned(model, **options)
    assert plan.attempts == attempts
    assert word in str(plan)
    assert len(plan.lines) == len(plan.reasons)


def test_the_place_is_chosen_with_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    model = held((2, 2, 2))
    for software, place in ((True, "on the host"), (False, "on the device")):
        monkeypatch.setattr(
            "gpusim.fem.linear.solve_plan.software_adapter", lambda own=software: own
        )
        plan = planned(model, "multigrid", "auto")
        assert plan.on_device != software
        assert plan.reasons["iterations"].startswith(place)
    assert "asked for" in planned(model, "multigrid", "gpu").reasons["iterations"]


def test_a_plan_is_frozen_and_a_solution_tells_it() -> None:
    plan = planned(held((2, 2, 2)))
    with pytest.raises(FrozenInstanceError):
        plan.on_device = True  # type: ignore[misc]
    assert solve(held((2, 2, 2)), backend="numpy").reasons == plan.lines
