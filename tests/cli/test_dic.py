"""``gpusim dic``: from pictures to tables, maps and a page."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications import CorrelationSettings, correlate_files, correlation_output
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.export.correlation import write_correlation
from gpusim.files.frame_source import FrameSource
from gpusim.files.picture_file import pages_of, read_grey
from gpusim.measure import Status, dic, strain
from tests.support.measure_images import speckles

Run = Callable[..., Any]
SIZE = {"width": 137, "height": 101}


@pytest.fixture
def cli() -> Run:
    def invoke(*arguments: str | Path) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return invoke


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One reference and two shifted pictures: 8 bit, 16 bit and colour."""
    folder = tmp_path_factory.mktemp("pictures")
    images = [speckles(**SIZE, shift=(1.25 * k, -0.5 * k)) for k in range(3)]
    cv2.imwrite(str(folder / "ref.png"), np.rint(images[0]).astype(np.uint8))
    cv2.imwrite(str(folder / "one.tif"), np.rint(images[1] * 200).astype(np.uint16))
    grey = np.rint(images[2]).astype(np.uint8)
    cv2.imwrite(str(folder / "two.png"), np.dstack([grey, grey, np.minimum(grey + 1, 255)]))
    mask = np.full((101, 137), 255, dtype=np.uint8)
    mask[:, :45] = 0
    cv2.imwrite(str(folder / "mask.png"), mask)
    return folder


def test_tables_maps_and_page(cli: Run, pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = cli(
        *("dic", pictures / "ref.png", pictures / "one.tif", pictures / "two.png", "-o", out),
        *("--subset", 21, "--step", 8, "--format", "csv", "--format", "h5", "--format", "npz"),
        *("--backend", "numpy", "--mask", pictures / "mask.png", "--strain", "hencky"),
    )
    assert done.exit_code == 0, done.output
    assert "one.tif" in done.output and "masked" in done.output
    (taken,) = re.findall(r"^ *([0-9.]+) s +dic", done.output, re.MULTILINE)
    told = json.loads((out / "report.json").read_text())["images"]
    assert float(taken) >= sum(image["seconds"] for image in told) - 0.01 > 0.0
    names = {
        f"{stem}.{suffix}"
        for stem in ("0001_one", "0002_two")
        for suffix in ("csv", "h5", "npz", "png")
    }
    assert names | {"report.html", "report.json"} == {path.name for path in out.iterdir()}
    for number, stem in ((1, "0001_one"), (2, "0002_two")):
        lines = (out / f"{stem}.csv").read_text().splitlines()
        assert any(line == "# strain_gauge_px = 53.0" for line in lines)
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        good = [row for row in rows if row["status"] == "OK"]
        masked = [row for row in rows if row["status"] == "MASKED"]
        assert masked and all(row["u_px"] == row["exx"] == "" for row in masked)
        u = np.array([float(row["u_px"]) for row in good])
        sigma = np.array([float(row["sigma_px"]) for row in good])
        error = np.abs(u - 1.25 * number)
        assert np.median(error) <= 3e-3
        assert (error <= 5 * sigma + 1e-3).all()  # little is left of subsets beside the mask
        assert np.median([abs(float(row["exx"])) for row in good if row["exx"]]) <= 1e-3
        with h5py.File(out / f"{stem}.h5") as file, np.load(out / f"{stem}.npz") as data:
            assert file["u"].attrs["unit"] == data["unit_u"] == "px"
            assert np.array_equal(file["u"][:], data["u"], equal_nan=True)
            assert np.isfinite(data["u"]).sum() == len(good) == (data["status"] == 0).sum()
            assert data["status_names"][int(Status.MASKED)] == "MASKED"
    report = json.loads((out / "report.json").read_text())
    assert [image["measured"] > 50 for image in report["images"]] == [True, True]
    page = (out / "report.html").read_text()
    assert page.count("data:image/jpeg") == 2 and "http" not in page.split("</style>")[1]
    for number, name in ((1, "one.tif"), (2, "two.png")):
        stem = f"{number:04d}_{name[:3]}"
        assert f'<a href="{stem}.png" data-label="{name}"' in page and f'href="{stem}.h5"' in page
        image = report["images"][number - 1]
        count = f"{image['measured']} of {image['points']}"
        assert f'<th scope="row">{name}</th><td class="n">{count}</td>' in page


def test_films_have_times_in_tables_and_few_maps(
    cli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(correlation_output, "LONG", 3)
    monkeypatch.setattr(correlation_output, "FEW", 2)
    frames = [np.rint(speckles(**SIZE, shift=(0.5 * k, 0.0))).astype(np.uint8) for k in range(4)]
    film = gs.write_video(tmp_path / "film.mkv", frames, frame_rate=250.0)
    settings = ("--subset", 21, "--step", 30, "--backend", "numpy", "--format", "csv")
    done = cli("dic", f"{film}#1", film, "-o", tmp_path / "out", *settings, "--format", "h5")
    assert done.exit_code == 0, done.output
    assert "# time_s = 0.008" in (tmp_path / "out/0003_film.csv").read_text().splitlines()
    with h5py.File(tmp_path / "out/0004_film.h5") as file:
        assert file.attrs["time_s"] == 0.012 and file["u"].attrs["unit"] == "px"
    drawn = [path.name for path in sorted((tmp_path / "out").glob("*.png"))]
    assert drawn == ["0002_film.png", "0004_film.png"]
    guess = "times are those at which it is played"
    guessed = FrameSource(frames, list("abcd"), np.arange(4.0), guess)
    own = CorrelationSettings(subset=21, step=30, backend="numpy")
    told = correlate_files(frames[0], guessed, tmp_path / "guessed", own).report
    assert told["warnings"] == [guess] and told["images"][3]["time_s"] == 3.0


def test_what_is_wrong_is_said_before_anything_is_written(
    cli: Run, pictures: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    base = ("dic", pictures / "ref.png", pictures / "one.tif", "-o", out, "--backend", "numpy")
    cases = {
        ("--subset", "20"): "subset",
        ("--roi", "1,2,3"): "--roi",
        ("--roi", "0,0,500,20"): "roi",
        ("--strain-window", "4"): "--strain-window",
        ("--mask", str(tmp_path / "none.png")): "none.png",
        ("--update", "often"): "--update",
        ("--format", "xlsx"): "--format",
    }
    for change, words in cases.items():
        done = cli(*base, *change)
        assert done.exit_code == 2, (change, done.output)
        assert words in done.output
    missing = cli("dic", pictures / "ref.png", "a.png", "b.png", "-o", out)
    assert missing.exit_code == 2 and "a.png" in missing.output and "b.png" in missing.output
    text = tmp_path / "text.png"
    text.write_text("no picture")
    wrong = cli("dic", pictures / "ref.png", text, "-o", out, "--backend", "numpy")
    assert wrong.exit_code == 2 and "text.png" in wrong.output
    assert not out.exists()


def test_pictures_of_another_size_are_refused(cli: Run, pictures: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "cut.png"), np.zeros((91, 137), np.uint8))
    done = cli("dic", pictures / "ref.png", tmp_path / "cut.png", "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert "cut.png: not of ref.png's size; got 137 x 91 px; expected 137 x 101 px" in done.output


def test_nothing_measured_is_exit_code_3(cli: Run, pictures: Path, tmp_path: Path) -> None:
    flat = tmp_path / "flat.png"
    cv2.imwrite(str(flat), np.full((101, 137), 90, dtype=np.uint8))
    done = cli(
        *("dic", flat, flat, "-o", tmp_path / "out", "--backend", "numpy", "--json", "--step", 30)
    )
    assert done.exit_code == 3
    assert json.loads(done.stdout)["images"][0]["counts"] == {"NO_TEXTURE": 12}
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_pictures_of_any_kind_are_read_as_grey(dtype: type, tmp_path: Path) -> None:
    image = (speckles(33, 21) * (150 if dtype == np.uint16 else 1)).astype(dtype)
    suffix = "tif" if dtype == np.float32 else "png"
    cv2.imwrite(str(tmp_path / f"grey.{suffix}"), image)
    assert np.array_equal(read_grey(tmp_path / f"grey.{suffix}"), image)
    if dtype == np.float32:
        return
    same = np.dstack([image] * 4)
    cv2.imwrite(str(tmp_path / "same.png"), same)
    assert read_grey(tmp_path / "same.png").dtype == dtype
    colour = np.dstack([image, image // 2, image // 3])
    cv2.imwrite(str(tmp_path / "colour.png"), colour)
    want = colour @ np.array([0.0722, 0.7152, 0.2126])
    assert np.abs(read_grey(tmp_path / "colour.png") - want).max() <= 1e-2


def test_a_table_needs_a_known_suffix(tmp_path: Path) -> None:
    image = speckles(57, 33)
    result = dic(image, image, subset=15, step=6)
    with pytest.raises(InputError, match="xlsx"):
        write_correlation(tmp_path / "table.xlsx", result, strain(result))


def test_pages_of_a_stack_are_named_or_all_taken(cli: Run, tmp_path: Path) -> None:
    pages = [
        np.rint(speckles(**SIZE, shift=(2.0 * (k == 1), 0.0))).astype(np.uint8) for k in range(3)
    ]
    stack = tmp_path / "stack.tif"
    with tifffile.TiffWriter(stack) as tiff:
        for page in pages:
            tiff.write(page)
        tiff.write(pages[0][::2, ::2].copy(), subfiletype=1)  # a preview is no page
    with pytest.raises(InputError, match=r"3 pages.*stack\.tif#1"):
        read_grey(stack)
    assert np.array_equal(read_grey(f"{stack}#2"), pages[1])
    with pytest.raises(InputError, match="page 4; expected 1 to 3"):
        read_grey(f"{stack}#4")
    assert [page.name for page in pages_of(stack)] == ["stack.tif#1", "stack.tif#2", "stack.tif#3"]

    common = ("-o", tmp_path / "out", "--backend", "numpy", "--step", 20)
    refused = cli("dic", stack, stack, *common)
    assert refused.exit_code == 2 and "3 pages" in " ".join(refused.output.split())
    done = cli("dic", f"{stack}#1", stack, *common, "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["images"]
    assert [Path(row["image"]).name for row in rows] == [
        "stack.tif#1",
        "stack.tif#2",
        "stack.tif#3",
    ]
    assert [round(row["u_mean"], 2) for row in rows] == [0.0, 2.0, 0.0]


def test_settings_are_advised_and_why_is_a_page(cli: Run, tmp_path: Path) -> None:
    for number in range(2):
        noise = np.random.default_rng(number).normal(size=(140, 150))
        picture = np.clip(np.rint(speckles(150, 140) + 3.0 * noise), 0, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"still {number}.png"), picture)
    first, second, out = tmp_path / "still 0.png", tmp_path / "still 1.png", tmp_path / "out"
    options = ("--advise", "--detail-px", 60, "--backend", "numpy", "--roi", "2,3,140,135")
    done = cli("dic", first, second, "-o", out, *options, "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report == json.loads((out / "report.json").read_text())
    settings = report["settings"]
    command = f"gpusim dic '{first}' DEF... -o OUT --roi 2,3,140,135 --subset {settings['subset']}"
    assert report["command"].startswith(command)
    assert report["pattern"]["noise"] == pytest.approx(3.0, rel=0.1)
    assert report["chosen"]["strain"]["total"] > 0
    noise = [one["strain"]["noise"] for one in report["table"]]
    assert noise == sorted(noise, reverse=True)
    page = (out / "report.html").read_text()
    assert report["reason"].split(" by ")[0] in page
    assert "--strain-window" in page
    # what is advised can be used
    words = report["command"].split(" --subset")[1].split()
    again = cli("dic", first, second, "-o", tmp_path / "dic", "--subset", *words,
                "--backend", "numpy")  # fmt: skip
    assert again.exit_code == 0, again.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("ref.png",), "DEF...: missing"),
        (("ref.png", "one.tif"), "--output: missing"),
        (("ref.png", "one.tif", "two.png", "--advise"), "--advise; got 2 stills"),
        (("ref.png", "--advise", "--noise", "-1"), "noise; got -1.0"),
    ],
)
def test_missing_arguments_name_the_way_out(
    cli: Run, pictures: Path, words: tuple[str, ...], message: str
) -> None:
    done = cli("dic", *(pictures / word if "." in word else word for word in words))
    assert done.exit_code == 2
    assert message in done.output
