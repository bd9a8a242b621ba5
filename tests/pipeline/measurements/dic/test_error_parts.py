"""Errors in parts that add up, and what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.pipeline.measurements.dic import FullFieldResult
from gpusim.pipeline.measurements.dic.error_parts import error_parts, remarks
from gpusim.pipeline.measurements.results import PointTable

X, Y = (one.ravel() * 10.0 for one in np.meshgrid(np.arange(13.0), np.arange(9.0)))
NAMES = ("u_mm", "v_mm", "exx", "eyy", "exy")
Known = dict[str, Float]
RANDOM = np.random.default_rng(7)


def fields(
    error: Float, true: Float | float = 0.0, known: Known | None = None,
    causes: Known | None = None,
) -> FullFieldResult:  # fmt: skip
    """Measured with an ``error`` (M, 5); smoothing does nothing but 1e-5 mm to u."""
    real = np.broadcast_to(true, error.shape)
    smooth = np.array([1e-5, 0.0, 0.0, 0.0, 0.0])
    kinds = {"measured": real + error, "true": real, "levelled": real + smooth}
    columns: dict[str, Any] = {"status": np.full(len(X), "OK"), "x_px": X, "y_px": Y} | {
        f"{kind}_{name}": column
        for kind, values in kinds.items() for name, column in zip(NAMES, values.T, strict=True)
    }  # fmt: skip
    table = PointTable.of("point", [f"p{k}" for k in range(len(X))], {1: columns})
    none: Any = np.zeros((1, 1, len(X), 2))
    return FullFieldResult(
        "field", table, ("front",), ("+x", "+y"), subset_px=21, step_px=10, shape="affine",
        strain="hencky", strain_window=5, blur_px=0.0, formats=("csv",), pixel_mm=0.1,
        calibration_px=np.nan, raw_px=none, rest_px=none, slope=X, contrast=X, spread=none[0, 0],
        geometric_errors=known or {}, causes=causes or {},
    )  # fmt: skip


def random() -> Float:
    return RANDOM.normal(size=(len(X), 5)) * [1e-3, 1e-3, 1e-5, 1e-5, 1e-5]


def test_effects_that_act_on_each_other_in_pairs_add_up() -> None:
    own = {name: random() for name in ("noise", "psf", "light")}
    pairs = {("noise", "psf"): random(), ("psf", "light"): 0.01 * random()}
    base = random()

    def error(present: set[str]) -> FullFieldResult:
        alone = sum((own[name] for name in present), base)
        return fields(alone + sum(one for pair, one in pairs.items() if set(pair) <= present))

    every = set(own)
    states = {("only", name): error({name}) for name in own}
    states |= {("no", name): error(every - {name}) for name in own}
    found = error_parts(error(every), {("none", ""): error(set()), **states})
    assert np.abs(found.missing).max() < 1e-15
    expected = own["noise"] + 0.5 * pairs["noise", "psf"]
    assert found.parts["noise"] == pytest.approx(expected, abs=1e-15)
    assert found.parts["settings"][:, 0] == pytest.approx(1e-5, abs=1e-15)
    shares = [found.sizes[name]["displacements"].share_percent for name in found.parts]
    assert sum(shares) == pytest.approx(100.0, abs=1e-10)
    told = remarks(found)[-1]
    assert "but for 0.0 % of displacements and 0.0 % of strains" in told
    assert "What noise, psf do depends on the other effects" in told


def test_what_three_do_together_is_missing() -> None:
    together = random()
    names = {"noise", "psf", "light"}
    nothing = fields(0.0 * together)
    states = [("none", ""), *((state, name) for state in ("only", "no") for name in names)]
    found = error_parts(fields(together), dict.fromkeys(states, nothing))
    # each takes all of it away and adds nothing alone: half of it three times
    assert found.missing == pytest.approx(
        -0.5 * together + [-1e-5, 0, 0, 0, 0] + [1e-5, 0, 0, 0, 0]
    )
    assert "light" in remarks(found)[-1] and "but for 50.0 %" in remarks(found)[-1]


def test_patterns_are_told_from_what_all_of_them_have() -> None:
    always, drawn = random(), [random() for _ in range(3)]
    one, second, third = (fields(always + own) for own in drawn)
    states = {("none", ""): one, ("none", "second"): second, ("none", "third"): third}
    found = error_parts(one, states)
    assert found.parts["matching"] + found.parts["settings"] == pytest.approx(
        always + np.mean(drawn, axis=0), abs=1e-15
    )
    assert found.parts["speckle"] == pytest.approx(drawn[0] - np.mean(drawn, axis=0), abs=1e-15)
    assert np.abs(found.missing).max() < 1e-15


def test_a_rigid_motion_that_reads_as_something_is_named() -> None:
    bent, tilt = np.zeros((2, len(X), 5))
    bent[:, 0] = 0.05 + 1e-6 * (X - 40.0) ** 2
    bent[:, 2] = 2e-6 * (X - 40.0)
    tilt[:, 1] = 1e-4 * X
    true = np.array([5.0, 0.0, 0.0, 0.0, 0.0])
    causes = {"focal length of camera front": 0.7 * bent,
              "distortion of camera front": 0.02 * bent}  # fmt: skip
    one = fields(bent, true, {"calibration": bent}, causes)
    found = error_parts(one, {("none", ""): fields(0 * bent, true)})
    words = remarks(found)
    assert words[0] == "The largest part of the error of displacements is calibration: 100 %."
    assert words[1].startswith("A rigid motion of 5 mm reads as a parabola in u, by calibration")
    assert "0.056 mm and 160 microstrain" in words[1]
    assert words[2] == "What calibration does comes from: focal length of camera front (+70 %)."
    one = fields(tilt, true, {"calibration": tilt})
    flat = error_parts(one, {("none", ""): fields(0 * tilt, true)})
    assert "reads as a stretch or tilt, by calibration" in remarks(flat)[1]
    strained = true + np.array([0.0, 0.0, 1e-3, 0.0, 0.0])
    one = fields(bent, strained, {"calibration": bent})
    real = error_parts(one, {("none", ""): fields(0 * bent, strained)})
    assert not any("rigid" in text for text in remarks(real))


def test_points_that_one_state_lost_count_nowhere() -> None:
    error = random()
    lost = error.copy()
    lost[3] = np.nan
    found = error_parts(fields(error), {("none", ""): fields(lost)})
    assert np.isnan(found.whole[3]).all() and np.isnan(found.parts["matching"][3]).all()
    assert all(np.isfinite(one.rms) for one in found.sizes["measured less true"].values())
    with pytest.raises(GpusimError, match="got no point in frame 1 that is found"):
        error_parts(fields(error), {("none", ""): fields(np.full_like(error, np.nan))})
