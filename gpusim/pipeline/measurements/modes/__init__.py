"""The kind "modes": frequencies, damping and shapes, from the pictures of a vibration.

In the order in which data passes:

- `true_modes`: The modes of a body that moves in time, and their shapes in a picture.
- `measuring`: Points followed over the film, modes identified from their motion, and paired.
- `result`: Modes, measured and true: tables, what the report says.
"""

from gpusim.pipeline.measurements.modes.measuring import measure_modes

__all__ = ["measure_modes"]
