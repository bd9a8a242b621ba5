"""Load steps of a scene's bodies at large displacements, as they are stored.

Stress and strain of the steps that are looked at are kept as well: they depend on what the material
has been through, and don't follow from displacements alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.export.body_state import KNOWN, known_of
from gpusim.motion import State, Stepped

if TYPE_CHECKING:
    from gpusim.fem import Stress

STEPS = "solution/steps.npz"
Stored = Mapping[str, npt.NDArray[Any]]


def step_arrays(
    motion: Stepped, stresses: Mapping[State, Stress | None], body: int
) -> dict[str, npt.NDArray[Any]]:
    """What ``np.savez`` keeps of the motion of a ``body`` (its number), and of the ``stresses`` in
    some of its states."""
    arrays = {"states": np.array(motion.states), "u": motion.u, "reactions": motion.forces}
    for number, state in enumerate(motion.states):
        if (found := stresses.get(state)) is not None:
            arrays |= {f"{name}_{number}_": values for name, values in known_of(found).items()}
    return {f"{name}{body}": array for name, array in arrays.items()}


def stepped_motion(stored: Stored, body: int) -> Stepped:
    """The motion of a body. Raises ValueError for damage, KeyError where there is none."""
    states, u, forces = (stored[f"{name}{body}"] for name in ("states", "u", "reactions"))
    for values, ndim in ((states, 2), (u, 3), (forces, 3)):
        if values.ndim != ndim or len(values) != len(u) or values.dtype != np.float64:
            raise ValueError(f"load steps of shape {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError("values that aren't finite")
    return Stepped([tuple(state) for state in states.tolist()], u, forces)


def step_fields(stored: Stored, body: int, state: State | None) -> dict[str, Any]:
    """What is kept of a body in a state, by the names of `KNOWN`; nothing of a body at rest."""
    states = [tuple(row) for row in stored[f"states{body}"].tolist()]
    if state is None:
        return {}
    kept = {name: f"{name}_{states.index(state)}_{body}" for name in KNOWN}
    return {name: stored[place] for name, place in kept.items() if place in stored}
