"""Points of a study: combinations, distributions, files of rows, Saltelli's points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from gpusim.errors import InputError
from gpusim.studies import load_study
from gpusim.studies.design import points
from tests.studies.small_studies import write_study

HEAD = 'scene = "bar.toml"\nbackend = "numpy"\n'
TWO = """[[parameter]]
key = "camera.side.focal_mm"
list = [29.0, 30.0, 31.0]
name = "f"
[[parameter]]
key = "material.0.youngs_modulus_GPa"
list = [60.0, 70.0, 80.0]
name = "E"
"""


def drawn(kind: str, more: str = "", name: str = "x", key: str = "solver.tolerance") -> str:
    return f'[[parameter]]\nkey = "{key}"\nname = "{name}"\n{kind}\n{more}\n'


def of(folder: Path, text: str) -> dict[str, list[float]]:
    return points(load_study(write_study(folder, HEAD + text)))


def test_lists_make_a_grid_or_go_side_by_side(tmp_path: Path) -> None:
    grid = of(tmp_path, TWO)
    assert list(zip(grid["f"], grid["E"], strict=True)) == [
        (f, e) for f in (29.0, 30.0, 31.0) for e in (60.0, 70.0, 80.0)
    ]
    zipped = of(tmp_path, 'combine = "zip"\n' + TWO)
    assert zipped == {"f": [29.0, 30.0, 31.0], "E": [60.0, 70.0, 80.0]}
    with pytest.raises(InputError, match="3 of f, 2 of E; expected equally many"):
        of(tmp_path, 'combine = "zip"\n' + TWO.replace(", 80.0", ""))


def test_rows_are_a_list_of_points(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(
        'sensor.bits,analysis.load_factors\n8,"[0, 1]"\n10,"[0, 2]"\n'
    )
    found = of(tmp_path, 'rows = "points.csv"\n' + TWO)
    assert len(found["f"]) == 18
    assert found["sensor.bits"] == [8] * 9 + [10] * 9
    assert found["analysis.load_factors"][0] == [0, 1]


@pytest.mark.parametrize(
    ("text", "words"),
    [("a,b\n1\n", "row 2; got 1 values; expected 2"), ("a,a\n1,2\n", "each once"),
     ("a\n", "a row or more"), ("a,b\n1,2\n1,x\n", "row 3: b; got 'x'"), ("a,b\n1,\n", "row 2")],
)  # fmt: skip
def test_rows_that_are_none_are_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        of(tmp_path, 'rows = "points.csv"\n')


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol", "halton"])
@pytest.mark.parametrize(
    ("kind", "law"),
    [
        ("uniform = [2.0, 5.0]", stats.uniform(2, 3)),
        ("log_uniform = [1.0, 9.0]", stats.loguniform(1, 9)),
        ("normal = [1.0, 2.0]", stats.norm(1, 2)),
        ("log_normal = [3.0, 0.5]", stats.lognorm(0.5, scale=3)),
        ("normal = [1.0, 2.0]\nlow = 0.0\nhigh = 2.0", stats.truncnorm(-0.5, 0.5, 1, 2)),
    ],
)
def test_values_are_distributed_as_asked(
    kind: str, law: stats.rv_continuous, design: str, tmp_path: Path
) -> None:
    text = f'design = "{design}"\nsamples = 256\nseed = 3\n{drawn(kind)}'
    values = of(tmp_path, text)["x"]
    assert stats.kstest(values, law.cdf).pvalue > 0.01
    assert values == of(tmp_path, text)["x"]
    assert values != of(tmp_path, text.replace("seed = 3", "seed = 4"))["x"]


def test_each_combination_has_all_points(tmp_path: Path) -> None:
    found = of(tmp_path, "samples = 4\n" + TWO + drawn("uniform = [0.1, 0.2]"))
    assert len(found["f"]) == 36
    assert found["x"][:4] == found["x"][4:8] == found["x"][-4:]


def test_sobol_indices_of_a_known_function(tmp_path: Path) -> None:
    """Ishigami's function, whose indices are known (Saltelli et al. 2008, section 4.3)."""
    angles = "".join(drawn("uniform = [-3.141592653589793, 3.141592653589793]", name=name,
                           key=f"camera.side.{name}") for name in "xyz")  # fmt: skip
    found = of(tmp_path, f"samples = 1024\nsensitivity = true\n{angles}")
    x, y, z = (np.array(found[name]) for name in "xyz")
    values = np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
    a, b, *mixed = values.reshape(5, 1, 1024)
    indices = stats.sobol_indices(func={"f_A": a, "f_B": b, "f_AB": np.stack(mixed)}, n=1024)
    np.testing.assert_allclose(indices.first_order.ravel(), [0.3139, 0.4424, 0.0], atol=0.02)
    np.testing.assert_allclose(indices.total_order.ravel(), [0.5576, 0.4424, 0.2437], atol=0.02)


@pytest.mark.parametrize("kind", ["list = [1e-6]", "uniform = [1e-6, 1e-5]"])
def test_a_key_of_rows_stands_nowhere_else(kind: str, tmp_path: Path) -> None:
    write_study(tmp_path)
    (tmp_path / "points.csv").write_text("solver.tolerance\n1e-6\n1e-5\n")
    samples = "samples = 2\n" if "uniform" in kind else ""
    with pytest.raises(InputError, match="stands in rows, too"):
        of(tmp_path, f'rows = "points.csv"\n{samples}' + drawn(kind))
