"""Every key of a scene file has a description, every table an example that is right; paths lead."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any, Literal

import pytest

from gpusim.errors import InputError
from gpusim.scene import Scene, json_schema
from gpusim.scene.description import model
from gpusim.scene.description.measure_table import TABLES
from gpusim.scene.key_reference import find_tables, scene_tables
from gpusim.scene.tables.table import UNITS, Table, name_and_unit


def tables_in(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield schema
    yield from schema.get("$defs", {}).values()


def undescribed(schema: dict[str, Any]) -> list[str]:
    """Keys, and tables, of which a schema doesn't say what they are."""
    found = [one["title"] for one in tables_in(schema) if not one.get("description", "").strip()]
    for table in tables_in(schema):
        for key, value in table.get("properties", {}).items():
            if not value.get("description", "").strip():
                found.append(f"{table['title']}.{key}")
    return found


def subclasses(table: type[Table]) -> Iterator[type[Table]]:
    for one in table.__subclasses__():
        yield one
        yield from subclasses(one)


def without_example(schema: dict[str, Any]) -> list[str]:
    """Tables whose example is missing or no such table, with what is wrong."""
    classes = {one.__name__: one for one in subclasses(Table)}
    found = []
    for table in tables_in(schema):
        try:
            (example,) = table["examples"]
            if table["title"] == "SceneTable":
                Scene.from_document(example)
            else:
                classes[table["title"]].model_validate(example)
        except Exception as error:
            found.append(f"{table['title']}: {error!r}")
    return found


class Undescribed(Table):
    """A table that says nothing of its keys.

    Example::

        kind = "bare"
        width_mm = "3"
    """

    kind: Literal["bare"]
    told_mm: float = 0.0
    """In mm."""
    width_mm: float


def test_every_key_is_described() -> None:
    schema = json_schema()
    assert sum(len(one["properties"]) for one in tables_in(schema)) > 600
    assert undescribed(schema) == []


def test_a_key_without_description_is_seen() -> None:
    assert undescribed(Undescribed.model_json_schema()) == ["Undescribed.width_mm"]


def test_keys_of_every_kind_of_measurement_are_described() -> None:
    """Those of other packages too, as far as they are installed."""
    assert {*TABLES} >= {"deflection", "stereo", "damage"}
    for table in TABLES.values():
        assert undescribed(table.model_json_schema()) == []


def test_every_table_has_an_example_that_a_scene_may_have() -> None:
    assert without_example(json_schema()) == []


def test_a_wrong_example_is_seen() -> None:
    (found,) = without_example(Undescribed.model_json_schema())
    assert "width_mm" in found and "number" in found


def test_examples_stand_below_the_header_of_their_place() -> None:
    examples = {
        one["title"]: one["examples"][0] for one in tables_in(json_schema()) if "examples" in one
    }
    for path, table in scene_tables().items():
        if not table.example or not path:
            continue
        here: Any = tomllib.loads(table.example)
        for key in table.header.strip("[]").split("."):
            here = here[0][key] if isinstance(here, list) else here[key]
        if table.header.startswith("[["):
            (here,) = here
        assert here == examples[table.name], path


def test_every_key_of_the_schema_is_in_the_tables() -> None:
    shown = {(table.name, key.name) for table in scene_tables().values() for key in table.keys}
    wanted = {(one["title"], key) for one in tables_in(json_schema()) for key in one["properties"]}
    assert len(wanted) > 600
    assert wanted <= shown


def test_units_and_defaults() -> None:
    (speckle,) = find_tables("body.paint.speckle").values()
    keys = {key.name: key for key in speckle.keys}
    assert (keys["diameter_mm"].unit, keys["diameter_mm"].default) == ("mm", "needed")
    assert keys["coverage"].default == "0.5"
    assert keys["mapping"].default == '"plane"'
    assert keys["where"].default == ""
    assert keys["bump_um"].value == "a number >= 0"
    for path, unit in (("material.density_kg_m3", "kg/m3"), ("light.point.power_W", "W"),
                       ("measure.gauge.mm_per_px", "mm per px"),
                       ("light.point.power_lm", "lm"), ("sensor.prnu_percent", "%"),
                       ("material.expansion_per_K", "1/K"),
                       ("analysis.damping.rayleigh_mass_per_s", "1/s")):  # fmt: skip
        ((key,),) = (table.keys for table in find_tables(path).values())
        assert key.unit == unit


def test_no_key_ends_with_a_unit_that_nobody_knows() -> None:
    """Words behind the last _ that look like a unit: they have a capital, or are known ones."""
    known = {"mm", "um", "nm", "px", "deg", "rpm", "us", "ms", "s"}
    for table in tables_in(json_schema()):
        for key in table["properties"]:
            last = key.rpartition("_")[2]
            if "_" in key and (last in known or last != last.lower()):
                assert name_and_unit(key)[1] in UNITS, key


def test_kinds_share_what_is_told_once() -> None:
    tables = scene_tables()
    for path, table in tables.items():
        for kind in table.kinds:
            assert {key.name for key in table.keys} <= {
                key.name for key in tables[f"{path}.{kind}"].keys
            }
    assert [key.name for key in tables["body.load"].keys] == ["name", "amplitude", "times_s"]


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("camera", ["camera"]),
        ("camera.lens.psf.airy", ["camera.lens.psf.airy"]),
        ("measure.stereo", ["measure.stereo"]),
        ("body.load.force", ["body.load.force"]),
        ("speckle", ["body.paint.speckle"]),
        ("prop.paint.markers", ["prop.plate.paint.markers"]),
        ("load.force_N", ["body.load.force.force_N", "body.load.line_force.force_N"]),
        ("where", ["body.part.where"]),
        ("focal_mm", ["camera.focal_mm", "camera.lens.focal_mm"]),
        ("resolution_px", ["camera.resolution_px"]),
    ],
)
def test_a_path_or_its_end_leads_to_tables_and_keys(text: str, places: list[str]) -> None:
    found = [path for path, table in find_tables(text).items() if table.about or "." in path]
    assert found[: len(places)] == places


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("camra", "camera"),
        ("body.load.froce", "body.load.force"),
        ("focal_m", "focal_mm"),
        ("measure.streo", "measure.stereo"),
    ],
)
def test_a_typo_is_answered_with_the_nearest_name(text: str, near: str) -> None:
    with pytest.raises(InputError, match="no such table or key") as caught:
        find_tables(text)
    assert f"(did you mean {near}?)" in str(caught.value)


def test_a_kind_that_was_added_is_there() -> None:
    from gpusim.scene.measure_kinds import add_kind

    class WhitenessTable(model.MeasureTable):
        """How white it is.

        Example::

            name = "white"
            type = "whiteness"
        """

        type: Literal["whiteness"]
        level_DN: float = 200.0
        """From which on it is white."""

    try:
        add_kind(WhitenessTable)
        (key,) = find_tables("measure.whiteness.level_DN")["measure.whiteness.level_DN"].keys
        assert (key.unit, key.default) == ("DN", "200.0")
    finally:
        del TABLES["whiteness"]
        from gpusim.scene.description.scene_table import SceneTable
        from gpusim.scene.faults.schema_places import cached_schema

        SceneTable.model_rebuild(force=True)
        cached_schema.cache_clear()
