"""What files and reports tell of the steps of a deck that aren't static."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck import Deck
from gpusim.fem import Buckling, HarmonicResponse, History, Modes

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
    return {name: np.asarray(getattr(result, name)) for name in ("times", "u", "v", "a")}


@arrays.register
def _(result: HarmonicResponse) -> Fields:
    return {"frequencies": result.frequencies, "u": result.u}


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
    k = int(np.argmax(result.amplitude.max(axis=(1, 2))))
    return {"u": result.at(k), "u_quarter": result.at(k, np.pi / 2)}


@singledispatch
def summary(result: Any, deck: Deck) -> Fields:
    """What a report says of a result."""
    raise NotImplementedError(type(result).__name__)


@summary.register
def _(result: Modes, deck: Deck) -> Fields:
    return _found(result) | {
        "kind": "modes",
        "frequencies": result.frequencies.tolist(),
        "effective_mass": result.effective_mass.tolist(),
        "total_mass": result.total_mass.tolist(),
    }


@summary.register
def _(result: Buckling, deck: Deck) -> Fields:
    return _found(result) | {"kind": "buckling", "factors": result.factors.tolist()}


@summary.register
def _(result: History, deck: Deck) -> Fields:
    size = np.stack([np.linalg.norm(result.u[k], axis=1) for k in range(len(result.times))])
    return _greatest(deck, size) | {
        "kind": "history",
        "instants": len(result.times),
        "at_time": float(result.times[size.max(axis=1).argmax()]),
        "method": result.method,
        "message": result.message,
        "converged": True,
    }


@summary.register
def _(result: HarmonicResponse, deck: Deck) -> Fields:
    size = np.linalg.norm(result.amplitude, axis=2)
    return _greatest(deck, size) | {
        "kind": "harmonic response",
        "frequencies": result.frequencies.tolist(),
        "at_frequency": float(result.frequencies[size.max(axis=1).argmax()]),
        "message": "",
        "converged": True,
    }


def _found(result: Modes | Buckling) -> Fields:
    """Of an eigenvalue problem."""
    return {
        "error_estimate": float(result.error_estimate.max(initial=0.0)),
        "converged": result.converged,
        "message": result.message,
        "unknowns": result.unknowns,
        "method": result.method,
    }


def _greatest(deck: Deck, size: Float) -> Fields:
    """Of sizes (K,N) of displacements."""
    return {
        "largest_displacement": float(size.max()),
        "largest_displacement_node": int(deck.node_labels[size.max(axis=0).argmax()]),
    }
