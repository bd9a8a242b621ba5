"""Tables that commands print: columns as wide as they need, warnings and the page at their end."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import Any

import pytest

from gpusim.cli.tables import (
    print_budget,
    print_correlation,
    print_deck,
    print_explanations,
    print_report,
    print_rows,
)
from gpusim.report import Measurement, Report
from gpusim.report.findings import Budget, BudgetRow, Explanation, PartSize

LONG = "200 beyond the edge of a picture, 100 without a speckle in sight"
END = ["warning: be careful", "", f"Report: {Path('out') / 'report.html'}"]


def report(**more: Any) -> Report:
    return Report("bar", "none", "done", warnings=("be careful",), **more)


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().out.splitlines()


def test_columns_are_as_wide_as_they_need(capsys: pytest.CaptureFixture[str]) -> None:
    print_rows([("name", "n", "why"), ("a long name", "12", ""), "alone: wider than all of it",
                ("b", "1234", "x")], "<><")  # fmt: skip
    assert lines(capsys) == [
        "name            n  why",
        "a long name    12",
        "alone: wider than all of it",
        "b            1234  x",
    ]
    with pytest.raises(ValueError, match="zip"):
        print_rows([("two", "cells"), ("one",)], "<<")
    with pytest.raises(ValueError, match="zip"):
        print_rows([("two", "cells")], "<")


def test_measured_beside_true(capsys: pytest.CaptureFixture[str]) -> None:
    found = (
        Measurement("deflection", "mm", 1.9, 2.0, -0.1, -0.05),
        Measurement("RMS error", "mm", 1e-3, 0.0, 1e-3, float("inf")),
        Measurement("noise floor", "mm", 1e-3, 0.0, 1e-3, float("inf"), detail=True),
        Measurement.compare("a shear that is noise", "um/m", -0.5, 1e-3),
        Measurement.compare(f"points lost of 22862 ({LONG})", "1", 300.0, 0.0),
    )
    print_report(report(measurements=found), Path("out"))
    assert lines(capsys) == [
        "",
        "                       measured  truth   error",
        "deflection                  1.9      2    -0.1  mm    -5.000 %",
        "RMS error                 0.001      0   0.001  mm",
        "a shear that is noise      -0.5  0.001  -0.501  um/m",
        "points lost of 22862        300      0     300  1",
        f"    ({LONG})",
        *END,
    ]


def test_errors_of_each_state(capsys: pytest.CaptureFixture[str]) -> None:
    rows = (BudgetRow("all", "", (0.5, 1e-5)), BudgetRow("only", "noise", (0.25, 2.0)))
    print_budget(report(budget=Budget((("deflection", "mm"), ("n", "")), rows)), Path("out"))
    assert lines(capsys) == [
        "(1) deflection / mm",
        "(2) n",
        "images with   (1)    (2)",
        "everything    0.5  1e-05",
        "only noise   0.25      2",
        *END,
    ]


def test_parts_of_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    sizes = {"displacements": PartSize(0.5, 50.0, -12.34), "strains": PartSize(0.0, nan, nan)}
    one = Explanation("field", 1, {"displacements": "mm", "strains": "microstrain"},
                      {"noise": sizes}, ("All is noise.",))  # fmt: skip
    print_explanations(report(explanations=(one,)), Path("out"))
    assert lines(capsys) == [
        "",
        "field, RMS   mm    share  microstrain  share",
        "noise       0.5  -12.3 %            0",
        "All is noise.",
        *END,
    ]


def test_pictures_and_what_they_lost(capsys: pytest.CaptureFixture[str]) -> None:
    first = {"image": "a/1.png", "measured": 7, "points": 12, "counts": {"OK": 7, "MASKED": 5},
             "u_mean": 0.5, "v_mean": -1.25, "sigma_median": 0.003}  # fmt: skip
    second = {"image": "a/second.png", "measured": 0, "points": 12, "counts": {"NO_TEXTURE": 12},
              "u_mean": None, "v_mean": None, "sigma_median": None}  # fmt: skip
    print_correlation({"images": [first, second], "warnings": ["be careful"]}, Path("out"))
    assert lines(capsys) == [
        "",
        "image       measured  mean u px  mean v px  sigma px",
        "1.png        7 of 12     0.5000    -1.2500    0.0030",
        "    5 masked",
        "second.png   0 of 12",
        "    12 no_texture",
        *END,
    ]
    keys = {"U_mean": 1.0, "V_mean": 2.0, "W_mean": 3.0, "sigma_median_mm": 4.0}
    space = {"image": "1.png", "measured": 1, "points": 1, "counts": {"OK": 1}, **keys}
    print_correlation({"images": [space], "warnings": []}, Path("out"))
    head = "image  measured  mean U mm  mean V mm  mean W mm  sigma mm"
    assert lines(capsys)[1:3] == [
        head, "1.png    1 of 1     1.0000     2.0000     3.0000    4.0000"
    ]  # fmt: skip


def test_steps_of_a_deck(capsys: pytest.CaptureFixture[str]) -> None:
    step = {
        "number": 1, "kind": "static", "unknowns": 1200, "iterations": 5, "load_steps": 0,
        "newton_iterations": 0,
        "error_estimate": 1e-7,
        "largest_displacement": 0.25, "largest_displacement_node": 17, "strain_energy": 3.5,
        "reaction": (0.0, -12.5, 1e-3), "largest_von_mises": 210.0, "largest_von_mises_element": 3,
    }  # fmt: skip
    deck = {"deck": "a.inp", "nodes": 400, "cells": {"hex8": 3}, "formulation": {"hex8": "B-bar"},
            "steps": [step, step | {"strain_energy": None}], "warnings": ["be careful"],
            "ignored": ["*RESTART"]}  # fmt: skip
    print_deck(deck, Path("out"))
    assert lines(capsys) == [
        "a.inp: 400 nodes, 3 hex8 (B-bar)",
        "",
        "step  unknowns  iterations    error  largest u  at node  energy  reaction",
        "1         1200           5  1.0e-07       0.25       17     3.5  0, -12.5, 0.001",
        "      largest von Mises stress 210 in element 3",
        "1         1200           5  1.0e-07       0.25       17          0, -12.5, 0.001",
        "      largest von Mises stress 210 in element 3",
        "warning: be careful",
        "read over: *RESTART",
        "",
        f"Results: {Path('out') / 'solution.pvd'}, {Path('out') / 'displacements.npz'}",
    ]
