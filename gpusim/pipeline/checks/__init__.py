"""Checks before any work, and warnings that a scene's geometry gives.

In the order in which data passes:

- `resources`: What a run needs of the machine, asked before any work: files, folders, memory.
- `visibility`: What cameras see and what hides it, cameras and lamps inside of bodies: before any
  picture.
- `measurability`: Whether pictures can be measured: markers in sight and focus, sizes of discs,
  axial loads.
- `linear_theory`: How far linear statics is off where a body turns: an estimate from the linear
  solution.
- `warnings`: Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for
  the report.
"""
