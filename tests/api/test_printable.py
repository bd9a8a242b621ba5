"""Nothing that somebody else has written reaches a terminal, a page or a table raw."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from gpusim.cli import app
from gpusim.cli.console import ProgressDisplay
from gpusim.errors import Fault, GpusimError, InputError, SceneError
from gpusim.printable import printable
from gpusim.report.html import render_html
from gpusim.report.model import Report, Stage
from gpusim.scene import Scene

EVIL = "x\x1b[31m\u202e\u200b\x9b\x7f\u2028"
CLEAN = "x\\u001b[31m\\u202e\\u200b\\u009b\\u007f\\u2028"


def raw(text: str) -> set[str]:
    """The characters of a text that a terminal or reader obeys."""
    bad = {one for one in text if unicodedata.category(one) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    return bad - {"\n", "\t"}


def test_letters_stay_and_commands_do_not() -> None:
    for text in ("Größe 5 µm", "梁の変位", "4\u202fs 10⁵", 'a"b\\c[/red]'):
        assert printable(text) == text
    assert printable(EVIL) == CLEAN
    assert printable("a\nb\tc") == "a\\nb\\tc"
    assert printable("a\nb\tc", keep="\n") == "a\nb\\tc"
    every = "".join(map(chr, (*range(0x3000), *range(0xD7F0, 0xE010), 0xFEFF, 0xE0001)))
    assert not raw(printable(every))
    assert json.loads(f'"{printable(EVIL)}"') == EVIL


def test_errors_of_every_kind() -> None:
    for error in (
        GpusimError(EVIL),
        InputError(f"{EVIL}: not a mesh"),
        SceneError(EVIL, [Fault(EVIL, EVIL, EVIL, EVIL, EVIL)]),
    ):
        assert not raw(str(error)) and CLEAN in str(error)


def test_faults_of_a_scene(checkout: Path) -> None:
    document = {
        "schema": 1, "name": 3, EVIL: EVIL, "camera": [{"name": EVIL, "up": [EVIL, "\n"]}],
        "material": [{"name": EVIL}], "body": [{"name": EVIL, "material": EVIL}],
    }  # fmt: skip
    with pytest.raises(SceneError) as caught:
        Scene.from_document(document, source=EVIL, overrides={f"camera.{EVIL}.{EVIL}": EVIL})
    assert not raw(str(caught.value))
    for fault in caught.value.faults:
        assert "\n" not in str(fault)


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", f"{EVIL}.toml"),
        ("plan", "a", f"b{EVIL}"),
        ("plan", f"--{EVIL}"),
        (f"--{EVIL}",),
        (EVIL,),
        ("plan", "a.toml", "--backend", EVIL),
        ("bench", EVIL),
        ("check", EVIL),
        ("solve", f"{EVIL}.inp", "-o", EVIL),
    ],
)
def test_what_was_typed(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code != 0
    assert not raw(result.output)


def test_a_plan_and_its_json(checkout: Path, tmp_path: Path) -> None:
    text = (checkout / "examples" / "crane.toml").read_text(encoding="utf-8")
    path = tmp_path / f"s{EVIL}.toml"
    path.write_text(text.replace("Tower crane", "\\u001b[2J[red]\\u202e"), encoding="utf-8")
    for options in ([], ["--json"]):
        result = CliRunner().invoke(app, ["plan", str(path), *options])
        assert result.exit_code == 0 and not raw(result.output)
        assert "[red]" in result.output  # no markup either
    assert json.loads(result.output)["scene"] == "\x1b[2J[red]\u202e"


def test_progress_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressDisplay(quiet=False, stream_is_result=False) as progress:
        progress(EVIL, 1.0, f"[link=x]{EVIL}")
    text = capsys.readouterr().out
    assert not raw(text) and f"[link=x]{CLEAN}" in text


def test_report_page_and_json(tmp_path: Path) -> None:
    report = Report(
        scene=f"{EVIL}<script>", adapter=EVIL, status="failed", failure=EVIL, description=EVIL,
        stages=(Stage(EVIL, "run", EVIL, 1.0),), warnings=(EVIL,), facts={EVIL: EVIL},
        scene_text=f'name = "{EVIL}"\n',
    )  # fmt: skip
    page = render_html(report, {}, tmp_path)
    assert not raw(page) and CLEAN in page and "<script>x" not in page
    assert f"{CLEAN}&lt;script&gt;" in page
    assert not raw(report.to_json())
    assert json.loads(report.to_json())["scene"] == f"{EVIL}<script>"


def test_names_in_figures_and_tables(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from gpusim.export.correlation import _write_csv
    from gpusim.report.style import named

    figure = Figure()
    figure.add_subplot().set_title(named(r"$\frac{$ a $b$"))
    figure.savefig(tmp_path / "a.png")  # a formula that can't be read would raise here

    notes: dict[str, Any] = {"reference": printable(EVIL)}
    path = _write_csv(tmp_path / "a.csv", {"x": np.array([1.0])}, notes)
    assert not raw(path.read_text(encoding="utf-8"))
