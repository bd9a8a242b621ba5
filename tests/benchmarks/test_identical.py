"""The command that proves versions equal sees a changed bit, a lost case and a changed shader."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from benchmarks import identical, identical_cases
from benchmarks.identical_cases.images import tilted

SHADER = """// squares
const side: u32 = 8u;
fn twice(x: f32) -> f32 { return 2.0 * x; } /* of
two lines */
@compute @workgroup_size(64)
fn main() { let a = twice(1.0); if (a > 0.0) { return; } }
"""


def image(seed: int = 1) -> dict[str, np.ndarray]:
    """Two small arrays."""
    values = np.random.default_rng(seed).normal(size=(33, 57)).astype(np.float32)
    return {"radiance": values, "a/b": np.arange(5)}


@pytest.fixture
def cases(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    table: dict[str, Any] = {
        "own/image": image,
        "fem/tet4-direct": identical_cases.CASES["fem/tet4-direct"],
    }
    monkeypatch.setattr(identical_cases, "CASES", table)
    return table


def test_one_bit_is_seen(
    cases: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, keep = str(tmp_path / "before.json"), str(tmp_path / "arrays")
    assert identical.main(["--write", file, "--keep", keep]) == 0
    assert identical.main(["--against", file]) == 0
    assert capsys.readouterr().out.endswith("the same\n")
    changed = image()
    changed["radiance"].view(np.uint32)[4, 7] ^= 1
    cases["own/image"] = lambda: changed
    assert identical.main(["--against", file]) == 1
    assert capsys.readouterr().out.endswith("\nown/image radiance: differs\n")
    assert identical.main(["--against", file, "--keep", keep]) == 1
    assert "differs; 1 of 1881 values, max " in capsys.readouterr().out
    assert identical.main(["--against", file, "--only", "fem/*"]) == 0


def test_a_changed_hash_is_seen(cases: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "before.json"
    assert identical.main(["--write", str(file)]) == 0
    stored = json.loads(file.read_text())
    hashes = stored["cases"]["fem/tet4-direct"]
    hashes["u"] = hashes["u"][::-1]
    file.write_text(json.dumps(stored))
    assert identical.main(["--against", str(file), "--only", "own/*"]) == 0
    assert identical.main(["--against", str(file)]) == 1


def test_what_is_new_or_gone_or_fails_is_seen(
    cases: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "before.json"
    assert identical.main(["--write", str(file), "--only", "nothing"]) == 1
    del cases["fem/tet4-direct"]
    cases["own/other"] = image
    assert identical.main(["--write", str(file)]) == 0
    del cases["own/other"]
    cases["own/image"] = lambda: {"radiance": image()["radiance"], "c": np.zeros(2)}
    cases["own/next"] = image
    cases["own/broken"] = lambda: {"x": np.zeros(2) @ np.zeros(3)}
    assert identical.main(["--against", str(file)]) == 1
    lines = capsys.readouterr().out
    for line in ("own/other: gone", "own/next: new", "own/image a/b: gone", "own/image c: new",
                 "own/broken: raised ValueError"):  # fmt: skip
        assert line in lines
    file.unlink()
    assert identical.main(["--write", str(file)]) == 1
    assert not file.exists()


def test_distances_in_words() -> None:
    one, nothing = np.array(1.0), np.array([np.nan, 2.0])
    assert identical.distance(one, np.array(1.5)).startswith("1 of 1 values, max 0.5, RMS 0.5")
    assert identical.distance(nothing, nothing).startswith("0 of 2 values, max 0")
    assert identical.distance(one, nothing) == "was () float64, is (2,) float64"
    assert identical.distance(np.array(["a"]), np.array(["b"])) == "another text"


def test_text_of_shaders() -> None:
    same = identical.canonical(SHADER)
    lines = SHADER.splitlines()
    moved = ["#import lib/other", *lines[4:], *lines[:4], "// end"]
    assert identical.canonical("\n".join(moved)) == same
    assert same.count("\n") == 3 and "squares" not in same and "lines" not in same
    for old, new in (("8u", "9u"), ("2.0 * x", "2.0 + x"), ("twice(1.0)", "twice(1.5)")):
        assert identical.canonical(SHADER.replace(old, new)) != same


def test_every_compiled_module_is_noted() -> None:
    with identical.compiled_modules() as found:
        surface, camera = tilted(gs.paint.Plain())
        frame = gs.render([surface], camera, device=gs.Device())
    assert frame.radiance.max() > 0.0 and found
    assert all(label.startswith("gpusim.") for label in found.values())
    assert identical.changed_programs(found, {}, True) != []
    assert identical.changed_programs({}, found, False) == []
    assert identical.changed_programs({}, found, True) != []
    assert identical.changed_programs(found, found, True) == []
