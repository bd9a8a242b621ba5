"""Checks before any work, and warnings that a scene's geometry gives.

In the order in which data passes:

- `resources`: What a run needs of the machine, asked before any work: files, folders, memory.
- `visibility`: What cameras see and what hides it, cameras and lamps inside of bodies: before any
  picture.
- `measurability`: Whether speckle can be measured in pictures: how large its discs are there.
- `marker_checks`: Whether a scene's markers can be measured: in sight and in focus of their
  cameras, and not moved along the axis of a single one.
- `linear_theory`: How far linear statics is off where a body turns: an estimate from the linear
  solution.
- `warnings`: Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for
  the report.
"""
