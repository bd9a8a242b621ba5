"""Which loads vary together over the frames: they are solved as one, and scaled.

The answer is linear in the loads. So frame k shows the sum over a body's groups of the group's
displacement times its amplitude in frame k, and only as many systems are solved as there are
groups; most scenes have one, with the analysis' load factors as its amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.scene.description.model import Amplitude, Body

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


def _multiple(amplitude: Amplitude, of: Amplitude) -> float | None:
    """The factor f with amplitude = f of, within rounding; None if there is none."""
    largest = max(range(len(of)), key=lambda k: abs(of[k]))
    factor = amplitude[largest] / of[largest]
    limit = 1e-12 * max(abs(value) for value in amplitude)
    near = all(abs(a - factor * b) <= limit for a, b in zip(amplitude, of, strict=True))
    return factor if near else None
