"""Scenes as no one should write them: every one is accepted or refused with a SceneError."""

from __future__ import annotations

import copy
import random
import time
import tomllib
import traceback
import unicodedata
from collections.abc import Iterator
from datetime import date, datetime
from datetime import time as clock
from pathlib import Path
from typing import Any

import pytest

from gpusim.errors import GpusimError, SceneError
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene, load_scene, parse_value
from gpusim.scene.toml_text import toml_text
from tests.hostile.amount import SEED, SHARE, share
from tests.support.example_scenes import example_scenes

pytestmark = pytest.mark.hostile

LONGEST = 30.0  # s of processor time for one scene
VALUES: list[Any] = [
    float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e-308, 5e-324, -0.0, 0, -1, 1, 2, 3,
    1e30, 1e-30, 0.5, 10**18, 2**63, 10**400, -(10**400), True, False, "", "x", "auto", "0", "nan",
    "../../etc/passwd", "/dev/zero", "a\x00b", "\x1b[31m", "\u202e", "a" * 5000, "\U0001f600", "é",
    [], [[]], [0], [0, 0, 0], [1.0, float("nan"), 2.0], [1e308] * 3, ["x", "y"], [[1, 2], [3]],
    {}, {"a": 1}, {"type": "plain"}, {"builder": "box"}, {"file": "x.msh"}, [{}], [{"name": "x"}],
    date(2026, 1, 2), datetime(2026, 1, 2, 3, 4, 5), clock(1, 2, 3), [1] * 20_000,
]  # fmt: skip


def spots(thing: Any, here: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The key path of everything in a document."""
    pairs = thing.items() if isinstance(thing, dict) else enumerate(thing)
    for key, value in pairs:
        yield (*here, key)
        if isinstance(value, dict | list):
            yield from spots(value, (*here, key))


def mutate(document: dict[str, Any], random_: random.Random) -> None:
    """One to four changes, in place."""
    for _ in range(random_.choice((1, 1, 1, 2, 4))):
        every = list(spots(document))
        if not every:
            return
        *keys, last = random_.choice(every)
        here: Any = document
        for key in keys:
            here = here[key]
        kind = random_.randrange(7)
        if kind < 3:
            here[last] = copy.deepcopy(random_.choice(VALUES))
        elif kind == 3:
            del here[last]
        elif kind == 4 and isinstance(here, list):
            here.append(copy.deepcopy(here[last]))
        elif kind == 5 and isinstance(here, dict):
            value = here.pop(last)
            here[random_.choice((last + "x", last[:-1], last.upper(), "é", "a b", ""))] = value
        else:  # something that stands elsewhere
            *elsewhere, other = random_.choice(every)
            there: Any = document
            try:
                for key in elsewhere:
                    there = there[key]
                here[last] = copy.deepcopy(there[other])
            except (KeyError, IndexError, TypeError):
                pass


def as_toml(document: dict[str, Any], random_: random.Random) -> str:
    """As a text, now and then with letters missing or doubled."""
    text = toml_text(document)
    if random_.random() < 0.2:
        for _ in range(random_.randrange(1, 6)):
            at = random_.randrange(len(text) or 1)
            text = text[:at] + random_.choice(('"', "[", "\n", "", "'''", "=", "\x00", ".")) + text[
                at + random_.randrange(3) :
            ]  # fmt: skip
    return text


def check(scene: Path, what: str) -> str:
    """Load and plan; returns what is wrong with how it ended, or ""."""
    started = time.process_time()
    try:
        plan = make_plan(load_scene(scene))
        plan.to_dict()
        message = "\n".join(plan.warnings)
    except GpusimError as error:
        message = str(error)
        if not isinstance(error, SceneError):
            return f"{what}: {type(error).__name__} is no SceneError: {message}"
    except Exception:
        return f"{what}: {traceback.format_exc(limit=-3)}"
    if time.process_time() - started > LONGEST:
        return f"{what}: took {time.process_time() - started:.0f} s"
    bad = {one for one in message if unicodedata.category(one) in ("Cc", "Cf")} - {"\n"}
    if bad or len(message) > 40_000:
        return f"{what}: message of {len(message)} letters with {bad}"
    return ""


def examples(checkout: Path) -> list[Path]:
    """Scenes of all examples but those that Gmsh meshes: how long it takes is tried elsewhere."""
    paths = example_scenes(checkout)
    return [path for path in paths if ".step" not in path.read_text(encoding="utf-8")]


def test_mutated_scenes(checkout: Path, tmp_path: Path) -> None:
    print(f"SEED={SEED}")
    documents = [tomllib.loads(path.read_text(encoding="utf-8")) for path in examples(checkout)]
    for name in ("lug.msh", "strip.frd"):
        (tmp_path / name).write_bytes((checkout / "examples" / name).read_bytes())
    wrong = []
    for number in range(share(1000)):
        random_ = random.Random(f"{SEED}-{number}")
        document = copy.deepcopy(random_.choice(documents))
        mutate(document, random_)
        path = tmp_path / "scene.toml"
        try:
            path.write_text(as_toml(document, random_), encoding="utf-8")
        except (UnicodeEncodeError, TypeError, ValueError):
            continue  # TOML can't say that; test_mutated_documents does
        wrong.append(check(path, f"SEED={SEED}, scene {number}"))
    assert [text for text in wrong if text] == []


def test_mutated_documents(checkout: Path) -> None:
    """The same from Python, where values come that no file can hold."""
    scenes = [load_scene(path) for path in examples(checkout)]
    extra = [None, b"bytes", (1, 2, 3), {1: 2}, object(), 1 + 2j, {"x"}, float, "\udc80", range(3)]
    wrong = []
    for number in range(share(500)):
        random_ = random.Random(f"{SEED}-p{number}")
        scene = random_.choice(scenes)
        *keys, last = random_.choice(list(spots(scene.document)))
        path = ".".join(map(str, (*keys, last)))
        value = random_.choice(VALUES + extra)
        try:
            make_plan(scene.replace(path, value))
        except SceneError as error:
            str(error).encode()
        except Exception:
            trace = traceback.format_exc(limit=-3)
            wrong.append(f"SEED={SEED}, {number}: {path} = {str(value)[:40]!r}: {trace}")
    assert wrong == []


def test_options(checkout: Path) -> None:
    """--set with keys and values that nobody types."""
    path = checkout / "examples" / "cantilever.toml"
    keys = [".", "..", "a", "body", "body.0", "body.-1", "body.9", "body.beam", "body.beam.name",
            "", " ", "body..name", "camera.0.up.0", "camera.0.up.7", "name.x", "schema", "*",
            "body.*.name", "é.é", "a" * 5000, ".".join("a" * 20)]  # fmt: skip
    wrong = []
    for number, key in enumerate(keys):
        for value in ("1", "nan", "[[[", '"', "{a=1}", "x\ny=1", "1979-05-27", "9" * 5000, ""):
            try:
                load_scene(path, {key: parse_value(value)})
            except SceneError as error:
                assert len(str(error)) < 40_000
            except Exception:
                wrong.append(f"{number} {key[:30]!r} = {value[:20]!r}: {traceback.format_exc()}")
    assert wrong == []


@pytest.mark.parametrize("size", [10, 1000, 50_000][: 3 if SHARE == 1.0 else 2])
def test_bombs(size: int, tmp_path: Path) -> None:
    """Texts that grow without bound in every way that TOML has."""
    dotted = ".".join(["a"] * size)
    texts = [
        f"{dotted} = 1", f"[{dotted}]", f"[[{dotted}]]", "a = " + "[" * size + "]" * size,
        "a = " + "{a = " * size + "1" + "}" * size, "[[a]]\n" * size, "[[a.b]]\n" * size,
        "".join(f"[a{k}]\n" for k in range(size)), "".join(f"a{k} = 1\n" for k in range(size)),
        "a = [" + "1," * size + "]", "a = [" + "{}," * size + "]", 'a = "' + "\\n" * size + '"',
        "a = '''" + "\n" * size + "'''", "#" * size, "\n" * size, " " * size, '"' * size,
        "'" * size, "=" * size, "." * size, "a" * size, "[" + " " * size, "a = 0x" + "f" * size,
        "a = 1e" + "9" * size, "a = 0." + "0" * size + "1", "a = " + "9" * size, "\\" * size,
        "".join(f"[[body]]\nname = 'b{k}'\nmaterial = 'm{k}'\n" for k in range(size)),
        "".join(f"[[body]]\n[[body.paint]]\ntype = 'p{k}'\n" for k in range(size)),
        "".join(f"[[variant]]\nname = 'v{k}'\nset = {{ x = {k} }}\n" for k in range(size)),
        '"""' * size, "'''" * size, '"a\\' * size, "[[[" * size, "a=[\n" * size, "\r" * size,
    ]  # fmt: skip
    wrong = []
    for number, text in enumerate(texts):
        path = tmp_path / f"{number}.toml"
        path.write_text(f'schema = 1\nname = "x"\n{text}\n', encoding="utf-8", newline="")
        wrong.append(check(path, f"bomb {number} of {size}: {text[:30]!r}"))
    assert [text for text in wrong if text] == []


def test_from_document_of_anything() -> None:
    for value in VALUES:
        for key in ("body", "camera", "light", "prop", "measure", "analysis", "variant", "output"):
            with pytest.raises(SceneError):
                Scene.from_document({"schema": 1, "name": "x", key: value})
