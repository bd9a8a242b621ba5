"""A data set of a small study: opened by foreign readers, against displacements in closed form."""

from __future__ import annotations

import csv
import io
import json
import tarfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.dataset
import pytest
import tifffile

import gpusim as gs
from gpusim.errors import GpusimError
from gpusim.graph.store import Store
from gpusim.studies import load_study, samples_of
from gpusim.studies.dataset import write_dataset
from gpusim.studies.dataset.sample_results import OpenedSample, SampleResults
from gpusim.studies.rows import read_rows
from tests.support.flow_readers import read_flo, read_kitti
from tests.support.stretched_bar import (
    PARAMETERS,
    PlainCamera,
    stretch,
    true_flow,
    true_forward_flow,
    write_study,
)

ALL_LABELS = """
labels = ["flow", "forward_flow", "displacement", "depth", "normal", "region", "element",
          "visibility", "keypoints", "poses"]
"""


def made(folder: Path, table: str) -> Path:
    """The data set of the study with this ``[dataset]``; samples are made once in ``folder``."""
    gs.study(write_study(folder, PARAMETERS + table), folder / "OUT")
    return folder / "OUT" / "dataset"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With all labels, of whole pictures."""
    return made(tmp_path_factory.mktemp("whole"), ALL_LABELS)


def manifest(dataset: Path) -> list[dict[str, Any]]:
    """As a reader of Parquet data sets has it."""
    table = pyarrow.dataset.dataset(dataset / "manifest.parquet").to_table()
    return list(table.to_pylist())


def stamps(dataset: Path) -> dict[str, tuple[int, int]]:
    paths = [path for path in sorted(dataset.rglob("*")) if path.is_file()]
    return {str(one.relative_to(dataset)): (one.stat().st_mtime_ns, one.stat().st_size)
            for one in paths}  # fmt: skip


def pairs(dataset: Path) -> Iterator[tuple[dict[str, Any], str, PlainCamera, float]]:
    """Lines of the manifest, with the item's path, camera and stress."""
    for line in manifest(dataset):
        camera = PlainCamera(position=tuple(json.loads(line["parameter.place"])))
        stress = json.loads(line["parameter.traction"])[0]
        yield line, str(dataset / line["split"] / line["item"]), camera, stress


def test_flow_is_the_displacement_in_closed_form(whole: Path) -> None:
    worst = []
    for _, item, camera, stress in pairs(whole):
        for layer, wanted in (("forward_flow", true_forward_flow(camera, stress)),
                              ("flow", true_flow(camera, stress))):  # fmt: skip
            path = f"{item}.1.{layer}.flo"
            found = read_flo(Path(path).read_bytes())
            known = np.isfinite(wanted) & np.isfinite(found)
            assert known.sum() > 0.95 * np.isfinite(wanted).sum() > 2000
            worst.append(np.abs(found - wanted)[known].max())
            np.testing.assert_array_equal(cv2.readOpticalFlow(path)[known], found[known])
    assert len(worst) == 2 * 8
    assert max(worst) < 1e-4
    assert max(worst) < 1e-5  # what it is


def test_layers_are_true_in_other_peoples_readers(whole: Path) -> None:
    for _, item, camera, stress in list(pairs(whole))[::2]:
        place = camera.on_front(np.stack(np.meshgrid(np.arange(96.0), np.arange(48.0)), axis=2))
        at_rest = place / stretch(stress)
        region = cv2.imread(f"{item}.1.region.tiff", cv2.IMREAD_UNCHANGED)
        # what isn't seen square on may be another side of the bar
        front = (region == 1) & (at_rest[..., 0] < 59.5) & (at_rest[..., 0] > 0.5)
        assert front.sum() > 2000
        u = tifffile.imread(f"{item}.1.displacement.tiff")
        np.testing.assert_allclose(1e3 * u[front], (place - at_rest)[front], atol=2e-6)
        depth = tifffile.imread(f"{item}.1.depth.tiff")
        wanted = (place - np.array(camera.position)) @ camera.axes[2]
        np.testing.assert_allclose(1e3 * depth[front], wanted[front], rtol=1e-6)
        normal = tifffile.imread(f"{item}.1.normal.tiff")
        np.testing.assert_allclose(normal[front], [[0.0, -1.0, 0.0]] * front.sum(), atol=1e-6)
        seen = cv2.imread(f"{item}.1.visibility.tiff", cv2.IMREAD_UNCHANGED)
        assert set(np.unique(seen)) <= {-1, 0, 1} and (seen[front] == 1).mean() > 0.95
        element = tifffile.imread(f"{item}.1.element.tiff")
        assert element[front].min() >= 0 and element[front].max() < 18
        for place_in_item in (0, 1):
            picture = cv2.imread(f"{item}.{place_in_item}.png", cv2.IMREAD_UNCHANGED)
            assert picture.shape == (48, 96) and picture.std() > 20


def test_no_structure_is_in_two_splits_and_shares_are_exact(whole: Path) -> None:
    lines = manifest(whole)
    splits: dict[str, set[str]] = {}
    for line in lines:
        splits.setdefault(line["structure"], set()).add(line["split"])
    by_load = {line["parameter.traction"]: line["structure"] for line in lines}
    assert len(splits) == len(by_load) == len(set(by_load.values())) == 4
    assert all(len(names) == 1 for names in splits.values())
    counts = Counter(line["split"] for line in lines)
    assert counts == {"train": 4, "val": 2, "test": 2}


def test_a_structure_is_what_is_solved_whatever_its_factors(tmp_path: Path) -> None:
    document = write_study(tmp_path, PARAMETERS)
    study, store = load_study(document), Store(tmp_path / "store")
    with OpenedSample() as opened:

        def structure(**changes: Any) -> str:
            sample = replace(samples_of(study)[0], overrides=changes)
            return SampleResults(study, sample, store, opened).structure

        first = structure()
        for alike in ({"sensor.seed": 3}, {"camera.front.focal_mm": 45.0},
                      {"body.bar.paint.speckle.seed": 4},
                      {"analysis": {"load_factors": [0.0, 0.5]}}):  # fmt: skip
            assert structure(**alike) == first
        for other in ({"material.soft.poissons_ratio": 0.2}, {"body.bar.mesh.divisions": [3, 1, 2]},
                      {"body.bar.load.pull.traction_MPa": [0.0, 0.0, 1.0]}):  # fmt: skip
            assert structure(**other) != first


def test_the_manifest_says_the_same_as_csv_and_names_every_item(whole: Path) -> None:
    with open(whole / "manifest.csv", encoding="utf-8", newline="") as stream:
        as_csv = list(csv.DictReader(stream))
    as_parquet = [{key: str(value) for key, value in line.items()} for line in manifest(whole)]
    assert as_csv == as_parquet
    parts = [pyarrow.dataset.dataset(whole / name / "manifest.parquet").to_table().to_pylist()
             for name in ("train", "val", "test")]  # fmt: skip
    assert [line for part in parts for line in part] == manifest(whole)
    assert [{line["split"] for line in part} for part in parts] == [{"train"}, {"val"}, {"test"}]
    told = {json.loads((whole / line["file"]).read_text())["item"] for line in as_csv}
    assert told == {line["item"] for line in as_csv} and len(told) == 8


def test_keypoints_as_coco_and_poses_as_bop_agree_with_opencv(whole: Path) -> None:
    corners = np.array([(x, 5.0, z) for z in (-9.0, -5.0) for x in 6.0 + 4.0 * np.arange(1, 12)])
    total = 0
    for split in ("train", "val", "test"):
        coco, cameras, truth = (
            json.loads((whole / split / f"{name}.json").read_text())
            for name in ("coco_keypoints", "scene_camera", "scene_gt")
        )
        categories = {one["id"]: one for one in coco["categories"]}
        ids = [one["id"] for one in coco["images"]]
        assert ids == list(range(len(ids))) and list(cameras) == list(truth) == [*map(str, ids)]
        for image in coco["images"]:
            assert (whole / split / image["file_name"]).is_file()
            (own,) = (one for one in coco["annotations"] if one["image_id"] == image["id"])
            assert categories[own["category_id"]]["name"] == "board"
            names = categories[own["category_id"]]["keypoints"]
            rows = np.array(own["keypoints"]).reshape(-1, 3)
            assert len(names) == len(rows) == 22
            K = np.array(cameras[str(image["id"])]["cam_K"]).reshape(3, 3)
            (pose,) = (one for one in truth[str(image["id"])] if one["obj_id"] == 2)
            R = np.array(pose["cam_R_m2c"]).reshape(3, 3)
            wanted = cv2.projectPoints(corners, cv2.Rodrigues(R)[0], np.array(pose["cam_t_m2c"]), K,
                                       None)[0].reshape(-1, 2)  # fmt: skip
            seen = rows[:, 2] > 0
            assert own["num_keypoints"] == seen.sum() > 10
            np.testing.assert_allclose(rows[seen, :2], wanted[seen], atol=1e-8)
            low, high = rows[seen, :2].min(axis=0), rows[seen, :2].max(axis=0)
            np.testing.assert_allclose(own["bbox"], [*(low + 0.5), *(high - low)])
            total += 1
    assert total == 16


def test_poses_lead_from_the_world_to_the_camera(whole: Path) -> None:
    line, item, camera, _ = next(pairs(whole))
    facts = json.loads(Path(f"{item}.json").read_text())
    before = facts["pictures"][0]
    for one in before["objects"]:
        pose = np.array(one["camera_from_object_m"])
        np.testing.assert_allclose(pose[:3, :3], camera.axes, atol=1e-12)
        np.testing.assert_allclose(
            1e3 * pose[:3, 3], -camera.axes @ np.array(camera.position), atol=1e-9
        )
    np.testing.assert_allclose(np.array(before["K"])[:2, 2], camera.middle)
    assert facts["crop_width"] == 96 and facts["sample"] == line["sample"]


def test_crops_have_their_own_labels_and_points(whole: Path, tmp_path: Path) -> None:
    cut = made(whole.parent.parent, ALL_LABELS + "crop_px = [40, 24]\ncrops = 2\nseed = 5\n")
    try:
        lines = manifest(cut)
        assert len(lines) == 16 and len({line["crop_left"] for line in lines}) > 5
        for line, item, camera, stress in pairs(cut):
            left, top = line["crop_left"], line["crop_top"]
            part = slice(top, top + 24), slice(left, left + 40)
            wanted = true_forward_flow(camera, stress)[part]
            found = cv2.readOpticalFlow(f"{item}.1.forward_flow.flo")
            known = np.isfinite(wanted) & (found < 1e9)
            assert found.shape == (24, 40, 2)
            assert np.abs(found - wanted)[known].max(initial=0.0) < 1e-4
            own = json.loads(Path(f"{item}.json").read_text())["pictures"][1]
            np.testing.assert_allclose(np.array(own["K"])[:2, 2], camera.middle - [left, top])
            rows = np.array(own["objects"][1]["keypoints"])
            inside = rows[:, 2] > 0
            assert (rows[~inside] == 0.0).all()
            assert ((rows[inside, :2] >= -0.5) & (rows[inside, :2] < [39.5, 23.5])).all()
    finally:
        made(whole.parent.parent, ALL_LABELS)  # as others expect it


def test_a_second_call_changes_nothing_and_damage_is_mended(whole: Path) -> None:
    before = stamps(whole)
    made(whole.parent.parent, ALL_LABELS)
    assert stamps(whole) == before
    broken = next(whole.rglob("*.flo"))
    content = broken.read_bytes()
    broken.write_bytes(content[:-3])
    gone = next(whole.rglob("*.depth.tiff"))
    gone.unlink()
    made(whole.parent.parent, ALL_LABELS)
    after = stamps(whole)
    assert broken.read_bytes() == content and gone.is_file()
    item = {path.name.split(".")[0] for path in (broken, gone)}
    assert {name for name in after if after[name] != before[name]} == {
        name for name in after if Path(name).name.split(".")[0] in item
    }


def test_what_is_no_part_of_it_any_more_is_deleted(whole: Path) -> None:
    before = stamps(whole)
    (whole / "mine.txt").write_text("kept")
    few = made(whole.parent.parent, 'labels = ["flow"]\nflow_format = "kitti"\nshards = 3\n')
    names = {name for name in stamps(few)}
    tars = {name for name in names if name.endswith(".tar")}
    rest = {name for name in names - tars if not name.rpartition("/")[2].startswith("manifest.")}
    assert rest == {"README.md", "mine.txt"}
    assert len(tars) == 2 + 1 + 1
    (whole / "mine.txt").unlink()
    made(whole.parent.parent, ALL_LABELS)
    assert {name: size for name, (_, size) in stamps(whole).items()} == {
        name: size for name, (_, size) in before.items()
    }


def test_shards_have_the_same_files_and_always_the_same_bytes(whole: Path) -> None:
    loose = {path.name: path.read_bytes() for path in whole.rglob("0*") if path.is_file()}
    shards = made(whole.parent.parent, ALL_LABELS + "shards = 3\n")
    bytes_before = {path: path.read_bytes() for path in shards.rglob("*.tar")}
    found: dict[str, bytes] = {}
    for path, data in bytes_before.items():
        with tarfile.open(fileobj=io.BytesIO(data)) as tar:
            members = tar.getmembers()
            assert {(one.mtime, one.uid, one.gid, one.uname) for one in members} == {(0, 0, 0, "")}
            keys = [one.name.split(".")[0] for one in members]
            assert keys == sorted(keys)  # an item's files lie together, as WebDataset wants them
            for one in members:
                stream = tar.extractfile(one)
                assert stream is not None
                found[one.name] = stream.read()
        path.unlink()
    # but for the name of its file nothing is other
    assert found == loose
    made(whole.parent.parent, ALL_LABELS + "shards = 3\n")
    assert {path: path.read_bytes() for path in shards.rglob("*.tar")} == bytes_before
    made(whole.parent.parent, ALL_LABELS)


def test_a_killed_one_goes_on(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = {name: size for name, (_, size) in stamps(whole).items()}
    place = whole.parent
    study = load_study(write_study(place.parent, PARAMETERS + ALL_LABELS))
    samples = samples_of(study)
    rows = read_rows(place, samples)
    made(whole.parent.parent, "shards = 1\n")

    class Killed(BaseException):
        pass

    def die(stage: str, done: float, words: str) -> None:
        assert stage == "dataset"
        if words == "5 of 8 items":
            raise Killed

    with pytest.raises(Killed):
        write_dataset(study, samples, rows, place, die)
    there = stamps(whole)
    assert len([name for name in there if name.endswith(".json")]) == 5
    write_dataset(study, samples, rows, place)
    after = stamps(whole)
    assert {name: size for name, (_, size) in after.items()} == wanted
    kept = {name for name in there if name in after and "/0" in name}
    assert len(kept) > 50 and all(after[name] == there[name] for name in kept)


def test_the_card_tells_versions_seeds_conventions_and_counts(whole: Path) -> None:
    card = (whole / "README.md").read_text(encoding="utf-8")
    for words in (
        "8 of 8 samples", "| train | 0.5 | 4 | 2 | 4 |", "| val | 0.25 | 2 | 1 | 2 |",
        "| forward_flow | px, from a pixel of picture 0", "float32; 1e10 where nothing is known",
        "Seeds: design 0, crops and splits 0.", "SHA-256 `",
    ):  # fmt: skip
        assert words in card
    assert "KITTI" not in card and "tar file" not in card


def test_sequences_have_all_frames_and_kitti_is_rounded(tmp_path: Path) -> None:
    text = PARAMETERS.replace("[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [-15.0, 0.0, 0.0], ", "")
    path = write_study(
        tmp_path, text + 'items = "sequences"\nflow_format = "kitti"\n', prop=[],
        analysis={"load_factors": [0.0, 0.5, 1.0]},
    )  # fmt: skip
    gs.study(path, tmp_path / "OUT")
    dataset = tmp_path / "OUT" / "dataset"
    lines = list(pairs(dataset))
    assert [line["frames"] for line, *_ in lines] == ["0 1 2"] * 2
    for _, item, camera, stress in lines:
        assert all(Path(f"{item}.{frame}.png").is_file() for frame in range(3))
        assert not Path(f"{item}.0.forward_flow.png").exists()
        for frame, factor in ((1, 0.5), (2, 1.0)):
            wanted = true_forward_flow(camera, factor * stress)
            found = read_kitti(Path(f"{item}.{frame}.forward_flow.png").read_bytes())
            known = np.isfinite(wanted) & np.isfinite(found)
            assert known.sum() > 2000
            assert 1e-3 < np.abs(found - wanted)[known].max() < 1.0 / 128.0 + 1e-5


def test_results_that_are_gone_are_told(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path, PARAMETERS))
    samples = samples_of(study)
    rows = {one.number: {"status": "done"} for one in samples}
    with pytest.raises(GpusimError, match=r"sample .*isn't in .*run the study again"):
        write_dataset(study, samples, rows, tmp_path / "OUT")


def test_samples_that_came_to_nothing_have_no_items(whole: Path, tmp_path: Path) -> None:
    study = load_study(write_study(whole.parent.parent, PARAMETERS + ALL_LABELS))
    samples = samples_of(study)
    rows = read_rows(whole.parent, samples)
    lost = {number: {**row, "status": "failed"} for number, row in rows.items() if number > 3}
    write_dataset(study, samples, rows | lost, whole.parent)
    assert {line["sample"] for line in manifest(whole)} == {0, 1, 2, 3}
    assert "4 of 8 samples of a study; the others" in (whole / "README.md").read_text()
    write_dataset(study, samples, rows, whole.parent)
