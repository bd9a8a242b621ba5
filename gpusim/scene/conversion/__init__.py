"""From tables to what a scene holds: units to SI, names to things.

In the order in which data passes:

- `light`: ``[[light]]`` tables to the model, in SI.
- `mesh`: From the tables of a mesh and its notches to a recipe in metres.
- `photo`: Lens, shutter and sensor tables to the model: units to SI, electrons and shares.
- `targets`: From the tables of targets to the parameters of the paints that draw them, in SI.
- `tables`: From tables to frozen dataclasses: units to SI, names to things, lines to points.
"""
