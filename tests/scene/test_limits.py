"""A scene file that is too large, too deep or wrong in too many places ends in one short error."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from gpusim.errors import SceneError
from gpusim.scene import Scene, load_scene, parse_value
from gpusim.scene.faults.key_paths import key_lines

HEAD = 'schema = 1\nname = "x"\n'
DEEP = ".".join(["a"] * 50_000)


def refused(text: str, path: Path) -> str:
    path.write_text(text, encoding="utf-8")
    started = time.process_time()
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert time.process_time() - started < 5.0
    assert len(str(caught.value)) < 20_000
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = " + "9" * 4301, "number of too many digits"),
        ("schema = 1\n[solver]\nmax_iterations = " + "9" * 4200, "a number of about 4,200 digits"),
        (HEAD + ".".join(["a"] * 2000) + " = 1", "nested too deeply (line 3)"),
        (HEAD + DEEP + " = 1", "nested too deeply (line 3)"),
        (HEAD + f"[{DEEP}]", "nested too deeply (line 3)"),
        (HEAD + f'["b".{DEEP}]', "nested too deeply (line 3)"),
        (HEAD + "a = " + "[" * 100_000, "nested too deeply (line 3)"),
        (HEAD + "a = " + "{a=" * 5000, "nested too deeply (line 3)"),
        (HEAD + "[[body]]\n" * 12_000, "body: too many tables; got 12,000"),
        (HEAD + "[[body]]\n" * 3000, "and 5950 more"),
        (HEAD + "".join(f"a{k}=1\n" for k in range(9000)), "and 8951 more"),
        (HEAD + "a = [" + "1," * 600_000 + "]", "too large for a scene; got about 600,"),
        ("#" * 5_000_000, "too large for a scene; got 5.0 MB"),
        (HEAD + "[" + " " * 300_000, "not TOML"),
        (HEAD + 'a = "' + '\\"' * 200_000, "not TOML"),
        (HEAD + "'''" * 9_999, "not TOML"),
    ],
)
def test_bombs(text: str, said: str, tmp_path: Path) -> None:
    assert said in refused(text, tmp_path / "bomb.toml")


def test_many_references_that_fit_nothing(tmp_path: Path) -> None:
    bodies = "".join(f'[[body]]\nname = "b{k}"\nmaterial = "m{k}"\n' for k in range(2000))
    materials = "".join(f'[[material]]\nname = "n{k}"\n' for k in range(2000))
    text = refused(HEAD + bodies + materials, tmp_path / "many.toml")
    assert "8000 faults" in text


def test_what_looks_deep_and_is_not(tmp_path: Path) -> None:
    text = HEAD + 'description = """' + "[[[[[[[[" * 10 + 'a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q"""\n'
    text += "# " + "[" * 50 + "\n'a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r' = 1\n"
    text += '"[[[[[[[[[[[[[[[[[[\\"[[[[" = [1.5, 2.5]\n'
    assert "2 faults" not in refused(text, tmp_path / "flat.toml")
    assert "nested" not in refused(text, tmp_path / "flat.toml")


def test_from_python() -> None:
    cyclic: dict[str, Any] = {"schema": 1, "name": "x"}
    cyclic["body"] = [cyclic]
    with pytest.raises(SceneError, match="nested too deeply"):
        Scene.from_document(cyclic)
    deep: Any = 1
    for _ in range(5000):
        deep = [deep]
    for overrides in ({"camera": deep}, {DEEP: 1}, {"a": {"b": deep}}):
        with pytest.raises(SceneError, match=r"too deeply|too many keys"):
            Scene.from_document({"schema": 1, "name": "x"}, overrides=overrides)
    with pytest.raises(SceneError, match="a number of about 9,999 digits"):
        Scene.from_document({"schema": 1, "name": 10**9999})


def test_values_of_an_option() -> None:
    assert parse_value("[1, 2.5]") == [1, 2.5]
    for text in ("[" * 5000, "9" * 5000, "1\nb = 2", "{" + "a={" * 5000):
        assert parse_value(text) == text


def test_lines_of_many_items() -> None:
    text = "[[a]]\n[[a.b]]\n[[a.b]]\n[[a]]\n[[a.b]]\nc = 1\n"
    lines = key_lines(text)
    assert lines["a", 0, "b", 1] == "line 3"
    assert lines["a", 1, "b", 0, "c"] == "line 6"
    started = time.process_time()
    assert len(key_lines("".join(f"[[a{k}]]\n" for k in range(20_000)))) == 40_000
    assert time.process_time() - started < 2.0
    assert key_lines('a = "\u2028"\nb = 1')["b",] == "line 2"
