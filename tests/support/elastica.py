"""Slender bars at large displacements, by integration of their differential equations.

Reissner's beam (J. Appl. Math. Phys. 23 (1972) 795) in the plane and Simo's in space: sections stay
flat, strains are those in the section's axes, stretch and shear included.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

Float = npt.NDArray[np.float64]

_SHEAR_AREA = 5.0 / 6.0
# torsion constant of a square section over its side to the fourth (Timoshenko & Goodier)
_SQUARE_TORSION = 0.140577
# of the length: as far as displacements are integrated
_SMALL = 1e-10


@dataclass(frozen=True)
class Strip:
    """A bar of rectangular section, ``height`` in the plane of bending, nu = 0."""

    length: float
    width: float
    height: float
    E: float
    curvature: float = 0.0

    @property
    def bending(self) -> float:
        """E I."""
        return self.E * self.width * self.height**3 / 12.0

    @property
    def stretching(self) -> float:
        """E A."""
        return self.E * self.width * self.height

    @property
    def shearing(self) -> float:
        """kappa G A."""
        return _SHEAR_AREA * 0.5 * self.stretching


@dataclass(frozen=True)
class DistributedLoad:
    """Per length of the undeformed bar: ``dead`` (2,), and a pressure times width ``following`` on
    the upper face, which pushes against the normal (-sin, cos)."""

    dead: tuple[float, float] = (0.0, 0.0)
    following: float = 0.0


def integrated(strip: Strip, start: Float, load: DistributedLoad, length: float) -> Float:
    """State (x, z, angle, force x, force z, moment) at ``length`` (negative: backwards) from the
    state ``start``: what the part beyond a section exerts on it."""

    def slope(_: float, state: Float) -> Float:
        angle, force, moment = state[2], state[3:5], state[5]
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        stretch = 1.0 + float(force @ along) / strip.stretching
        shear = float(force @ across) / strip.shearing
        bend = moment / strip.bending + strip.curvature
        path = stretch * along + shear * across
        # the upper face is shorter than the middle where the bar bends upwards
        face = stretch - 0.5 * strip.height * bend
        change = load.following * face * across - np.array(load.dead)
        turn = path[1] * force[0] - path[0] * force[1]
        return np.array([*path, bend, *change, turn])

    found = solve_ivp(slope, (0.0, length), start, "DOP853", rtol=1e-9, atol=_SMALL * abs(length))
    assert found.success
    return np.asarray(found.y[:, -1])


def _root(function: Callable[[Float], Float], guess: Float) -> Float:
    found = root(function, guess, tol=1e-9)
    assert np.abs(function(found.x)).max() <= 1e-6, found.message
    return np.asarray(found.x)


@cache
def cantilever(
    strip: Strip, end: tuple[float, float], load: DistributedLoad, shares: int = 12
) -> tuple[float, float, float]:
    """x, z, angle of the free end under the dead force ``end``, clamped at 0 along x; found in so
    many ``shares`` of the load."""

    def clamped(angle: float, share: float) -> Float:
        given = DistributedLoad((share * load.dead[0], share * load.dead[1]),
                                share * load.following)  # fmt: skip
        force = share * np.array(end)
        return integrated(strip, np.array([0, 0, angle, *force, 0.0]), given, -strip.length)

    angle = 0.0
    for share in np.arange(1, shares + 1) / shares:
        turned = lambda a, share=share: clamped(a[0], share)[2:3]  # noqa: E731
        angle = float(_root(turned, np.array([angle]))[0])
    clamp = clamped(angle, 1.0)
    # the end was put at 0: the clamp is where the end's distance begins
    return -float(clamp[0]), -float(clamp[1]), angle


def inextensible_cantilever(alpha: float) -> tuple[float, float]:
    """w/L and u/L of the end for P L^2/E I = ``alpha`` (Bisshopp & Drucker, Quart. Appl. Math. 3
    (1945) 272)."""

    def left(k: float) -> float:
        return float(ellipk(k * k) - ellipkinc(np.arcsin(np.sqrt(0.5) / k), k * k)) - alpha**0.5

    k = brentq(left, np.sqrt(0.5) + 1e-14, 1.0 - 1e-14)
    arc = float(ellipe(k * k) - ellipeinc(np.arcsin(np.sqrt(0.5) / k), k * k))
    return 1.0 - 2.0 * arc / alpha**0.5, 1.0 - ((4.0 * k * k - 2.0) / alpha) ** 0.5


def pulled_ring(strip: Strip, force: float) -> tuple[float, float]:
    """How far the loaded points of a ring move outwards, and its sides (negative: inwards), under
    two opposite forces; ``strip.length`` is its circumference."""
    quarter, radius = 0.25 * strip.length, 0.5 * strip.length / np.pi

    def side(moment: float, share: float) -> Float:
        # from the loaded point at the top, along x, down to the side
        start = np.array([0, 0, 0, 0, -0.5 * share * force, moment])
        return integrated(strip, start, DistributedLoad(), quarter)

    moment = 0.0
    for share in np.linspace(0.02, 1.0, 50):

        def shortfall(unknown: Float, share: float = share) -> Float:
            return side(unknown[0] * strip.bending / radius, share)[2:3] + 0.5 * np.pi

        moment = float(_root(shortfall, np.array([moment]))[0])
    x, z = side(moment * strip.bending / radius, 1.0)[:2]
    return float(-z - radius), float(x - radius)


def clamped_arch(strip: Strip, rise: float, half_angle: float, ways: Float) -> Float:
    """Loads at the crown of a symmetric clamped arch, at which it has moved down by ``ways``;
    ``strip.curvature`` is minus one over its radius."""
    half = 0.5 * strip.length
    span = np.sin(half_angle) / abs(strip.curvature)
    sizes = np.array([strip.bending / span**2] * 2 + [strip.bending / span])

    def clamp(unknown: Float, way: float) -> Float:
        load, thrust, moment = unknown * sizes
        start = np.array([0.0, rise - way, 0.0, -thrust, 0.5 * load, moment])
        x, z, angle = integrated(strip, start, DistributedLoad(), half)[:3]
        return np.array([x / span - 1.0, z / span, angle + half_angle])

    loads, guess = [], np.zeros(3)
    for way in ways:
        guess = _root(lambda unknown, way=way: clamp(unknown, way), guess)
        loads.append(guess[0] * sizes[0])
    return np.array(loads)


def curved_cantilever(radius: float, side: float, E: float, forces: Float) -> Float:
    """(F,3) displacements of the end of an eighth of a circle in the xy plane, clamped at 0 along
    x, curving towards +y, square section, nu = 0, under ``forces`` along z."""
    length = 0.25 * np.pi * radius
    inertia = side**4 / 12.0
    resist = np.array([0.5 * E * _SQUARE_TORSION * side**4, E * inertia, E * inertia])
    stretch = E * side**2 * np.array([1.0, 0.5 * _SHEAR_AREA, 0.5 * _SHEAR_AREA])

    def slope(_: float, state: Float, force: float) -> Float:
        axes, moment = state[3:12].reshape(3, 3), state[12:]
        push = np.array([0.0, 0.0, force])
        strain = np.array([1.0, 0, 0]) + axes.T @ push / stretch
        bend = axes.T @ moment / resist + np.array([0.0, 0.0, 1.0 / radius])
        path = axes @ strain
        turn = axes @ np.cross(np.eye(3), bend)
        return np.concatenate([path, turn.ravel(), -np.cross(path, push)])

    def end(unknown: Float, force: float) -> Float:
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), [*unknown * E * inertia, 0.0]])
        found = solve_ivp(
            slope, (0.0, length), start, "DOP853", args=(force,), rtol=1e-8, atol=1e-9
        )
        return np.asarray(found.y[:, -1])

    rest = radius * np.array([np.sin(0.25 * np.pi), 1.0 - np.cos(0.25 * np.pi), 0.0])
    size = E * inertia / radius
    answers, guess, before = [], np.zeros(2), 0.0
    for force in forces:
        for step in np.linspace(before, force, 11)[1:]:
            free: Callable[[Float], Float] = lambda a, step=step: end(a, step)[12:14] / size  # noqa: E731
            guess = _root(free, guess)
        answers.append(end(guess, force)[:3] - rest)
        before = force
    return np.array(answers)
