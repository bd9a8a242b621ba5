"""``gpusim schema TABLE``, and what helps to find a key or an option: help and completion."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from gpusim.cli import app
from gpusim.scene.effects import EFFECTS

Run = Callable[..., Any]


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("COLUMNS", "80")

    def invoke(*arguments: str) -> Any:
        return CliRunner().invoke(app, list(arguments))

    return invoke


def commands(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths of a command and all below it."""
    yield path
    for name, one in getattr(command, "commands", {}).items():
        yield from commands(one, (*path, name))


def test_a_table_in_words(cli: Run) -> None:
    result = cli("schema", "camera.lens")
    assert result.exit_code == 0, result.output
    lines = [line.rstrip() for line in result.stdout.splitlines()]
    assert lines[0] == "camera.lens  [camera.lens]"
    assert lines[1] == "  A real lens; what isn't given isn't rendered."
    assert max(map(len, lines)) <= 80
    assert "\x1b" not in result.stdout
    row = next(number for number, line in enumerate(lines) if line.startswith("  fill_factor"))
    assert "a number > 0 and <= 1; without it 1.0" in " ".join(lines[row : row + 3])
    assert "  [camera.lens]" in lines
    assert '  psf = { type = "gaussian", sigma_px = 0.6 }' in lines


def test_a_table_of_several_kinds(cli: Run) -> None:
    text = cli("schema", "body.load").stdout
    assert "  force        A total force, spread evenly over the area of the faces." in text
    assert "gpusim schema body.load.force" in text
    assert "  amplitude  One factor per frame" in text


def test_a_kind_has_its_own_keys_first(cli: Run) -> None:
    text = cli("schema", "body.paint.speckle").stdout
    assert (
        0 < text.index("\n  diameter_mm") < text.index("\n  coverage") < text.index("\n  bump_um")
    )


def test_a_key_at_all_its_places(cli: Run) -> None:
    text = cli("schema", "focal_mm").stdout
    assert "camera.focal_mm  [[camera]]" in text and "camera.lens.focal_mm  [camera.lens]" in text
    assert "a number > 0, mm" in text
    assert "vignetting" not in text


@pytest.mark.parametrize(
    ("typed", "near"), [("camra", "camera"), ("body.load.froce", "body.load.force")]
)
def test_a_typo_is_answered_with_the_nearest_name(cli: Run, typed: str, near: str) -> None:
    result = cli("schema", typed)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert f"got {typed}" in result.stderr
    assert f"(did you mean {near}?)" in result.stderr


def test_without_a_table_it_is_the_json_schema(cli: Run) -> None:
    schema = json.loads(cli("schema").stdout)
    assert schema["$defs"]["CameraTable"]["properties"]["focal_mm"]["description"]


def test_help_says_what_the_effects_are(cli: Run) -> None:
    words = " ".join(cli("run", "--help").stdout.split())
    for name, effect in EFFECTS.items():
        assert f" {name} {effect.about}" in words


def test_flags_have_no_type_and_lines_fit(cli: Run) -> None:
    paths = list(commands(get_command(app)))
    assert len(paths) > 12
    for path in paths:
        result = cli(*path, "--help")
        assert result.exit_code == 0, path
        assert "bool" not in result.stdout, path
        assert max(map(len, result.stdout.splitlines())) <= 80, path
    assert "<auto|gpu|numpy>" in cli("run", "--help").stdout


def completed(words: str) -> list[str]:
    """What a shell is told when Tab is pressed behind these words."""
    variables = {"_GPUSIM_COMPLETE": "complete_bash", "COMP_WORDS": words,
                 "COMP_CWORD": str(words.count(" "))}  # fmt: skip
    program = "import sys; sys.argv[0] = 'gpusim'; from gpusim.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **variables},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("gpusim sch", ["schema"]),
        ("gpusim schema camera.l", ["camera.lens", "camera.lens.psf"]),
        ("gpusim init plate", ["plate_with_hole"]),
        ("gpusim run a.toml --no vig", ["vignetting"]),
        ("gpusim run a.toml --backend n", ["numpy"]),
    ],
)
def test_the_shell_completes(words: str, found: list[str]) -> None:
    assert completed(words)[: len(found)] == found


def test_completion_can_be_installed(cli: Run) -> None:
    assert "--install-completion" in cli("--help").stdout
