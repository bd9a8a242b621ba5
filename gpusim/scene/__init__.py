"""Scene files: a strict TOML schema with units in its keys -> frozen dataclasses in SI."""

from __future__ import annotations

from .load import load_scene, parse_value
from .scene import Scene
from .schema import json_schema

__all__ = ["Scene", "json_schema", "load_scene", "parse_value"]
