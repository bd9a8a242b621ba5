"""Tests lie as what they test: folder by folder, named by a module, or by a concept listed here."""

from __future__ import annotations

from pathlib import Path

import pytest

import gpusim

PACKAGE = Path(gpusim.__file__).parent

# folders of `tests` that test no single package
APART = {"api", "benchmarks", "docs", "hostile", "repository", "support", "verification"}

CONCEPTS = {
    "cli": "calibrate commands dic dic_cameras solve",
    "deck": "calculix duplicate_definitions elements moose refusals",
    "fem": "calculix silent_failures stability_failures stability_large stability_solver "
    "stability_vibration",
    "fem/sparse": "scipy_kernels",
    "field": "run",
    "files": "picture_kinds",
    "graph": "processes scene_stages",
    "measure": "luminance",
    "measure/calibration": "photographs turned_boards",
    "measure/correlation": "accuracy ambiguous_patterns",
    "measure/targets": "charuco",
    "notebook": "example html plots",
    "optics": "accuracy imaging_chain",
    "optics/ambient": "pipes",
    "optics/calibration": "units",
    "optics/camera": "distortion_dic",
    "optics/edge_pixels": "contact fine_silhouettes",
    "optics/geometry": "edge_on open_sheets winding",
    "optics/paint": "checker_fields gloss_prints grazing",
    "optics/shading": "small_faces",
    "optics/shadow": "border contact edge_on render scenes shares sheets stages sunk_lamps",
    "parallel": "child_process copies",
    "pipeline": "analyses cad_plans elements nonlinear_examples",
    "pipeline/measurements": "developed_pictures frames",
    "pipeline/measurements/dic": "large_motion",
    "pipeline/pictures": "target_window",
    "pipeline/runner": "output_reuse reuse",
    "pipeline/scene_objects": "refusals",
    "report": "comparison",
    "scene": "gltf_looks limits",
    "scene/description": "speckle",
    "scene/faults": "messages",
    "studies": "sensitivity",
    "view": "reload window_view",
}
"""By folder: what a test is named by that isn't a module."""


def faults(tests: Path, package: Path, concepts: dict[str, str]) -> list[str]:
    """Test files whose folder isn't one of ``package``, or whose name isn't of something in it;
    and concepts without a test."""
    wrong = [
        f"{folder}: no test of concept {name}"
        for folder, names in concepts.items()
        for name in names.split()
        if not (tests / folder / f"test_{name}.py").is_file()
    ]
    for path in sorted(tests.rglob("test_*.py")):
        relative = path.relative_to(tests)
        if relative.parts[0] in APART:
            continue
        folder, name = package / relative.parent, path.stem.removeprefix("test_")
        if not (folder / "__init__.py").is_file():
            wrong.append(f"{relative}: no folder {relative.parent} in the package")
        elif not (
            name in (folder.name, *concepts.get(relative.parent.as_posix(), "").split())
            or (folder / f"{name}.py").is_file()
        ):
            wrong.append(f"{relative}: no module, no concept {name}")
    return wrong


def test_tests_lie_as_what_they_test(checkout: Path) -> None:
    assert faults(checkout / "tests", PACKAGE, CONCEPTS) == []


@pytest.mark.parametrize(
    ("place", "fault"),
    [
        ("fem/test_loads.py", "no module, no concept loads"),
        ("fem/models/test_loads.py", "no folder fem/models in the package"),
        ("test_loads.py", "no module, no concept loads"),
        ("fem/model/test_loads.py", None),
        ("fem/model/test_model.py", None),
        ("fem/test_peers.py", None),
        ("api/test_loads.py", None),
    ],
)
def test_a_test_in_the_wrong_place_is_seen(place: str, fault: str | None, tmp_path: Path) -> None:
    package, tests = tmp_path / "package", tmp_path / "tests"
    for name in ("__init__.py", "fem/__init__.py", "fem/model/__init__.py", "fem/model/loads.py"):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).touch()
    for name in {place, "fem/test_peers.py"}:
        (tests / name).parent.mkdir(parents=True, exist_ok=True)
        (tests / name).touch()
    expected = [f"{place}: {fault}"] if fault else []
    assert faults(tests, package, {"fem": "peers"}) == expected
    gone = "fem: no test of concept parts"
    assert faults(tests, package, {"fem": "peers parts"}) == [gone, *expected]
