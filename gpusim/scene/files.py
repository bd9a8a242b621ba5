"""Mesh files that a scene names: found beside the scene file, and known by their content."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from gpusim.errors import Fault

from .faults import shown
from .lines import Keys
from .path import dotted

__all__ = ["find_files"]

Found = list[tuple[Keys, Fault]]


def find_files(document: dict[str, Any], folder: Path) -> tuple[Found, tuple[tuple[str, str], ...]]:
    """Make the mesh files in ``document`` absolute, in place; relative ones lie in ``folder``.

    Returns faults for files that can't be read, and (path, SHA-256) of the others. A mesh with
    ``file`` and no ``builder`` gets the builder "file". What isn't of the right shape is left to
    the schema.
    """
    found: Found = []
    hashes: dict[str, str] = {}
    bodies = document.get("body")
    for index, body in enumerate(bodies if isinstance(bodies, list) else ()):
        mesh = body.get("mesh") if isinstance(body, dict) else None
        if not isinstance(mesh, dict) or not isinstance(mesh.get("file"), str):
            continue
        mesh.setdefault("builder", "file")
        if mesh["builder"] != "file" or not mesh["file"]:
            continue
        path = folder.absolute() / mesh["file"]
        keys: Keys = ("body", index, "mesh", "file")
        problem = "is a folder" if path.is_dir() else "" if path.is_file() else "not found"
        if not problem:
            try:
                with path.open("rb") as stream:
                    hashes[str(path)] = hashlib.file_digest(stream, "sha256").hexdigest()
            except OSError as error:
                problem = f"unreadable ({error.strerror})"
        if problem:
            fault = Fault(dotted(keys), problem, shown(str(path)), "a mesh or CAD file")
            found.append((keys, fault))
        mesh["file"] = str(path)
    return found, tuple(sorted(hashes.items()))
