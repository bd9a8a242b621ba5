"""``[analysis]``: what is computed, and the loads and supports that it is computed for.

In the order in which data passes:

- `loads`: What holds and moves a body, and ``where``.
- `analysis_table`: What every ``[analysis]`` says, and the kinds that there are.
- `statics`: Equilibria, and displacements that are given.
- `excitation`: What drives and damps a vibration beside loads: a ground that moves, damping.
- `vibrations`: Shapes in which bodies vibrate or buckle, and steady vibrations.
- `transient`: Motion in time.
"""
