"""Triangles set up on the device say what the host's float64 says; vertices are shared rightly."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device, twin_checks
from gpusim.gpu.texture_array import TexelPool, Texels
from gpusim.optics.geometry.triangle_corners import NORMAL, ST
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.scene_buffers import TriangleRecords
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import small_triangles
from gpusim.optics.shading.triangle_records import triangle_records
from gpusim.optics.visibility_buffer import VertexBuffers
from gpusim.twin_checks.images import evaluated

LIGHTS = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]


def sheet(
    columns: int, rows: int, paint: object, offset: float = 0.0, **more: object
) -> gs.Surface:
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, columns + 1), np.linspace(-0.2, 0.21, rows + 1))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    points = flat + np.array([0.0, 1.0, 0.0]) * (0.01 * np.sin(9.0 * x + 4.0 * z)).reshape(-1, 1)
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(
        points, faces.reshape(-1, 4), paint, reference=flat + np.array([offset, 0.0, 0.0]), **more
    )  # type: ignore[arg-type]


def camera(**more: object) -> gs.Camera:
    return gs.Camera.from_lens((36, 24), 46, (361, 242), (0.1, -1.1, 0.07), (0, 0, 0.01), **more)  # type: ignore[arg-type]


def records(device: Device, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    made = TriangleRecords.of(device, setup, VertexBuffers(device, setup.view, "records"))
    assert made is not None
    with device.recording("test") as recording:
        made.make(recording)
    return evaluated(setup, made.texels.read().reshape(-1, 28)[: setup.view.count])


@pytest.mark.parametrize(
    "paint",
    [gs.paint.Checker(0.061), gs.paint.Speckle(0.02, 0.5, 0.004, seed=1),
     gs.paint.Plain(0.4, roughness=0.3, metallic=0.8)],
    ids=["board", "speckle", "steel"],
)  # fmt: skip
@pytest.mark.parametrize("lens", [None, [0.05, -0.02, 1e-3, -2e-3]])
def test_records_are_those_of_the_host(
    device: Device, paint: object, lens: list[float] | None
) -> None:
    surface = sheet(60, 40, paint)
    view = look([surface], camera(distortion=lens), lit=True)
    assert small_triangles(view)
    setup = Setup.build(view, LIGHTS, 0.0, [surface])
    got, want = records(device, setup), evaluated(setup, triangle_records(setup))
    np.testing.assert_allclose(got[0], want[0], rtol=2e-7)
    np.testing.assert_allclose(got[1], want[1], rtol=2e-5, atol=2e-6)


def test_slivers_far_from_the_origins_of_image_and_paint(device: Device) -> None:
    """A thousand times as long as wide, seen from afar: what the host finds in float64, to 3e-4 of
    the pixel's size in paint coordinates."""
    surface = sheet(5, 3000, gs.paint.Checker(0.003), offset=40.0)
    K = np.array([[3.1e5, 0.0, 5400.3], [0.0, 3.1e5, 3300.7], [0.0, 0.0, 1.0]])
    pose = gs.Camera.from_lens((36, 24), 46, (361, 242), (90.0, -1000.0, 0.0), (0, 0, 0))
    viewer = gs.Camera(5616, 3744, K, camera_from_world=pose.camera_from_world)
    view = look([surface], viewer, lit=True)
    sides = view.screen[:, [1, 2, 0]] - view.screen
    assert np.abs(view.screen).max() > 3000.0
    length = np.linalg.norm(sides, axis=2).max(axis=1)
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    assert np.median(area / length) < 0.05 and np.median(length) > 20.0
    setup = Setup.build(view, LIGHTS, 0.0, [surface])
    got, want = records(device, setup)[1], evaluated(setup, triangle_records(setup))[1]
    pixel = 1000.0 / 3.1e5
    assert np.abs(got[..., 3:5] - want[..., 3:5]).max() < 3e-4 * pixel
    assert np.abs(got[..., 5:9] - want[..., 5:9]).max() < 1e-3 * pixel
    np.testing.assert_allclose(got[..., 9:12], want[..., 9:12], atol=1e-5)


@pytest.mark.parametrize("word", [0, 2, 6, 8, 11])
def test_one_corrupted_vertex_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, word: int
) -> None:
    write = Texels.write

    def corrupted(self: Texels, array: np.ndarray, first: int = 0) -> None:
        if self.label == "records.vertices":
            array = array.copy().reshape(-1, 12)
            real = array.view(np.float32)
            if word:
                real[0, word] += 0.01
            else:
                array[0, 0] += 65536
            array = array.reshape(-1, 4)
        write(self, array, first)

    twin_checks()["optics/shading/triangle_records"](device)
    monkeypatch.setattr(Texels, "write", corrupted)
    with pytest.raises(TwinMismatch, match="optics/shading/triangle_records"):
        twin_checks()["optics/shading/triangle_records"](device)


def test_numbers_beyond_float32_are_left_to_the_host(device: Device) -> None:
    surface = sheet(60, 40, gs.paint.Plain(0.4))
    setup = Setup.build(look([surface], camera(), lit=True), LIGHTS, 0.0, [surface])
    setup.view.vertices[7, NORMAL] = 1e39
    with np.errstate(over="ignore"):
        assert (
            TriangleRecords.of(device, setup, VertexBuffers(device, setup.view, "records")) is None
        )


def test_corners_that_differ_have_vertices_of_their_own() -> None:
    """Two paints with different frames, and a sheet that is looked at from both sides."""
    plain = look([sheet(6, 4, gs.paint.Plain(0.4))], camera(), lit=True)
    assert len(plain.place) == 7 * 5 and plain.count == 2 * 6 * 4
    one = sheet(6, 4, gs.paint.Checker(0.061))
    frame = one.paint_frame(0)
    other = gs.PaintFrame(frame.origin + 0.017, frame.t_axis, frame.s_axis)
    region = (np.arange(24) % 6 >= 2).astype(np.int32)
    both = sheet(
        6, 4, {"a": gs.paint.Checker(0.061), "b": gs.paint.Checker(0.03)},
        region=region, frames={"a": frame, "b": other},
    )  # fmt: skip
    view = look([both], camera(), lit=True)
    # the vertices along the border are there twice
    assert len(view.place) == 7 * 5 + 5 * 5
    for number, own in ((0, frame), (1, other)):
        rows = np.flatnonzero(view.paint == number)
        rest = view.corners[rows][:, :, 8:]
        np.testing.assert_allclose(view.corners_of(rows, ST), own.coordinates(rest), atol=1e-15)
    back = gs.Camera.from_lens((36, 24), 46, (361, 242), (0.1, 1.1, 0.07), (0, 0, 0.01))
    np.testing.assert_allclose(
        look([one], back, lit=True).vertices[:, NORMAL].mean(axis=0),
        -look([one], camera(), lit=True).vertices[:, NORMAL].mean(axis=0), atol=1e-12,
    )  # fmt: skip


def test_texels_serve_one_frame_after_the_other(device: Device) -> None:
    kept = TexelPool(device)
    first = kept.texels(30_000, "rgba32uint", "some")
    assert kept.texels(20_000, "rgba32uint", "some") is first
    assert kept.texels(30_001, "rgba32uint", "some") is not first
    assert kept.texels(1_000, "rgba32uint", "some").count == 1_000
    assert kept.texels(30_000, "rgba32uint", "other") is not first


@pytest.mark.parametrize("lens", [None, [0.05, -0.02, 1e-3, -2e-3]])
@pytest.mark.parametrize("inside", [False, True])
def test_triangles_that_are_not_cut_share_their_vertices(
    device: Device, monkeypatch: pytest.MonkeyPatch, lens: list[float] | None, inside: bool
) -> None:
    """The picture is that of triangles which all went through `split`; also where some of them are
    behind the camera."""
    eye, target = (0.1, -1.1, 0.07), (0.0, 0.0, 0.01)
    if inside:
        eye, target = (-0.1, -0.08, 0.02), (0.4, 0.02, 0.0)
    viewer = gs.Camera.from_lens((36, 24), 46, (1205, 804), eye, target, distortion=lens)
    surface = sheet(150, 100, gs.paint.Checker(0.031))
    view = look([surface], viewer, lit=True)
    assert view.count > 3000 and len(view.place) < 2.5 * view.count
    got = gs.render([surface], viewer, LIGHTS, device=device)
    monkeypatch.setattr("gpusim.optics.geometry.view.MIN_TRIANGLES_FOR_SHARING", 10**9)
    want = gs.render([surface], viewer, LIGHTS, device=device)
    if lens is not None or inside:
        assert len(want.view.place) == 3 * want.view.count
    assert want.view.count == view.count
    # float32 on squares of up to several hundred pixels
    most = want.radiance.max()
    assert np.abs(got.radiance - want.radiance).max() <= 1e-3 * most
    assert np.sqrt(np.mean((got.radiance - want.radiance) ** 2)) <= 1e-5 * most
