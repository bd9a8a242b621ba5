"""Input decks of Abaqus and CalculiX: static analyses of solid elements, linear and nonlinear.

In the order in which data passes:

- `amplitudes`: Factors of loads over time.
- `materials`: Materials, orientations and sections.
- `initial_state`: Stress before the first step, and what a temperature does.
- `forces`: Nodal forces, pressures and body forces, kept from step to step.
- `step`: What acts at the end of a step, and on the way there.
- `increments`: The times in a step at which equilibrium is looked for.
- `constraints`: Supports of a step, and linear equations between nodes.
- `steps`: What each step adds, changes or removes.
- `load_path`: The steps of a nonlinear deck as load steps of one analysis.
- `deck`: Mesh, materials, and one static problem for each step.
- `load`: Reading a deck: keywords and parameters, then each card.
"""

from __future__ import annotations

from gpusim.deck.deck import Deck
from gpusim.deck.load import load_deck
from gpusim.deck.step import Step

__all__ = ["Deck", "Step", "load_deck"]


def __dir__() -> list[str]:
    return sorted(__all__)
