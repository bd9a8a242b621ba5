"""Which loads vary together over the frames: they are solved as one, and scaled.

The answer is linear in the loads. So frame k shows the sum over a body's groups of the group's
displacement times its amplitude in frame k, and only as many systems are solved as there are
groups; most scenes have one, with the analysis' load factors as its amplitude.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from gpusim.scene.description.model import Amplitude, Body, TransientTable

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
    return _grouped(things, factors, scaled)


@dataclass(frozen=True)
class LoadHistory:
    """The loads of a body in time: the amplitudes of ``groups``, of which the last ones are of what
    is let go at time 0, linear between ``times`` (s); ``start``: those of the equilibrium that it
    starts from, () where it starts unloaded."""

    times: Amplitude
    groups: tuple[LoadGroup, ...]
    start: Amplitude = ()


def load_history(body: Body, analysis: TransientTable, end: float) -> LoadHistory:
    """The loads of a body from time 0 to an ``end`` (s)."""
    curves = [
        (load.times_s or analysis.frame_values, load.amplitude_) if load.amplitude_ else ((), ())
        for load in body.loads
    ]
    inside = {time for times, _ in curves for time in times if 0.0 < time < end}
    times = (0.0, *sorted(inside), end)
    amplitudes = [tuple(_between(*curve, time) for time in times) for curve in curves]
    free = [load.name in (analysis.release or ()) for load in body.loads]
    things = [(0, k, one) for k, one in enumerate(amplitudes) if not free[k]]
    groups = _grouped(things, (1.0,) * len(times), scaled=True)
    if analysis.release is None:
        return LoadHistory(times, groups)
    shares = tuple((k, one[0]) for k, one in enumerate(amplitudes) if free[k])
    released = (LoadGroup((0.0,) * len(times), shares, ()),) if shares else ()
    start = (*(group.amplitude[0] for group in groups), *(1.0 for _ in released))
    return LoadHistory(times, groups + released, start)


def _between(times: Sequence[float], factors: Sequence[float], time: float) -> float:
    """A load's factor at a time; 1 where it has none."""
    if not factors:
        return 1.0
    place = bisect_right(times, time)
    if place in (0, len(times)):
        return factors[min(place, len(times) - 1)]
    (a, b), (low, high) = times[place - 1 : place + 1], factors[place - 1 : place + 1]
    return low + (high - low) * (time - a) / (b - a)


def _grouped(
    things: Sequence[tuple[int, int, Amplitude]], factors: Amplitude, scaled: bool
) -> tuple[LoadGroup, ...]:
    """Of loads (0) and supports (1): which, number, and amplitude; as `load_groups`."""
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
