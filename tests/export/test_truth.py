"""truth.h5: values, fill, attributes, sparse storage, atomicity."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import h5py
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export.layers import LAYERS
from gpusim.export.truth import TruthWriter

H, W = 333, 570  # 2 x 3 chunks, none of the last ones full


def opened(path: Path) -> TruthWriter:
    return TruthWriter(path, regions=["steel", "beam"], attributes={"version": "0.1.0"})


def camera(truth: TruthWriter, name: str = "front") -> None:
    truth.write_camera(
        name,
        width=W,
        height=H,
        K=np.array([[900.0, 0.0, 284.5], [0.0, 901.0, 166.0], [0.0, 0.0, 1.0]]),
        camera_from_world=np.eye(4)[:3] + 0.25,
        distortion=[0.1, -0.2],
    )


def test_blocks_and_pixels_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    depth = np.full((H, W), np.nan, np.float32)
    block = rng.random((200, 300), np.float32)
    depth[100:300, 90:390] = block
    rows, cols = rng.integers(0, 150, 400), rng.integers(0, W, 400)
    spots = rng.random(400, np.float32)
    depth[rows, cols] = spots
    with opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        frame = truth.frame("front", 1, load_factor=0.5)
        frame.write_block("depth", 100, 90, block)
        frame.write_sparse("depth", rows, cols, spots)
        frame.write_block("displacement", 0, 0, np.broadcast_to(np.float32([1, 2, 3]), (2, 4, 3)))
        frame.write_sparse("region", np.array([332]), np.array([569]), np.array([1]))
    with h5py.File(tmp_path / "truth.h5") as file:
        group = file["camera/front/frame/0001"]
        assert group.attrs["load_factor"] == 0.5
        assert np.array_equal(group["depth"][:], depth, equal_nan=True)
        assert group["depth"].dtype == np.float32
        assert np.array_equal(group["displacement"][1, 3], [1.0, 2.0, 3.0])
        assert np.isnan(group["displacement"][2:]).all()
        region = group["region"][:]
        assert region[332, 569] == 1 and (region.ravel()[:-1] == -1).all()
        for name in ("depth", "displacement", "region"):
            layer, data = LAYERS[name], group[name]
            attributes = {key: data.attrs[key] for key in ("unit", "frame", "convention")}
            assert attributes == {
                "unit": layer.unit,
                "frame": layer.frame,
                "convention": layer.convention,
            }


def test_only_chunks_with_data_are_stored(tmp_path: Path) -> None:
    with opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        frame = truth.frame("front", 0)
        values = np.full((H, W), np.nan, np.float32)
        values[300, 5] = 2.5
        frame.write_block("depth", 0, 0, values)
        frame.write_sparse("element", np.array([1, 2]), np.array([3, 300]), np.array([8, 9]))
        frame.write_block("normal", 0, 0, np.full((H, W, 3), np.nan))
    with h5py.File(tmp_path / "truth.h5") as file:
        group = file["camera/front/frame/0000"]
        assert group["depth"].id.get_num_chunks() == 1
        assert group["element"].id.get_num_chunks() == 2
        assert group["normal"].id.get_num_chunks() == 0
        assert group["depth"].chunks == (256, 256)
        assert group["normal"].chunks == (256, 256, 3)
        assert group["depth"].compression == "gzip" and group["depth"].shuffle
        assert group["depth"][300, 5] == 2.5
        assert np.isnan(group["normal"][:]).all()


def test_a_frame_smaller_than_a_chunk(tmp_path: Path) -> None:
    depth = np.arange(40.0 * 300, dtype=np.float32).reshape(40, 300)
    with opened(tmp_path / "truth.h5") as truth:
        truth.write_camera("low", width=300, height=40, K=np.eye(3), camera_from_world=np.eye(4))
        frame = truth.frame("low", 0, load_factor=0.0)
        frame.write_block("depth", 0, 0, depth)
        frame.write_sparse("displacement", np.array([39]), np.array([299]), np.ones((1, 3)))
    with h5py.File(tmp_path / "truth.h5") as file:
        group = file["camera/low/frame/0000"]
        assert np.array_equal(group["depth"][:], depth)
        assert np.array_equal(group["displacement"][39, 299], [1.0, 1.0, 1.0])
        assert np.isnan(group["displacement"][:39]).all()


def test_later_writes_win_and_can_erase(tmp_path: Path) -> None:
    with opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        frame = truth.frame("front", 0)
        frame.write_block("depth", 0, 0, np.ones((H, W), np.float32))
        frame.write_block("depth", 250, 250, np.full((20, 20), np.nan, np.float32))
        twice = np.array([7, 7])
        frame.write_sparse("depth", twice, twice, np.array([4.0, 5.0]))
    with h5py.File(tmp_path / "truth.h5") as file:
        depth = file["camera/front/frame/0000/depth"][:]
    assert np.isnan(depth[250:270, 250:270]).all()
    assert np.isnan(depth).sum() == 400
    assert depth[7, 7] == 5.0 and depth[7, 8] == 1.0


def test_the_last_value_of_a_pixel_wins(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    rows, cols = rng.integers(0, 2, 20_000), rng.integers(0, 2, 20_000) * 300
    values = np.arange(20_000)
    expected = {(int(r), int(c)): int(v) for r, c, v in zip(rows, cols, values, strict=True)}
    with opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        truth.frame("front", 0).write_sparse("element", rows, cols, values)
    with h5py.File(tmp_path / "truth.h5") as file:
        element = file["camera/front/frame/0000/element"][:]
    assert {(int(r), int(c)): int(element[r, c]) for r, c in np.argwhere(element != -1)} == expected


def test_mesh_nodes_cameras_and_file_attributes(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    points = rng.random((3000, 3))
    u = rng.random((3000, 3)) * 1e-9
    with opened(tmp_path / "truth.h5") as truth:
        truth.write_mesh(points, {"hex8": np.arange(16).reshape(2, 8)})
        truth.write_nodal_displacement(2, u, load_factor=1.0)
        camera(truth, "front left")
    with h5py.File(tmp_path / "truth.h5") as file:
        assert file.attrs["schema"] == 1 and file.attrs["version"] == "0.1.0"
        assert list(file.attrs["regions"]) == ["steel", "beam"]
        assert np.array_equal(file["mesh/points"][:], points)
        assert np.array_equal(file["mesh/cells/hex8"][:], np.arange(16).reshape(2, 8))
        nodal = file["mesh/displacement/0002"]
        assert np.array_equal(nodal[:], u)  # float64, bit for bit
        assert nodal.attrs["convention"] == "Lagrangian" and nodal.attrs["unit"] == "m"
        group = file["camera/front_left"]
        assert (group.attrs["width"], group.attrs["height"]) == (W, H)
        assert group["camera_from_world"].shape == (4, 4)
        assert group["camera_from_world"][3].tolist() == [0.0, 0.0, 0.0, 1.0]
        assert group["camera_from_world"][0].tolist() == [1.25, 0.25, 0.25, 0.25]
        assert group["K"][1].tolist() == [0.0, 901.0, 166.0]
        assert group["distortion"][:].tolist() == [0.1, -0.2]


def test_the_table_of_layers_is_complete() -> None:
    for name, layer in LAYERS.items():
        assert layer.name == name and layer.text and layer.unit and layer.frame
        assert layer.convention in ("Eulerian", "Lagrangian")
        assert np.isnan(layer.fill) if layer.dtype.startswith("f") else layer.fill == -1


def test_a_full_disk_is_reported_and_leaves_no_file(tmp_path: Path) -> None:
    """A file size limit stands for the full disk, of which HDF5 can die."""
    code = """
        import resource, sys
        import numpy as np
        from gpusim.errors import GpusimError
        from gpusim.export import TruthWriter
        values = np.random.default_rng(1).random((300, 400))
        for limit in (1_000_000, 200_000, 20_000, 10_000, 4_096, 1_000, 100, 0):
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, -1))
            try:
                with TruthWriter(sys.argv[1]) as truth:
                    truth.write_mesh(values.reshape(-1, 3), {})
                    truth.write_camera("a", width=400, height=300, K=np.eye(3),
                                       camera_from_world=np.eye(4)[:3])
                    for number in range(20):
                        truth.frame("a", number).write_block("depth", 0, 0, values)
            except GpusimError as error:
                print(error)
    """
    command = [sys.executable, "-c", textwrap.dedent(code), str(tmp_path / "truth.h5")]
    child = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert child.returncode == 0 and child.stderr == ""
    assert child.stdout.count("truth.h5: the disk is full or over quota") == 8
    assert list(tmp_path.iterdir()) == []


def test_an_error_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="boom"), opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        raise RuntimeError("boom")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="it is closed"):
        truth.frame("front", 0)


@pytest.mark.parametrize(
    ("layer", "arguments", "message"),
    [
        ("dept", (0, 0, np.zeros((2, 2))), "got 'dept'; expected one of reference"),
        ("depth", (0, 0, np.zeros((2, 2, 3))), r"expected \(h, w\)"),
        ("normal", (0, 0, np.zeros((2, 2, 2))), r"expected \(h, w, 3\)"),
        ("depth", (H - 1, 0, np.zeros((2, 2))), "expected inside 333 x 570"),
        ("depth", (-1, 0, np.zeros((2, 2))), r"rows -1\.\.0, columns 0\.\.1"),
        ("depth", (0, 0, np.full((2, 2), 1e39)), "float32 can't hold"),
        ("region", (0, 0, np.full((2, 2), 0.5)), "int32 can't hold"),
        ("region", (0, 0, np.full((2, 2), np.nan)), "int32 can't hold"),
        ("visibility", (0, 0, np.full((2, 2), 300)), "int8 can't hold"),
    ],
)
def test_bad_blocks_are_refused(
    tmp_path: Path, layer: str, arguments: tuple[int, int, np.ndarray], message: str
) -> None:
    with opened(tmp_path / "truth.h5") as truth:
        camera(truth)
        with pytest.raises(InputError, match=message):
            truth.frame("front", 0).write_block(layer, *arguments)


def test_bad_pixels_and_orders_are_refused(tmp_path: Path) -> None:
    one = np.array([1])
    with opened(tmp_path / "truth.h5") as truth:
        with pytest.raises(InputError, match="expected write_camera before"):
            truth.frame("front", 0)
        with pytest.raises(InputError, match="expected write_mesh before"):
            truth.write_nodal_displacement(0, np.zeros((1, 3)))
        truth.write_mesh(np.zeros((4, 3)), {})
        with pytest.raises(InputError, match=r"displacement: got shape \(5, 3\)"):
            truth.write_nodal_displacement(0, np.zeros((5, 3)))
        with pytest.raises(InputError, match="expected finite"):
            truth.write_nodal_displacement(0, np.full((4, 3), np.nan))
        camera(truth)
        frame = truth.frame("front", 0)
        with pytest.raises(InputError, match=r"columns 570\.\.570"):
            frame.write_sparse("depth", one, np.array([W]), np.array([1.0]))
        with pytest.raises(InputError, match="expected integer pixels"):
            frame.write_sparse("depth", one * 1.0, one, np.array([1.0]))
        with pytest.raises(InputError, match=r"expected \(M,\), \(M,\), \(M, 3\)"):
            frame.write_sparse("normal", one, one, np.array([1.0]))
        with pytest.raises(InputError, match="got -1; expected 0 or more"):
            truth.frame("front", -1)


def test_the_reference_keeps_its_digits_far_from_zero(tmp_path: Path) -> None:
    """Coordinates of a survey: float32 would go in steps of half a metre."""
    place = np.array([500000.123456, 5200000.654321, 300.5])
    with TruthWriter(tmp_path / "truth.h5") as file:
        file.write_camera("a", width=4, height=3, K=np.eye(3), camera_from_world=np.eye(4))
        frame = file.frame("a", 0)
        frame.write_sparse("reference", np.array([1]), np.array([2]), place[None])
    with h5py.File(tmp_path / "truth.h5") as file:
        layer = file["camera/a/frame/0000/reference"]
        assert layer.dtype == np.float64 and layer.attrs["unit"] == "m"
        assert np.array_equal(layer[1, 2], place)
