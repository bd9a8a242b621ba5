"""Checks before any work, and warnings that a scene's geometry gives.

In the order in which data passes:

- `files`: Files that a scene names, opened before any work: what is wrong in them is told at
  once.
- `folders`: Whether a run's folders can be made where they belong: asked before any work.
- `memory`: Whether the memory of this machine is enough for a plan: asked before anything is
  allocated.
- `lamp_count`: Whether a scene has more lamps than a picture can be lit by: known before any
  work.
- `viewing`: Cameras that see nothing, cameras and lamps inside of bodies: known before any
  picture.
- `marker_visibility`: Which markers a camera can see, how large and how sharp, before any picture
  is taken.
- `pattern_scale`: How many pixels a camera has for each disc of a speckle pattern.
- `axial_loads`: Loads along the axis of a camera that measures a deflection: its image shows no
  such motion.
- `linear_theory`: How far linear statics is off where a body turns: an estimate from the linear
  solution.
- `warnings`: Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for
  the report.
"""
