"""Modules and classes are named by nouns of the field: the words that docs/renderer.md bans."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import gpusim

PACKAGE = Path(gpusim.__file__).parent

BANNED = frozenset(
    """album alone apart around aside balls beforehand begun bottom chain copies dealt doubt doubts
    drawn early facets filed followed following found glance held kept known late likely looks made
    near once openness piles resident seen settled sight some steady sunk sure taken tear things
    told unsure usable waiting wishes work""".split()
)

# Names of today that still have such a word. Rename, then take them out; nothing is added.
EXCEPTIONS = {
    "cli/calibrating:Wishes",
    "fem/device/v_cycle:_Bottom",
    "fem/direct_solvers/substructuring:Chain",
    "fem/krylov/cg:_AtOnce",
    "fem/multigrid/coarse_solver:Bottom",
    "gpu/buffer_pool:Kept",
    "measure/calibration/calibration:_Alone",
    "measure/correlation/pixel_mask:Usable",
    "measure/fitting/edge_profile:NearBorder",
    "measure/fitting/noise_correlation:_Taken",
    "measure/structures/marker_matching:_Piles",
    "optics/ambient/bounding_hierarchy:Balls",
    "optics/ambient/edge_adjacency:Facets",
    "optics/ambient/hemisphere_mask:Around",
    "optics/ambient/hemisphere_mask:Seen",
    "optics/ambient/silhouette_buffers:Near",
    "optics/ambient/sky_occluders:_Known",
    "optics/ambient/sky_visibility:Openness",
    "optics/paint/feature_grid:_Filed",
    "optics/raster/coefficients:Found",
    "optics/raster/compute_raster:Sight",
    "optics/raster/vertex_buffers:Drawn",
    "optics/rendering/background:Aside",
    "optics/series/late",
    "optics/series/late:LateDrawn",
    "optics/series/late:LateSight",
    "optics/series/late_vertices",
    "optics/series/late_vertices:LateVertices",
    "optics/series/normals:Around",
    "optics/series/resident",
    "optics/series/resident:Resident",
    "optics/series/steady",
    "optics/series/steady:Steady",
    "optics/shading/deferred_pass:SeenPass",
    "optics/shading/glance",
    "optics/shading/glance:GlancePass",
    "optics/shading/glance_kind",
    "optics/shading/glance_kind:GlanceKind",
    "optics/shading/looks",
    "optics/shading/looks:Looks",
    "optics/shadow/scene:_KeptOccluders",
    "pipeline/build/modelling:_Held",
    "pipeline/build/scene_objects:Things",
    "pipeline/checks/warnings:Doubts",
    "pipeline/measurements/marker_cache:KeptMarkers",
    "pipeline/measurements/marker_detection:Found",
    "pipeline/measurements/marker_tracking:Followed",
    "pipeline/measurements/stereo_result:CameraFound",
    "pipeline/notes:Made",
    "pipeline/runner/stage_runner:Work",
    "pipeline/stages/capture_queue:Album",
    "plan/machine_speed:Work",
    "scene/schema/work",
}


def words(name: str) -> list[str]:
    """``LateSight`` and ``late_sight`` are late and sight."""
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z0-9]+|[A-Z]+", name)
    return [part.lower() for part in parts]


def named(path: Path) -> Iterator[tuple[str, str]]:
    """A module's own name and those of its classes, each with where it stands."""
    where = path.relative_to(PACKAGE).with_suffix("").as_posix().removesuffix("/__init__")
    yield where, where.rpartition("/")[2]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            yield f"{where}:{node.name}", node.name


def with_banned_words(paths: Iterable[Path]) -> set[str]:
    return {
        where for path in paths for where, name in named(path) if BANNED.intersection(words(name))
    }


def test_no_module_or_class_is_named_by_a_banned_word() -> None:
    assert sorted(with_banned_words(PACKAGE.rglob("*.py")) - EXCEPTIONS) == []


def test_no_exception_is_out_of_date() -> None:
    assert sorted(EXCEPTIONS - with_banned_words(PACKAGE.rglob("*.py"))) == []


def test_a_banned_name_is_seen() -> None:
    assert [word for word in ("LateSight", "kept", "DICResult") if BANNED & {*words(word)}] == [
        "LateSight",
        "kept",
    ]


def test_the_glossary_names_the_same_words(checkout: Path) -> None:
    text = (checkout / "docs" / "renderer.md").read_text(encoding="utf-8")
    (listed,) = re.findall(
        r"^Words that modules and classes may not.*?\n\n\*(.*?)\*\.", text, re.M | re.S
    )
    assert set(re.findall(r"\w+", listed)) == BANNED
