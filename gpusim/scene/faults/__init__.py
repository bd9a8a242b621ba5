"""Faults of a scene file: where, what, and what was expected.

In the order in which data passes:

- `limits`: How large and how deeply nested a scene may be; asked before anything else is done
  with it.
- `key_path`: Dotted key paths: ``camera.0.focal_mm``, or by the item's name
  ``camera.front.focal_mm``.
- `line_numbers`: Where a key path was written: the line of a TOML text.
- `schema_places`: Where in the file a pydantic location is, and what the schema says about that
  place.
- `expectations`: What the schema wants at a place, in words: "a number > 0", "a list of 3
  numbers".
- `faults`: From pydantic's errors to faults: key path with index, what, got, expected, nearest
  key.
- `cross_references`: Checks between tables of a scene: unique names, references that exist,
  physics that is complete.
"""
