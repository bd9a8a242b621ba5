"""The hard cases at large displacements, family by family."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.stability.nonlinear_blocks import (
    METAL,
    YIELD,
    asked,
    bent_block,
    block,
    dome,
    forced,
    layered,
    metal,
    metal_path,
    mixed_block,
    pressed_metal,
    pushed_corner,
    sheared_metal,
    stretch_of,
    stretched,
    sunk_cube,
    tube,
    turned_fibres,
    unused_node,
)
from benchmarks.stability.nonlinear_bodies import (
    arch,
    arch_way,
    bent_strip,
    crooked_column,
    folded_column,
    guided_strip,
    hanging_chain,
    hanging_strip,
    heated_and_loaded,
    heated_column,
    led_arch,
    perfect_column,
    question_of,
    tied_strip,
    uneven_strip,
)
from benchmarks.stability.nonlinear_suite import WARNED, LargeCase, Question
from benchmarks.stability.suite import RIGHT, TOLD
from gpusim.fem import (
    J2,
    Hencky,
    Isotropic,
    Model,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
)
from tests.support.nonlinear_cases import following_pressure, roll_up

__all__ = ["large_cases"]

UNSTABLE, LIMIT, INSIDE_OUT = "isn't stable", "limit", "inside out"


def _strips() -> Iterator[LargeCase]:
    """Slender cantilevers: proportions, laws, types, units, contrasts, ties."""
    for slender, divisions in ((10, 40), (100, 60), (1000, 200), (2000, 400)):
        width = max(100.0 / slender, 1.0)
        build = partial(bent_strip, slender, [2.0, 10.0] if slender > 10 else [1.0],
                        divisions=(divisions, 1, 1), width=width)  # fmt: skip
        yield LargeCase("slenderness", f"{slender}", build, 1e-3, quick=slender == 1000)
    for law in (NeoHookean, SaintVenantKirchhoff, Hencky):
        build = partial(bent_strip, 1000, [10.0], law=law, divisions=(200, 1, 1))
        yield LargeCase("slenderness", f"1000, {law.__name__}", build, 1e-3)
    for kind, cells in (("hex20", 40), ("tet10", 60), ("wedge15", 40)):
        build = partial(bent_strip, 100, [10.0], kind=kind, divisions=(cells, 1, 1))
        yield LargeCase("slenderness", f"100, {kind}", build, 1e-3)
    for aspect in (20, 200):
        build = partial(bent_strip, 200, [4.0], width=0.5 * aspect, divisions=(80, 1, 1))
        yield LargeCase("aspect of cells", f"{aspect}", build, 1e-3, quick=aspect == 200)
    yield LargeCase("one step", "alpha 100, 75 degrees", partial(bent_strip, 100, [100.0]), 2e-3)
    scales = (("um, Pa", 1e-6, 210e9), ("N, mm", 1.0, 210e3), ("MPa, um", 1e4, 0.21),
              ("nm", 1e-7, 1e3), ("light seconds", 1e12, 1e20))  # fmt: skip
    for name, scale, E in scales:
        build = partial(bent_strip, 100, [10.0], scale=scale, E=E)
        yield LargeCase(
            "units",
            name,
            build,
            1e-3,
        )
    for stiff in ("root", "tip"):
        build = partial(uneven_strip, 1e6, stiff, "direct")
        yield LargeCase("E contrast 1e6", f"stiff {stiff}", build, 1e-3, quick=stiff == "tip")
        yield LargeCase("E contrast 1e6", f"stiff {stiff}, multigrid",
                        partial(uneven_strip, 1e6, stiff, "multigrid"))  # fmt: skip
    yield LargeCase("ties", "meshes that match", partial(tied_strip, (40, 1, 1), (40, 1, 1)))
    yield LargeCase("ties", "3x3 follow 2x2", partial(tied_strip, (40, 2, 2), (40, 3, 3)),
                    quick=True)  # fmt: skip
    yield LargeCase("equations", "an end that stays upright", guided_strip, quick=True)
    for parameter in (12.0, 100.0):
        yield LargeCase("own weight", f"cantilever, {parameter:g}",
                        partial(hanging_strip, parameter, 1000.0))  # fmt: skip
    yield LargeCase("own weight", "a strip that hangs as a string", hanging_chain, 1e-2)


def _stability() -> Iterator[LargeCase]:
    """Columns, arches, domes, heat."""
    for share in (0.9, 1.0):
        yield LargeCase("column", f"{share:g} of Euler, perfect", partial(perfect_column, share))
    for share in (1.1, 1.5):
        yield LargeCase("column", f"{share:g} of Euler, perfect", partial(perfect_column, share),
                        1e-3, WARNED, UNSTABLE, share == 1.5)  # fmt: skip
    for share in (0.9, 1.0, 1.1, 1.5):
        for eccentric in (1e-2, 1e-3):
            build = partial(crooked_column, share, eccentric)
            if (share, eccentric) != (1.5, 1e-3):
                yield LargeCase("column", f"{share:g} of Euler, {eccentric:g} aside", build, 2e-3)
    for share in (1.5, 3.0, 4.0, 12.0):
        yield LargeCase("column", f"{share:g} of Euler, 0.001 aside, one step",
                        partial(folded_column, share), 3e-3, quick=share in (1.5, 3.0))  # fmt: skip
    yield LargeCase("column", "1.5, 4, 12 and 1.5 of Euler, 0.001 aside",
                    partial(folded_column, 1.5, 4.0, 12.0, 1.5), 3e-3)  # fmt: skip
    yield LargeCase("arch", "before its limit", lambda: arch([5.0], [arch_way(5.0)]))
    yield LargeCase("arch", "would swerve before its limit", partial(arch, [8.8], [np.nan]),
                    1e-3, WARNED, UNSTABLE)  # fmt: skip
    for load in (9.5, 20.0):
        yield LargeCase("arch", f"snaps through, {load:g}, one step", partial(arch, [load]))
    yield LargeCase("arch", "through, back, unloaded and again", lambda: arch(
        [12.0, 3.0, 0.0, 1.0], [arch_way(12.0, True), arch_way(3.0), 0.0, arch_way(1.0)]
    ))  # fmt: skip
    yield LargeCase("arch", "led through, one step", partial(led_arch, 8.0, True), 5e-3)
    yield LargeCase("arch", "led half way", partial(led_arch, 5.0, False), 5e-3, WARNED, UNSTABLE)
    yield LargeCase("dome", "led through, one step", partial(dome, 3.0), 1e-6)
    for aside in (1e-3, 1e-2):
        for share in (0.9, 1.5):
            yield LargeCase("heat", f"{share:g} of buckling, {aside:g} aside",
                            partial(heated_column, share, aside), 2e-3)  # fmt: skip
    yield LargeCase("heat", "0.9 of buckling, perfect", partial(heated_column, 0.9, 0.0))
    yield LargeCase("heat", "1.5 of buckling, perfect", partial(heated_column, 1.5, 0.0), 1e-3,
                    WARNED, UNSTABLE, True)  # fmt: skip
    yield LargeCase("heat", "a bimetal strip with a force", heated_and_loaded)


def _turns() -> Iterator[LargeCase]:
    """Pressures that follow, ends that are turned, fibres that turn."""
    for parameter in (12.0, 30.0):
        yield LargeCase("following pressure", f"strip, {parameter:g}", lambda p=parameter:
                        question_of(following_pressure("hex8", (200, 1, 1), p)))  # fmt: skip
    yield LargeCase("following pressure", "a cube under water, just held", partial(sunk_cube, 0.3),
                    1e-6, quick=True)  # fmt: skip
    for nu in (0.49, 0.4999):
        yield LargeCase("following pressure", f"rubber tube, nu {nu:g}, bore twice as wide",
                        partial(tube, nu, 2.0), 2e-2 if nu < 0.499 else 5e-3)  # fmt: skip
    yield LargeCase("end led", "half a turn in two steps", lambda: question_of(
        roll_up("hex8", (50, 1, 1), 0.5, 2)))  # fmt: skip
    yield LargeCase("end led", "half a turn in one step", lambda: replace(
        question_of(roll_up("hex8", (50, 1, 1), 0.5, 1)), expected=np.full((1, 2), np.nan)),
        1e-3, TOLD, INSIDE_OUT)  # fmt: skip
    for degrees in (90.0, 180.0):
        yield LargeCase("orthotropic", f"turned by {degrees:g} degrees",
                        partial(turned_fibres, degrees), 2e-3, quick=degrees == 90.0)  # fmt: skip
    yield LargeCase("orthotropic", "strip", partial(bent_strip, 100, [4.0], law=_fibres), 1e-2)


def _fibres(E: float, nu: float) -> Orthotropic:
    return Orthotropic(E=(E, 0.1 * E, 0.01 * E), nu=(0.0, 0.0, 0.0), G=(0.5 * E, 0.1 * E, 0.5 * E))


def _laws() -> Iterator[LargeCase]:
    """Rubber far from rest, laws that soften, cells inside out, types of cells."""
    for nu in (0.3, 0.45, 0.49, 0.4999):
        for rule in ("incompatible", "bbar"):
            law = NeoHookean(1.0, nu)
            if (nu, rule) != (0.3, "bbar"):
                yield LargeCase("rubber", f"nu {nu:g} {rule}, pressed by 80 %, one step",
                                partial(stretched, law, [-0.8], rule), 1e-5)  # fmt: skip
            yield LargeCase("rubber", f"nu {nu:g} {rule}, pulled by 300 %, one step",
                            partial(stretched, law, [3.0], rule), 1e-5,
                            quick=(nu, rule) == (0.4999, "bbar"))  # fmt: skip
    rubber = NeoHookean(1.0, 0.3)
    yield LargeCase("rubber", "pulled by a force to 5 times its length", partial(
        forced, rubber, [2.0], [stretch_of(rubber, 2.0)]), 1e-5)  # fmt: skip
    factors = [0.0, 0.0, 0.5, 0.5, 0.25, 0.0, -0.1, 0.25, 0.25]
    yield LargeCase("load factors", "none, again, less, below zero", partial(
        forced, rubber, factors, [stretch_of(rubber, f) for f in factors]), 1e-5, quick=True,
    )  # fmt: skip
    yield LargeCase("load factors", "no load at all", partial(forced, rubber, [0.0], [1.0]))
    for law, name in ((SaintVenantKirchhoff(1.0, 0.0), "SaintVenantKirchhoff pressed"),
                      (Hencky(1.0, 0.0), "Hencky pulled")):  # fmt: skip
        most = -0.19 if name.endswith("pressed") else 0.35
        yield LargeCase("laws that soften", f"{name}, below its limit", partial(
            forced, law, [most], [_first(law, most)]), 1e-5)  # fmt: skip
        yield LargeCase("laws that soften", f"{name}, beyond it", partial(
            forced, law, [1.6 * most], [np.nan]), 1e-5, TOLD, LIMIT, most < 0.0)  # fmt: skip
        led = (law, [-0.6]) if most < 0.0 else (Hencky(1.0, 0.3), [3.0])
        yield LargeCase("laws that soften", f"{name}, led beyond it", partial(stretched, *led),
                        1e-5, WARNED, UNSTABLE)  # fmt: skip
    # found after one step, so that its tangent was judged by stresses that are foretold
    yield LargeCase("laws that soften", "Hencky of nu 0, led beyond it", lambda: replace(
        stretched(Hencky(1.0, 0.0), [3.0]), expected=np.full((1, 3), np.nan)), 1e-5, WARNED,
        UNSTABLE)  # fmt: skip
    for law, name, push, ending in (
        (SaintVenantKirchhoff(1.0, 0.3), "SaintVenantKirchhoff", 0.6, TOLD),
        (NeoHookean(1.0, 0.3), "NeoHookean", 0.9, WARNED),
        (Isotropic(1.0, 0.3), "Isotropic", 0.6, WARNED),
    ):
        yield LargeCase("inside out", f"a corner, {name}", partial(pushed_corner, law, push),
                        1e-3, ending, INSIDE_OUT, name == "NeoHookean")  # fmt: skip
    yield LargeCase("inside out", "the whole block", partial(
        _led_through, Isotropic(1.0, 0.3)), 1e-3, TOLD, INSIDE_OUT, True)  # fmt: skip
    for kind in ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15"):
        for law in (NeoHookean(1.0, 0.3), SaintVenantKirchhoff(1.0, 0.3)):
            name = f"{kind}, {type(law).__name__}"
            yield LargeCase("types", name, partial(bent_block, kind, law, 0.02), 1e-6,
                            quick=name in ("tet4, NeoHookean", "hex8, NeoHookean"))  # fmt: skip
    for second in (False, True):
        yield LargeCase("types", "with pyramids" + (", quadratic" if second else ""),
                        partial(mixed_block, second), 1e-5, quick=not second)  # fmt: skip
    yield LargeCase("mesh", "a node of no cell", unused_node, 1e-5, WARNED, "belong to no cell")
    for laws in ((Isotropic(100.0, 0.0), NeoHookean(1.0, 0.0)),
                 (Hencky(3.0, 0.0), SaintVenantKirchhoff(1.0, 0.0)),
                 (NeoHookean(1e6, 0.0), Hencky(1.0, 0.0))):  # fmt: skip
        name = " and ".join(type(law).__name__ for law in laws)
        yield LargeCase("laws side by side", name, partial(layered, laws, 0.5), 1e-5)


def _first(law: Any, force: float) -> float:
    """Stretch on the branch that begins at rest."""
    from scipy.optimize import brentq

    from benchmarks.stability.nonlinear_blocks import uniaxial

    top = 0.58 if force < 0.0 else float(np.e)
    return float(brentq(lambda s: uniaxial(law, s)[1] - force, min(1.0, top), max(1.0, top)))


def _led_through(law: Isotropic) -> Question:
    question = stretched(law, [-0.5])
    return replace(question, factors=[-1.2], expected=np.full((1, 3), np.nan))


def _metals() -> Iterator[LargeCase]:
    """Limit loads, reversal, great steps, cells that can't follow."""
    for share, quick in ((0.5, False), (0.99, True)):
        yield LargeCase("perfectly plastic", f"{share:g} of the limit load", partial(
            forced, metal(0.0), [share * YIELD], metal_path(0.0, [share * YIELD])), 1e-5,
            quick=quick)  # fmt: skip
    for factors in ([1.0], [1.05], [0.5, 0.9, 1.05]):
        yield LargeCase("perfectly plastic", f"{factors} of the limit load", partial(
            forced, metal(0.0), [f * YIELD for f in factors],
            metal_path(0.0, [f * YIELD for f in factors])), 1e-5, TOLD, LIMIT,
        )  # fmt: skip
    yield LargeCase("perfectly plastic", "pressed beyond yield (its area grows)", partial(
        forced, metal(0.0), [-0.5 * YIELD, -1.05 * YIELD], metal_path(0.0, [
            -0.5 * YIELD, -1.05 * YIELD])), 1e-5)  # fmt: skip
    yield LargeCase("hardly hardening", "a force beyond yield", partial(
        forced, metal(0.2), [1.01 * YIELD], [np.nan]), 1e-5, TOLD, LIMIT)  # fmt: skip
    path = [0.5, 1.2, 0.0, -1.2, 0.0, 1.5, 1.5, 1.6]
    yield LargeCase("hardening", "there and back, one step each", partial(
        forced, metal(2000.0), [f * YIELD for f in path], metal_path(2000.0, [
            f * YIELD for f in path])), 1e-4, quick=True)  # fmt: skip
    yield LargeCase("hardening", "near its greatest force, one step", partial(
        forced, metal(2000.0), [4.0 * YIELD], metal_path(2000.0, [4.0 * YIELD])), 1e-4)  # fmt: skip
    yield LargeCase("hardening", "beyond its greatest force", partial(
        forced, metal(2000.0), [5.0 * YIELD], [np.nan]), 1e-5, TOLD, LIMIT)  # fmt: skip
    yield LargeCase("hardening", "sheared by 1, 50 steps", partial(sheared_metal, 1.0, 50), 2e-3)
    yield LargeCase("hardening", "sheared by 1, one step", partial(sheared_metal, 1.0, 1), 2e-3,
                    WARNED, "plastic strain grows", True)  # fmt: skip
    for kind, ending in (("hex8", RIGHT), ("tet4", WARNED)):
        yield LargeCase("hardening", f"{kind} pressed between rough plates",
                        partial(pressed_metal, kind), 0.1, ending, "stiff")  # fmt: skip
    yield LargeCase("hardening", "sheared by 0.02, one step", partial(sheared_metal, 0.02, 1), 2e-3)


def _nonsense() -> Iterator[LargeCase]:
    """Questions that have no answer."""
    wrong = {"empty": [], "NaN": [np.nan], "inf": [np.inf], "two for one load case": [[1.0, 2.0]],
             "a word": "all"}  # fmt: skip
    for name, factors in wrong.items():
        yield LargeCase("load factors", name, partial(asked, factors), 1e-3, TOLD,
                        "solve: factors", name == "empty")  # fmt: skip
    for factor in (1e5, 1e300):
        yield LargeCase("load factors", f"{factor:g}", partial(asked, [factor]), 1e-3, TOLD,
                        "load", factor == 1e5)  # fmt: skip
    yield LargeCase("load factors", "1e-300", partial(asked, [1e-300]), 1e-3, TOLD, "finite")
    changes: dict[str, tuple[Callable[[Model], Model], str]] = {
        "no supports": (lambda m: replace(m, fixed=None, prescribed=None), "can move freely"),
        "a hinge": (_hinged, "free rotation"),
        "a force of NaN": (_not_a_number, "aren't finite"),
        "an infinite temperature": (lambda m: replace(m, temperature=np.inf), "aren't finite"),
    }
    for name, (change, cause) in changes.items():
        yield LargeCase("model", name, partial(asked, [1.0], change), 1e-3, TOLD, cause,
                        name == "a hinge")  # fmt: skip
    yield LargeCase("model", "a metal of no yield stress", _no_yield, 1e-3, TOLD, "yield_stress")


def _hinged(model: Model) -> Model:
    points = model.mesh.points
    edge = (points[:, 0] == 0.0) & (points[:, 2] == 0.0)
    return replace(model, fixed=np.repeat(edge[:, None], 3, axis=1), prescribed=None)


def _not_a_number(model: Model) -> Model:
    forces = np.zeros(block().points.shape)
    forces[-1, 0] = np.nan
    return replace(model, forces=forces)


def _no_yield() -> Question:
    return forced(J2(METAL, 0.0, 1.0), [1.0], [1.0])


def large_cases() -> Iterator[LargeCase]:
    """Every case, family by family."""
    for family in (_strips, _stability, _turns, _laws, _metals, _nonsense):
        yield from family()
