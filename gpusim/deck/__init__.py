"""Input decks of Abaqus and CalculiX: statics, vibration and buckling of solid elements.

In the order in which data passes:

- `amplitudes`: Factors of loads over time.
- `materials`: Materials, orientations and sections.
- `initial_state`: Stress and motion before the first step, and what a temperature does.
- `forces`: Nodal forces, pressures and body forces, kept from step to step.
- `increments`: The times in a step at which equilibrium is looked for.
- `step`: What acts at the end of a step, on the way there, and what is done with it.
- `constraints`: Supports of a step, and linear equations between nodes.
- `procedures`: Statics, natural frequencies, linear buckling.
- `modal_dynamics`: Superposition of modes, in time and at frequencies.
- `dynamics`: Direct integration in time.
- `steps`: What each step adds, changes or removes.
- `load_path`: The steps of a nonlinear deck as load steps of one analysis.
- `deck`: Mesh, materials, and one problem for each step.
- `load`: Reading a deck: keywords and parameters, then each card.
"""

from gpusim.deck.deck import Deck as Deck
from gpusim.deck.load import load_deck as load_deck
from gpusim.deck.step import Step as Step
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
