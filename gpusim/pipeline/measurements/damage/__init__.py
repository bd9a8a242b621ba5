"""The kind "damage": deflection lines of the variants compared.

- `comparison`: Difference curves of several states, and where their slope changes.
"""

from gpusim.pipeline.measurements.damage.comparison import DamageResult, compare_states

__all__ = ["DamageResult", "compare_states"]
