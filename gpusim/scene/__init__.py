"""Scene files: a strict TOML schema with units in its keys, frozen, and what it says in SI.

In the order in which data passes:

- `tables`: What the tables of a scene file are made of.
- `description`: The scene file's tables, each once: keys as in the file, and what they are in SI.
- `toml_text`: A plain document as a TOML text, and back; and how large it may be.
- `faults`: Faults of a scene file: where, what, and what was expected.
- `key_reference`: The keys of a scene file table by table, in words: for docs/scene.md and
  ``gpusim schema TABLE``.
- `files`: Files that a scene names, meshes and results: found beside it, and known by their
  content.
- `measure_kinds`: Kinds of measurement that are added to gpusim's own.
- `camera_tables`: The ``[[camera]]`` tables of a scene, and the cameras that they describe.
- `shared_tables`: Tables of scenes that differ in little: what says the same is validated and
  hashed once.
- `scene`: ``Scene``: everything a run needs, validated, in SI, and able to say what it was read
  from; and how its file is read.
- `colored`: Whether a scene's pictures are in colour, before anything of it is built.
- `cost`: Cost of a run, before anything is built.
- `plausibility`: Numbers that no structure, material or camera has: most often a value in another
  unit.
- `amplitudes`: Which loads vary together over the frames: they are solved as one, and scaled.
- `analyses`: Kinds of analysis: what moves a scene's bodies, and which stages find that out.
- `frames`: Frames as a table: when each is, and what stands where in it.
- `part`: Parts of a scene: a scene that has nothing but what a stage's key names.
- `effects`: Effects that make a measured number differ from the true one, switched off one by
  one.
"""

from __future__ import annotations

from .faults.schema_places import json_schema
from .scene import Scene, load_scene
from .toml_text import parse_value

__all__ = ["Scene", "json_schema", "load_scene", "parse_value"]


def __dir__() -> list[str]:
    return sorted(__all__)
