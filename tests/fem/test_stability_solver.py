"""The quick part of the stability suite: no silent failure, in any way of solving."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.solver.reference import Reference, reference_solution
from benchmarks.stability.hard_cases import HardCase, hard_cases
from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD, WAYS, run_suite, try_case
from gpusim.fem import Isotropic, Model, Solution, face_force
from gpusim.gpu import Device
from gpusim.mesh import box, select_faces

QUICK = [case for case in hard_cases() if case.quick]
# how each must end where the fastest way is left to the solver
BEYOND_FLOAT64 = {
    # right to 3e-7, but the rounding of its equal rows can't be bounded below the tolerance
    "slenderness 1000 incompatible long cells",
    "slenderness 10000 incompatible long cells",
    "aspect 1000 incompatible flat",
    "thin plate 1000 incompatible",
    "E contrast 1e+08 incompatible soft root",
}


SLOW = {"slenderness 1000 incompatible cubes"}  # half of the time of all references


@cache
def answer(name: str) -> tuple[Model, Reference]:
    """Model and reference of a case, once for every way."""
    (case,) = [case for case in QUICK if case.name == name]
    model = case.build()
    return model, reference_solution(model, case.rules)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.slow] * (case.name in SLOW))
        for case in QUICK
    ],
)
def test_right_or_told(case: HardCase, device: Device) -> None:
    verdict = try_case(case, "auto", device, answer(case.name))
    assert verdict.verdict in (RIGHT, TOLD), verdict.message
    if case.name not in BEYOND_FLOAT64:
        assert verdict.verdict == RIGHT, verdict.message


@pytest.mark.parametrize("way", [way for way in WAYS if way != "auto"])
def test_multigrid_never_fails_silently(way: str) -> None:
    names = ("E contrast 1e+08 incompatible scattered", "E contrast 1e+08 incompatible layers",
             "E contrast 1e+08 incompatible islands",
             "offset in cells 1e+06 incompatible", "two bodies 1e+06 incompatible",
             "tets 100 tet4 full", "pulled plate 0.0001 tet10 full 0.03 thick, to 0.1")  # fmt: skip
    _, backend, real = WAYS[way]
    device = Device(real=real) if backend == "gpu" else None
    for case in QUICK:
        if case.name in names:
            verdict = try_case(case, way, device, answer(case.name))
            assert verdict.verdict != SILENT, f"{case.name}: {verdict.message}"


def small_case(quick: bool = False) -> HardCase:
    return HardCase("slenderness", 3.0, lambda: beam((3.0, 1.0, 0.7), (6, 2, 2)),
                    {"hex8": "full"}, quick)  # fmt: skip


def beam(size: tuple[float, float, float], divisions: tuple[int, int, int]) -> Model:
    mesh = box(size, divisions)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.2, 0.1, -1.0))
    return Model(mesh, [Isotropic(2e5, 0.3)], fixed=fixed, forces=forces)


def test_a_wrong_answer_is_a_silent_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge itself: a solver that is off by 2e-6 and says that it isn't."""
    from dataclasses import replace

    import benchmarks.stability.suite as module

    honest = module.solve

    def liar(*arguments: object, **options: object) -> Solution:
        solution = honest(*arguments, **options)  # type: ignore[arg-type]
        return replace(solution, u=solution.u * (1.0 + 2e-6))

    (right,) = run_suite([small_case()], ["numpy"])
    assert right.verdict == RIGHT and right.error <= 1e-6
    monkeypatch.setattr(module, "solve", liar)
    (wrong,) = run_suite([small_case()], ["numpy"])
    assert wrong.verdict == SILENT and wrong.error > 1e-6


def test_other_endings_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    import benchmarks.stability.suite as module
    from gpusim.errors import NotConverged

    def ends(error: Exception) -> str:
        def fails(*arguments: object, **options: object) -> Solution:
            raise error

        monkeypatch.setattr(module, "solve", fails)
        return run_suite([small_case()], ["numpy"])[0].verdict

    assert ends(NotConverged("the body is too slender")) == TOLD
    assert ends(NotConverged("no luck")) == STOPPED
    assert ends(ZeroDivisionError("1/0")) == SILENT
