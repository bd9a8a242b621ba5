"""Photron's recordings: headers of both kinds, packed and shifted pixels, series of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from tests.support.cine_bytes import packed

RNG = np.random.default_rng(7)
CODES = RNG.integers(0, 4096, (4, 9, 6)).astype(np.uint16)
COLOR = RNG.integers(0, 256, (4, 9, 6, 3)).astype(np.uint8)
XML = """<cih><recordInfo><recordRate>2000</recordRate></recordInfo><frameInfo>
<totalFrame>4</totalFrame><startFrame>-1</startFrame><skipFrame>2</skipFrame></frameInfo>
<imageDataInfo><resolution><width>6</width><height>9</height></resolution><colorInfo>
<type>Mono</type><bit>16</bit></colorInfo><effectiveBit><depth>12</depth><side>Lower</side>
</effectiveBit></imageDataInfo><imageFileInfo><fileFormat>MRaw</fileFormat></imageFileInfo></cih>"""


def header(**changes: Any) -> str:
    """A .cih; "_" in a name stands for a blank."""
    entries: dict[str, Any] = {
        "Date": "2026/11/28", "Record Rate(fps)": 2000, "Total Frame": 4, "Start Frame": -1,
        "Save Step": 2, "Image Width": 6, "Image Height": 9, "Color Type": "Mono",
        "Color Bit": 16, "File Format": "MRaw", "EffectiveBit Depth": 12,
        "EffectiveBit Side": "Lower", "File Name": "../../etc/passwd",
    }  # fmt: skip
    entries |= {name.replace("_", " "): value for name, value in changes.items()}
    lines = [f"{key} : {value}" for key, value in entries.items() if value is not None]
    return "\n".join(["#Camera Information Header", *lines])


def recording(folder: Path, data: bytes, text: str, suffix: str = ".cih") -> Path:
    (folder / "shot.mraw").write_bytes(data)
    path = folder / f"shot{suffix}"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    ("frames", "data", "text"),
    [
        (CODES, CODES.tobytes(), header()),
        (CODES, (CODES << 4).tobytes(), header(EffectiveBit_Side="Higher")),
        (CODES, b"".join(packed(one, 12) for one in CODES), header(Color_Bit=12)),
        (CODES >> 4, (CODES >> 4).astype(np.uint8).tobytes(), header(Color_Bit=8)),
        (COLOR, COLOR.tobytes(), header(Color_Bit=24, Color_Type="Color")),
        (CODES, CODES.tobytes(), "\x00\x01" + XML + "\x02"),
    ],
    ids=["lower", "higher", "packed", "bytes", "color", "cihx"],
)
def test_frames_and_times_are_as_the_camera_has_them(
    frames: Any, data: bytes, text: str, tmp_path: Path
) -> None:
    path = recording(tmp_path, data, text, ".cihx" if "<cih>" in text else ".cih")
    for each in (path, path.with_suffix(".mraw")):
        video = gs.read_video(each)
        np.testing.assert_array_equal(list(video), frames)
        np.testing.assert_array_equal(video.times, [-0.0005, 0.0005, 0.0015, 0.0025])
        assert video.notes == () and not video.times_guessed


def test_pictures_are_found_by_the_name_of_the_header(tmp_path: Path) -> None:
    path = recording(tmp_path, b"", header(File_Format="PNG", EffectiveBit_Side="Higher"))
    for number, image in enumerate(CODES):
        gs.export.write_image(tmp_path / f"shot{number + 1:06d}.png", image << 4)
    gs.export.write_image(tmp_path / "shot_of_others.png", CODES[0])
    np.testing.assert_array_equal(list(gs.read_video(path)), CODES)


def test_of_a_cut_file_the_whole_frames_are_there(tmp_path: Path) -> None:
    video = gs.read_video(recording(tmp_path, CODES.tobytes()[:-1], header()))
    np.testing.assert_array_equal(list(video), CODES[:3])
    assert "is cut off: 3 frames of 4" in video.notes[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Total_Frame": 10**9}, None),
        ({"Total_Frame": 0}, "Total Frame; got 0; expected 1 to"),
        ({"Image_Width": 65535, "Image_Height": 65535}, "65535 x 65535 px"),
        ({"Image_Width": 6000}, "no whole frame of 4"),
        ({"Image_Height": "tall"}, "Image Height; got 'tall'; expected 1 to 65535"),
        ({"Image_Height": None}, "Image Height; got None"),
        ({"Record_Rate(fps)": "nan"}, r"Record Rate\(fps\); got nan"),
        ({"Color_Bit": 14}, "14 bits of 1 channels"),
        ({"File_Format": "AVI"}, "frames as 'avi'"),
        ({"Save_Step": -1}, "Save Step; got -1"),
    ],
)
def test_headers_that_lie_are_refused(
    change: dict[str, Any], message: str | None, tmp_path: Path
) -> None:
    path = recording(tmp_path, CODES.tobytes(), header(**change))
    if message is None:
        assert gs.read_video(path).notes == (f"{path}: is cut off: 4 frames of 1000000000",)
        return
    with pytest.raises(InputError, match=message):
        gs.read_video(path)


@pytest.mark.parametrize("text", ["<cih><a>", "<cih><!DOCTYPE a></cih>", ""])
def test_an_xml_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a header of Photron's"):
        gs.read_video(recording(tmp_path, b"1234", text, ".cihx"))


def test_what_lacks_beside_it_is_named(tmp_path: Path) -> None:
    path = recording(tmp_path, b"", header())
    path.unlink()
    with pytest.raises(InputError, match="not found; expected a header"):
        gs.read_video(tmp_path / "shot.mraw")
