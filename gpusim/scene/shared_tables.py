"""Tables of scenes that differ in little, as the samples of a study: what says the same is
validated once, and is one object in all of them, whose digest is made once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .description.scene_table import SceneTable

_ENTERED = {"body": "analysis", "camera": "sensor", "calibration": "camera"}
"""Sections into whose tables a scene enters what another one says."""
Digests = dict[tuple[Any, ...], tuple[list[Any], str, bool]]
"""By section and identities of the tables that a part is cut from: these, so that they live on, the
digest, and whether there is a file in it."""


class SharedTables:
    """Tables that were validated, by what the sections of their resolved documents say.

    ``digests``: of parts of these scenes, by the files that they read.
    """

    def __init__(self) -> None:
        self._tables: dict[tuple[str, ...], Any] = {}
        self.digests: dict[Any, Digests] = {}

    def validated(self, document: Mapping[str, Any]) -> SceneTable:
        """A document's table, of known ones as far as there are any. Raises ValidationError."""
        given, keys = dict(document), _keys(document)
        for section, key in keys.items():
            own = self._tables.get(key, document[section])
            given[section] = [*own] if isinstance(own, tuple) else own  # tables may be in lists
        table = SceneTable.model_validate(given)
        self._tables |= {key: getattr(table, section) for section, key in keys.items()}
        return table


def _keys(document: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """By section what it says, with what is entered from another one; of tables alone."""
    texts = {
        section: json.dumps(value, default=repr)
        for section, value in document.items() if isinstance(value, dict | list)
    }  # fmt: skip
    return {
        section: (section, text, texts.get(_ENTERED.get(section, ""), ""))
        for section, text in texts.items()
    }
