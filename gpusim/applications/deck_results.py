"""What files and reports tell of modes, buckling and motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import singledispatch
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck import Deck
from gpusim.fem import Buckling, HarmonicResponse, History, Modes
from gpusim.fem.model.computation import Computation
from gpusim.fem.model.history import Superposition

Fields = dict[str, Any]


@singledispatch
def arrays(result: Any) -> Fields:
    """What is kept of a result, by name; nothing of static solutions, which are kept together."""
    return {}


@arrays.register
def _(result: Modes) -> Fields:
    names = ("frequencies", "shapes", "participation", "effective_mass", "error_estimate")
    return {name: getattr(result, name) for name in names}


@arrays.register
def _(result: Buckling) -> Fields:
    return {name: getattr(result, name) for name in ("factors", "shapes", "error_estimate")}


@arrays.register
def _(result: History) -> Fields:
    if isinstance(result.u, Superposition):
        return {"times": result.times} | _factors(result.u.amplitudes, result.u.shapes)
    return {name: np.asarray(getattr(result, name)) for name in ("times", "u", "v", "a")}


@arrays.register
def _(result: HarmonicResponse) -> Fields:
    return {"frequencies": result.frequencies} | _factors(result.coordinates, result.shapes)


def _factors(amplitudes: Any, shapes: Any) -> Fields:
    """Of displacements that are a product."""
    return {"amplitudes": amplitudes, "shapes": shapes}


@singledispatch
def nodal_fields(result: Any) -> Fields:
    """What a picture of a result shows at nodes: shapes, the last state, or the greatest response
    and a quarter of a period later."""
    return {f"shape_{number:04d}": shape for number, shape in enumerate(result.shapes, 1)}


@nodal_fields.register
def _(result: History) -> Fields:
    return {name: np.asarray(getattr(result, name)[-1]) for name in "uva"}


@nodal_fields.register
def _(result: HarmonicResponse) -> Fields:
    k = int(np.argmax([size.max() for size in _responses(result)]))
    return {"u": result.at(k), "u_quarter": result.at(k, np.pi / 2)}


@singledispatch
def summary(result: Any, deck: Deck) -> Fields:
    """What a report says of a result."""
    raise NotImplementedError(type(result).__name__)


@summary.register
def _(result: Modes, deck: Deck) -> Fields:
    return _of_eigenvalues(result) | {
        "kind": "modes",
        "frequencies": result.frequencies.tolist(),
        "effective_mass": result.effective_mass.tolist(),
        "total_mass": result.total_mass.tolist(),
    }


@summary.register
def _(result: Buckling, deck: Deck) -> Fields:
    return _of_eigenvalues(result) | {"kind": "buckling", "factors": result.factors.tolist()}


@summary.register
def _(result: History, deck: Deck) -> Fields:
    k, largest = _largest(deck, (result.u[k] for k in range(len(result.times))))
    told = {"instants": len(result.times), "at_time": float(result.times[k])}
    return {"kind": "history"} | _how(result) | largest | told


@summary.register
def _(result: HarmonicResponse, deck: Deck) -> Fields:
    k, largest = _largest(deck, _responses(result))
    at = {"frequencies": result.frequencies.tolist(), "at_frequency": float(result.frequencies[k])}
    return {"kind": "harmonic response"} | _how(result) | largest | at


def _how(result: Computation) -> Fields:
    """How it went."""
    names = ("converged", "message", "unknowns", "method")
    return {name: getattr(result, name) for name in names}


def _of_eigenvalues(result: Modes | Buckling) -> Fields:
    return _how(result) | {"error_estimate": float(result.error_estimate.max(initial=0.0))}


def _responses(result: HarmonicResponse) -> Iterator[Float]:
    """(N,3) amplitudes at each frequency."""
    return (np.abs(np.tensordot(one, result.shapes, axes=1)) for one in result.coordinates)


def _largest(deck: Deck, displacements: Iterable[Float]) -> tuple[int, Fields]:
    """Which of displacements (N,3) has the largest one, how large it is, and where."""
    lengths = (np.linalg.norm(u, axis=1) for u in displacements)
    places = [(float(one.max()), int(one.argmax())) for one in lengths]
    k = int(np.argmax([size for size, _ in places]))
    size, node = places[k]
    label = int(deck.node_labels[node])
    return k, {"largest_displacement": size, "largest_displacement_node": label}
