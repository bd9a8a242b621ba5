"""What sources are drawn as: their distributions, and what can't be drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.scene import Scene
from gpusim.studies.budget.draws import draw, together
from gpusim.studies.budget.sources import sources_of
from gpusim.studies.budget_tables import BudgetSourceTable, BudgetTable
from tests.support.shifted_plate import shifted_plate

PAIR = {"cameras": ["left", "right"], "calibration": "true"}


def plate() -> Scene:
    return shifted_plate((0.3, 0.0, 0.0), PAIR)


def source(name: str, *keys: str, **how: Any) -> BudgetSourceTable:
    return BudgetSourceTable(name=name, keys=list(keys), **how)


def budget(*sources: BudgetSourceTable, **how: Any) -> BudgetTable:
    tables = [one.model_dump(exclude_none=True) for one in sources]
    return BudgetTable.model_validate({"sources": [], "source": tables, **how})


def test_distributions() -> None:
    scene = plate()
    tables = budget(
        source("focus", "camera.left.focal_mm", "camera.right.focal_mm", normal=0.1),
        source("place", "camera.left.position_mm", half_width=3.0, degrees_of_freedom=8.0),
        source("subset", "measure.field.subset_px", choices=[19, 21, 23]),
        source("speckle", "prop.plate.paint.speckle.seed", seeds=True),
        draws=1024,
    )  # fmt: skip
    focus, place, subset, speckle = draw(scene, sources_of(scene, tables), tables)
    # as exact as Sobol points are: far better than 1 / sqrt(2 N)
    np.testing.assert_allclose(focus.values.mean(axis=0), 12.0, atol=1e-3)
    np.testing.assert_allclose(focus.values.std(axis=0), 0.1, rtol=0.01)
    assert abs(np.corrcoef(focus.values.T)[0, 1]) < 0.01
    assert place.parameters[2] == "camera.left.position_mm.2" and place.degrees_of_freedom == 8.0
    np.testing.assert_allclose(place.values.mean(axis=0), [-20.0, 0.0, 200.0], atol=0.01)
    np.testing.assert_allclose(place.values.std(axis=0), 3.0 / np.sqrt(3.0), rtol=0.01)
    counts = np.unique(subset.values, return_counts=True)[1]
    assert sorted(counts.tolist()) == [341, 341, 342]
    assert [one["prop.plate.paint.speckle.seed"] for one in speckle.overrides[:2]] == [1, 2]
    assert np.isnan(speckle.values).all()
    every = together([focus, place])
    assert every[7] == focus.overrides[7] | place.overrides[7]
    again = draw(scene, sources_of(scene, tables), tables)
    assert again[1].overrides == place.overrides


def test_keys_that_are_off_together_and_keys_of_two_sources() -> None:
    scene, keys = plate(), ("camera.left.focal_mm", "camera.right.focal_mm")
    warmth = source("warmth", *keys, percent=1.0, together=True)
    tables = budget(warmth, draws=16)
    (found,) = draw(scene, sources_of(scene, tables), tables)
    np.testing.assert_array_equal(found.values[:, 0], found.values[:, 1])
    twice = budget(warmth, source("focus", keys[1], normal=0.1))
    with pytest.raises(InputError, match=r"focal_mm; got a key of 'warmth', too; expected each"):
        draw(scene, sources_of(scene, twice), twice)


def test_sources_that_a_scene_has() -> None:
    scene = plate()
    names = list(sources_of(scene, BudgetTable()))
    assert names == ["quantisation", "focal length", "principal point", "position", "orientation",
                     "light", "vibration", "speckle", "settings"]  # fmt: skip
    noisy = scene.replace("sensor.full_well_e", 1e4).replace(
        "camera.left.distortion", [0.1, 0.0, 0.0, 0.0]
    )
    names = list(sources_of(noisy, BudgetTable()))
    assert "noise" in names and "distortion" in names
    drawn = draw(noisy, sources_of(noisy, BudgetTable()), BudgetTable(draws=5))
    for change in together(drawn):  # all of it is a scene
        Scene.from_document(noisy.document, overrides=change)
    # a table of the same name is in place of the scene's own
    own = budget(source("light", "sensor.drift_percent", normal=3.0,
                        set={"sensor.drift_percent": 0.0}), draws=50)  # fmt: skip
    own = own.model_copy(update={"sources": ("light",)})
    (light,) = draw(scene, sources_of(scene, own), own)
    assert light.values.std() == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(("wrong", "message"), [
    (source("a", "camera.left.focal_um", normal=1.0), "camera.left.focal_um; got None"),
    (source("a", "camera.left.name", normal=1.0), "got 'left'; expected a key of the scene"),
    (source("a", "camera.left.focal_mm", seeds=True), "got 12.0; expected .* a seed"),
    (source("a", "sensor.seed", percent=1.0), "percent of 0; expected normal"),
])  # fmt: skip
def test_what_cannot_be_drawn(wrong: BudgetSourceTable, message: str) -> None:
    scene, tables = plate(), budget(wrong)
    with pytest.raises(InputError, match=message):
        draw(scene, sources_of(scene, tables), tables)


def test_a_source_that_the_scene_has_not() -> None:
    with pytest.raises(InputError, match=r"budget.sources; got 'lite'; expected .*light"):
        sources_of(plate(), BudgetTable.model_validate({"sources": ["lite"]}))


def test_one_distribution_each() -> None:
    with pytest.raises(ValueError, match="not one distribution"):
        source("a", "sensor.seed", normal=1.0, half_width=1.0)


def test_drift_and_motion_between_frames(tmp_path: Path) -> None:
    """A camera that is moved or turned sees the plate go the other way; light shifts nothing."""
    one = {"camera": "left", "mm_per_px": 1.0, "strain": "none"}
    f, middle = 300.0, 109.5  # px
    for changes, moved, turned in (
        ({"camera.left.moved_um": [50.0, 0.0, 0.0]}, 0.05, 0.0),
        ({"camera.left.turned_deg": [0.0, 0.01, 0.0]}, 0.0, np.radians(0.01)),
        ({"sensor.drift_percent": 5.0}, 0.0, 0.0),
    ):
        gs.run(shifted_plate((0.0, 0.0, 0.0), one, **changes), tmp_path, backend="numpy")
        with np.load(tmp_path / "measure" / "field.npz") as stored:
            shift, x = stored["measured_u_px"][-1], stored["x_px"][-1]
        expected = -f * moved / 200.0 - turned * f * (1.0 + ((x - middle) / f) ** 2)
        assert np.nanmean(shift - expected) == pytest.approx(0.0, abs=5e-4)
