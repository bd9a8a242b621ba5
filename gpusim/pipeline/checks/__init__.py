"""Checks before any work, and warnings that a scene's geometry gives.

In the order in which data passes:

- `resources`: What a run needs of the machine, asked before any work: files, folders, memory.
- `measurability`: Whether speckle can be measured in pictures: how large its discs are there.
- `linear_theory`: How far linear statics is off in the frames of a scene, as an estimate and in
  words.
- `warnings`: Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for
  the report.
"""
