"""Scene files: a strict TOML schema with units in its keys -> frozen dataclasses in SI.

In the order in which data passes:

- `schema`: The scene file's tables (pydantic, strict); they stop at the loader.
- `description`: What a scene holds once it is read: frozen, in SI.
- `conversion`: From tables to what a scene holds: units to SI, names to things.
- `faults`: Faults of a scene file: where, what, and what was expected.
- `cost`: Cost of a run, from the scene's numbers alone.
- `files`: Files that a scene names, meshes and results: found beside it, and known by their
  content.
- `toml_text`: A plain document as a TOML text that `tomllib` reads back to the same.
- `scene`: ``Scene``: everything a run needs, validated, in SI, and able to say what it was read
  from.
- `load`: Reading a scene file.
- `plausibility`: Numbers that no structure, material or camera has: most often a value in another
  unit.
- `amplitudes`: Which loads vary together over the frames: they are solved as one, and scaled.
- `sources`: Effects that make a measured number differ from the true one, switched off one by
  one.
"""

from __future__ import annotations

from .load import load_scene, parse_value
from .scene import Scene
from .schema import json_schema

__all__ = ["Scene", "json_schema", "load_scene", "parse_value"]


def __dir__() -> list[str]:
    return sorted(__all__)
