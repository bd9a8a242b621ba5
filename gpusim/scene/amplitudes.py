"""Which loads vary together over the frames: they are solved as one, and scaled.

The answer is linear in the loads. So frame k shows the sum over a body's groups of the group's
displacement times its amplitude in frame k, and only as many systems are solved as there are
groups; most scenes have one, with the analysis' load factors as its amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gpusim.scene.description.model import Amplitude, Body, FieldMesh

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["LoadGroup", "LoadHistory", "load_groups"]

Share = tuple[int, float]


@dataclass(frozen=True)
class LoadGroup:
    """Loads and supports of a body whose amplitudes are multiples of ``amplitude``.

    ``loads`` and ``supports`` are (index in the body, factor): its amplitude over the group's.
    """

    amplitude: Amplitude
    loads: tuple[Share, ...]
    supports: tuple[Share, ...]


def load_groups(body: Body, factors: Amplitude, scaled: bool = True) -> tuple[LoadGroup, ...]:
    """The body's groups; the one of the load ``factors`` first, if there is such.

    ``scaled=False`` puts only equal amplitudes together, not multiples of each other.

    What has an amplitude of zero in every frame is in no group. A body with nothing that moves it
    has one empty group.
    """
    things = [(0, index, load.amplitude) for index, load in enumerate(body.loads)]
    things += [
        (1, index, support.amplitude)
        for index, support in enumerate(body.supports)
        if any(support.displacement)
    ]
    # a group has the amplitude of one of its own loads, so that one load alone is solved at 1
    own = any(factors) and any(amplitude == factors for _, _, amplitude in things)
    amplitudes: list[Amplitude] = [factors] if own else []
    members: list[tuple[list[Share], list[Share]]] = [([], []) for _ in amplitudes]
    for which, index, amplitude in things:
        if not any(amplitude):
            continue
        for known, shares in zip(amplitudes, members, strict=True):
            factor = _multiple(amplitude, known)
            if factor is not None and (scaled or factor == 1.0):
                shares[which].append((index, factor))
                break
        else:
            amplitudes.append(amplitude)
            members.append(([], []))
            members[-1][which].append((index, 1.0))
    groups = tuple(
        LoadGroup(amplitude, tuple(loads), tuple(supports))
        for amplitude, (loads, supports) in zip(amplitudes, members, strict=True)
        if loads or supports
    )
    return groups or (LoadGroup(factors, (), ()),)


class LoadHistory:
    """The load groups of every body of a scene, and how much of each a frame shows.

    ``scaled=False`` solves for multiples of a load as for any other. A body whose displacements
    are given has no groups; ``factors`` are its times then.
    """

    def __init__(self, scene: Scene, scaled: bool = True) -> None:
        factors = scene.analysis.load_factors
        self.factors, self.scaled = factors, scaled
        self.frames = len(factors)
        self.props_move = any(prop.poses for prop in scene.props)
        self.given = any(isinstance(body.mesh, FieldMesh) for body in scene.bodies)
        self.groups = tuple(
            () if isinstance(body.mesh, FieldMesh) else load_groups(body, factors, scaled)
            for body in scene.bodies
        )
        self._document = scene.document

    def weights(self, frame: int | None) -> tuple[tuple[float, ...], ...]:
        """Per body the amplitude of each of its groups in a frame; None: unloaded.

        Of a body whose displacements are given: the time.
        """
        if self.given:
            return tuple(() if frame is None else (self.factors[frame],) for _ in self.groups)
        return tuple(
            tuple(0.0 if frame is None else group.amplitude[frame] for group in groups)
            for groups in self.groups
        )

    def shown(self, frame: int) -> tuple[float, ...]:
        """The different amplitudes of a frame, in the order in which groups have them."""
        weights = [weight for body in self.weights(frame) for weight in body]
        return tuple(dict.fromkeys(weights)) or (self.factors[frame],)

    def still(self, frame: int | None) -> bool:
        """Whether nothing has moved in a frame, as far as the scene tells."""
        return frame is None or (not self.props_move and self.unloaded(frame))

    def unloaded(self, frame: int | None) -> bool:
        """Whether no body has moved in a frame, as far as the scene tells."""
        if self.given:
            return frame is None
        return frame is None or not any(
            group.amplitude[frame] and (group.loads or group.supports)
            for groups in self.groups
            for group in groups
        )

    @property
    def solved(self) -> list[Any]:
        """What the solved systems depend on: all of loads and supports but their amplitudes.

        Of those it matters only which ones vary together, and in what proportion.
        """
        bodies = [
            [
                [
                    {key: value for key, value in entry.items() if key != "amplitude"}
                    for entry in rows
                ]
                for rows in (body.get("support", []), body.get("load", []))
            ]
            for body in self._document.get("body", [])
        ]
        members = [[[group.loads, group.supports] for group in body] for body in self.groups]
        return [bodies, members]


def _multiple(amplitude: Amplitude, of: Amplitude) -> float | None:
    """The factor f with amplitude = f of, within rounding; None if there is none."""
    largest = max(range(len(of)), key=lambda k: abs(of[k]))
    factor = amplitude[largest] / of[largest]
    limit = 1e-12 * max(abs(value) for value in amplitude)
    near = all(abs(a - factor * b) <= limit for a, b in zip(amplitude, of, strict=True))
    return factor if near else None
