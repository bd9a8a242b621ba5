"""The uncertainty budget of a rig: sources drawn one at a time and together, as the GUM has it.

In the order in which data passes:

- `sources`: The sources that a scene has anyway, with what is common in a laboratory.
- `draws`: What the keys of the sources are in each draw.
- `budget_study`: A budget as a study: its samples, and what they say.
- `uncertainty`: Standard and expanded uncertainty, sensitivities and shares from draws.
- `identifiability`: What a picture can't tell.
- `page`: The page of a budget.
"""

from gpusim.public_names import public_names as _public_names
from gpusim.studies.budget.page import write_budget as write_budget
from gpusim.studies.budget.uncertainty import SourceDraws as SourceDraws
from gpusim.studies.budget.uncertainty import UncertaintyBudget as UncertaintyBudget
from gpusim.studies.budget.uncertainty import rounded as rounded

__all__, __getattr__, __dir__ = _public_names(__name__)
