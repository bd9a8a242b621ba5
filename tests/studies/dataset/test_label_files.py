"""Flow and layers as files, opened by readers of other people and by readers written here from the
formats' descriptions."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.studies.dataset.label_files import flo_bytes, kitti_bytes, label_bytes
from tests.support.flow_readers import read_flo, read_kitti


def some_flow(shape: tuple[int, int] = (5, 7), reach: float = 20.0) -> Float:
    """Flow with a hole."""
    flow = np.random.default_rng(3).uniform(-reach, reach, (*shape, 2))
    flow[1, 2] = np.nan
    return flow


def test_flo_is_read_as_middlebury_describes_it(tmp_path: Path) -> None:
    flow = some_flow()
    data = flo_bytes(flow)
    assert struct.unpack("<f", data[:4])[0] == 202021.25  # the tag, as a number
    assert len(data) == 12 + 8 * 5 * 7
    np.testing.assert_array_equal(read_flo(data), flow.astype(np.float32))


def test_flo_is_read_by_opencv(tmp_path: Path) -> None:
    flow = some_flow()
    (tmp_path / "a.flo").write_bytes(flo_bytes(flow))
    found = cv2.readOpticalFlow(str(tmp_path / "a.flo"))
    known = np.isfinite(flow)
    assert found.shape == flow.shape
    np.testing.assert_array_equal(found[known], flow[known].astype(np.float32))
    assert (found[~known] > 1e9).all()


def test_kitti_is_within_its_own_steps(tmp_path: Path) -> None:
    flow = some_flow()
    found = read_kitti(kitti_bytes(flow))
    known = np.isfinite(flow)
    np.testing.assert_array_equal(np.isfinite(found), known)
    assert 1e-3 < np.abs(found - flow)[known].max() <= 1.0 / 128.0


def test_kitti_has_no_label_beyond_its_range() -> None:
    flow = np.array([[[511.9, 0.0], [512.0, 0.0], [0.0, -512.0], [0.0, -512.1]]])
    found = np.isfinite(read_kitti(kitti_bytes(flow))).all(axis=2)
    assert found.tolist() == [[True, False, True, False]]


def test_flow_as_tiff_keeps_float32() -> None:
    flow = some_flow()
    ending, data = label_bytes("flow", flow, "tiff")
    wanted = np.dstack([flow, np.isfinite(flow).all(axis=2)]).astype(np.float32)
    assert ending == "tiff"
    np.testing.assert_array_equal(tifffile.imread(io.BytesIO(data)), wanted)
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(found[..., ::-1], wanted)


@pytest.mark.parametrize(
    ("layer", "values"),
    [("depth", np.array([[0.25, np.nan]])), ("normal", np.ones((2, 3, 3)) / 3),
     ("element", np.array([[-1, 2**24 + 1]])), ("visibility", np.array([[-1, 0, 1]]))],
)  # fmt: skip
def test_layers_are_tiffs_of_their_kind(layer: str, values: Float) -> None:
    ending, data = label_bytes(layer, values, "flo")
    kind = np.float32 if values.dtype.kind == "f" else np.int32
    found = tifffile.imread(io.BytesIO(data))
    assert (ending, found.dtype) == ("tiff", kind)
    np.testing.assert_array_equal(found, values.astype(kind))


@pytest.mark.parametrize("write", [flo_bytes, kitti_bytes])
def test_what_is_no_flow_is_refused(write: object) -> None:
    assert callable(write)
    with pytest.raises(InputError, match=r"flow; got shape \(4, 4\); expected \(H, W, 2\)"):
        write(np.zeros((4, 4)))
