"""Faults of a scene file: where, what, and what was expected.

In the order in which data passes:

- `key_paths`: Dotted key paths, and the lines of a TOML text that they were written in.
- `schema_places`: What the schema says: of a place in the file, and of the file as a whole.
- `faults`: From pydantic's errors to faults: key path with index, what, got, expected, nearest
  key.
- `cross_references`: Checks between tables of a scene: unique names, references that exist,
  physics that is complete.
- `vibrations`: Checks of scenes whose bodies vibrate or buckle: mass, loads that mean something
  there, and what is only known in time.
"""
