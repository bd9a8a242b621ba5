"""The example scenes."""

from __future__ import annotations

from pathlib import Path

__all__ = ["example_scenes"]


def example_scenes(checkout: Path) -> list[Path]:
    """All examples but studies, which name a scene."""
    paths = sorted((checkout / "examples").glob("*.toml"))
    return [path for path in paths if not path.name.startswith("study_")]
