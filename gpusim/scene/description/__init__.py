"""The scene file's tables, each once: keys as in the file, and what they are in SI.

In the order in which data passes:

- `material`: ``[[material]]``: elasticity, density and thermal expansion.
- `analysis`: What is computed, for which frames; what holds and moves a body, and ``where``.
- `mesh`: How a body's mesh is made, or read.
- `ground`: What every paint says: where it is, how its ground shines, how a pattern lies on faces.
- `targets`: Targets of photogrammetry and of lens tests.
- `paint`: What a surface looks like.
- `prop`: Rigid things, and where they are in each frame.
- `lights`: Lamps, the sun and the surroundings.
- `lens`: What a real camera does to a pinhole's image.
- `sensor`: From radiance to grey values.
- `camera`: From where a scene is seen.
- `processing`: How far it is solved and rendered, what is written, and states that are compared.
- `measure_table`: What every ``[[measure]]`` says, and the kinds that there are.
- `correlation_measures`: The tables of ``[[measure]]`` that correlate pictures: what all of them
  say, and those that follow a few places over frames.
- `measures`: The tables of gpusim's own kinds of ``[[measure]]``.
- `scene_table`: ``[[body]]``, and the scene as a whole.
- `model`: Every table's class by its name.
"""
