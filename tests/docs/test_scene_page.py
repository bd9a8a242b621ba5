"""docs/scene.md is what the schema gives; docs/variants.md has the effects that there are."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from gpusim.scene import json_schema
from gpusim.scene.effects import EFFECTS
from gpusim.scene.key_reference import scene_tables
from scripts.scene_reference import page, sections


def stale(path: Path, text: str) -> str:
    """What is to be done about a page that isn't what its script makes; "": nothing."""
    if path.read_text(encoding="utf-8") == text:
        return ""
    return f"{path.name} isn't what the tables say: run `python scripts/scene_reference.py`"


def test_the_page_is_made_from_the_schema(checkout: Path) -> None:
    assert stale(checkout / "docs" / "scene.md", page()) == ""


def test_a_changed_table_makes_the_page_stale(checkout: Path) -> None:
    tables = scene_tables()
    key, *rest = tables["solver"].keys
    changed = replace(tables["solver"], keys=(replace(key, about="Another text."), *rest))
    text = "".join(sections({**tables, "solver": changed}))
    assert "Another text." in text
    assert "python scripts/scene_reference.py" in stale(checkout / "docs" / "scene.md", text)


def test_every_key_and_every_table_is_on_the_page() -> None:
    text = page()
    for table in (json_schema(), *json_schema()["$defs"].values()):
        assert table["description"].replace("``", "`").split("\n")[0] in text
        for key in table["properties"]:
            assert f"\n| `{key}` | " in text
        assert table["x-toml"].split("\n")[0] in text


def test_every_table_is_told_once() -> None:
    heads = re.findall(r"^##+ (.*)$", page(), re.MULTILINE)
    assert len(heads) == len(set(heads)) > 70


def test_effects_are_those_of_the_program(checkout: Path) -> None:
    text = (checkout / "docs" / "variants.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE))
    assert rows == {name: effect.about for name, effect in EFFECTS.items()}
