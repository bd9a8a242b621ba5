"""What CalculiX prints of modes, buckling and motion, and how far ours is from it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.deck import Deck
from gpusim.deck.step import Result

# what is printed: frequencies, load factors, or at a time (or a frequency) of nodes u (…,3)
Answer = tuple[str, Any]


def printed(text: str, harmonic: bool = False) -> list[Answer]:
    """All answers; real and imaginary parts stand one after the other where it is ``harmonic``."""
    found: list[Answer] = []
    tables: list[tuple[float, Any]] = []
    for block in re.split(r"(?= {5}E I G E N V A L U E   O| {5}B U C K L I N G| displace)", text):
        rows = [line.split() for line in re.split("P A R T|\n [a-zA-Z]", block)[0].splitlines()]
        if "E I G E N" in block[:20]:
            whole = [line.split() for line in block.split("P A R T")[0].splitlines()]
            modes = [float(row[3]) for row in whole if len(row) == 5 and row[0].isdigit()]
            found.append(("modes", modes))
        elif "B U C K" in block[:20]:
            whole = [line.split() for line in block.splitlines()]
            factors = [row[1] for row in whole if len(row) == 2 and row[0].isdigit()]
            found.append(("buckling", [float(one) for one in factors]))
        elif block.startswith(" displace"):
            values = np.array([row for row in rows[1:] if len(row) == 4], dtype=np.float64)
            tables.append((float(rows[0][-1]), values))
    kind = "response" if harmonic else "motion"
    if harmonic:
        pairs = zip(tables[::2], tables[1::2], strict=True)
        tables = [(at, real + 1j * other) for (at, real), (_, other) in pairs]
    for at, values in tables:
        labels = np.real(tables[0][1][:, 0]).astype(int)
        found.append((kind, (at, labels, values[:, 1:])))
    return found


def difference(deck: Deck, results: Sequence[Result], kind: str, answer: Any) -> float:
    """Of the results of a deck from one answer, relative to it, or to the greatest displacement at
    that time or frequency."""
    if kind in ("modes", "buckling"):
        wanted = gs.Modes if kind == "modes" else gs.Buckling
        (found,) = (one for one in results if isinstance(one, wanted))
        assert found.converged
        own = found.frequencies if isinstance(found, gs.Modes) else found.factors
        assert len(own) == len(answer)
        return float(np.abs(own / np.array(answer) - 1.0).max())
    at, labels, u = answer
    own = (_moved if kind == "motion" else _response)(deck, results, at)
    own = own[np.searchsorted(deck.node_labels, labels)]
    return float(np.abs(own - u).max() / np.abs(u).max())


def _moved(deck: Deck, results: Sequence[Result], time: float) -> npt.NDArray[Any]:
    """Displacements of all nodes at a time of a step."""
    for one, result in zip(deck.steps, results, strict=True):
        if isinstance(result, gs.Solution) and abs(one.time - time) <= 1e-6 * time:
            return result.u
        if isinstance(result, gs.History) and result.times[0] < time <= one.time * (1 + 1e-6):
            k = int(np.argmin(np.abs(result.times - time)))
            assert abs(result.times[k] - time) <= 1e-6 * time
            return np.asarray(result.u[k])
    raise AssertionError(time)


def _response(deck: Deck, results: Sequence[Result], frequency: float) -> npt.NDArray[Any]:
    """Complex displacements of all nodes."""
    (found,) = (one for one in results if isinstance(one, gs.fem.HarmonicResponse))
    k = int(np.argmin(np.abs(found.frequencies - frequency)))
    assert abs(found.frequencies[k] - frequency) <= 1e-6 * frequency
    return found.u[k]
