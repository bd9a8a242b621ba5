"""Kernels against their twins: the checks pass, and see one corrupted value; determinism."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device, twin_checks
from gpusim.gpu.buffer import Buffer
from gpusim.optics.edge_pixels import resolve
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.sensor import digital_numbers, sensor
from gpusim.optics.shading import scene_buffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.triangle_records import TRIANGLE, record_blocks
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.twin_checks.scenes import probe_setup

STAGES = [
    "optics/edge_pixels/resolve",
    "optics/sensor/sensor",
    "optics/shading/forward_pass",
    "optics/raster/id_buffer",
]
SAMPLED = ["optics/shading/relighting", "optics/shadow/penumbra_mask"]
"""Their results may differ by samples of a lamp."""


@pytest.mark.parametrize("stage", [*STAGES, *SAMPLED])
def test_stages_agree_with_their_twins(device: Device, stage: str) -> None:
    twin_checks()[stage](device)


@pytest.mark.parametrize(
    ("stage", "value"),
    [
        *((stage, "one step") for stage in STAGES),
        *(
            (stage, "nan")
            for stage in ("optics/edge_pixels/resolve", "optics/shading/forward_pass", *SAMPLED)
        ),
    ],
)
def test_one_corrupted_value_of_a_result_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, stage: str, value: str
) -> None:
    """One value that the stage's check reads back is changed, or made NaN."""
    read = Buffer.read
    inside = visibility_twin(probe_setup().view) > 0
    inside.reshape(-1)[find_edge_pixels(probe_setup().view).pixel] = False
    row, column = np.argwhere(inside)[200]

    def corrupted(self: Buffer, dtype: Any, *args: Any, **kwargs: Any) -> Any:
        array = np.array(read(self, dtype, *args, **kwargs))
        at = int(np.argmax(array))
        if (
            stage == "optics/shading/forward_pass"
        ):  # a pixel that no edge crosses: the others aren't its own
            at = row * array.shape[1] + column
        if array.dtype.kind == "f":
            array.flat[at] = np.nan if value == "nan" else array.flat[at] + 1e-3
        else:
            array.flat[at] -= 1
        return array

    monkeypatch.setattr(Buffer, "read", corrupted)
    with pytest.raises(TwinMismatch, match=stage):
        twin_checks()[stage](device)


def _triangle(stage: str) -> int:
    """A triangle that the stage's probe shows."""
    view = probe_setup().view
    return int(np.bincount(visibility_twin(view)[visibility_twin(view) > 0])
               .argmax()) - 1  # fmt: skip


@pytest.mark.parametrize("stage", ["optics/shading/forward_pass", "optics/edge_pixels/resolve"])
@pytest.mark.parametrize(
    "change",
    [
        lambda r: r["st"].__setitem__(0, r["st"][0] + 0.01),
        lambda r: r["n0"].__setitem__(3, np.nan),
        lambda r: r["n0"].__setitem__(0, r["n0"][0] + 0.05),
        lambda r: r["nx"].__setitem__(3, 1.01 * r["nx"][3]),
    ],
    ids=["paint position", "NaN in a record", "normal", "depth"],
)
def test_one_corrupted_input_of_a_kernel_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, stage: str, change: Callable[[Any], None]
) -> None:
    number = _triangle(stage)

    def corrupted(setup: Setup) -> Iterator[tuple[int, np.ndarray]]:
        (found,) = record_blocks(setup)
        result = found[1].view(TRIANGLE)[:, 0]
        # the triangle with most pixels may have a plain rim: edges see all of them moved
        for record in (
            result if stage == "optics/edge_pixels/resolve" else result[number : number + 1]
        ):
            change(record)
        yield found

    monkeypatch.setattr(scene_buffers, "record_blocks", corrupted)
    with pytest.raises(TwinMismatch, match=stage):
        twin_checks()[stage](device)


def test_a_moved_vertex_is_seen_by_visibility(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = Device.buffer

    def corrupted(self: Device, array: np.ndarray, label: str) -> Buffer:
        if label == "visibility.screen":
            array = array.copy()
            array[0] += 2 * 65536
        return buffer(self, array, label)

    monkeypatch.setattr(Device, "buffer", corrupted)
    with pytest.raises(TwinMismatch, match="optics/raster/id_buffer"):
        twin_checks()["optics/raster/id_buffer"](device)


def test_a_wrong_scale_is_seen_by_the_sensor(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sensor.Sensor, "scale", property(lambda s: np.float32((2**s.bits - 1) / s.full_scale))
    )
    twin_checks()["optics/sensor/sensor"](device)
    twin = digital_numbers.scaled_twin

    def other(s: sensor.Sensor, radiance: np.ndarray) -> np.ndarray:
        return twin(sensor.Sensor(s.bits, 1.001 * s.full_scale), radiance)

    monkeypatch.setattr(import_module("gpusim.twin_checks.images"), "scaled_twin", other)
    with pytest.raises(TwinMismatch, match="optics/sensor/sensor"):
        twin_checks()["optics/sensor/sensor"](device)


def scene() -> tuple[list[gs.Surface], gs.Camera, list[Any]]:
    rng = np.random.default_rng(12)
    points = rng.uniform([-0.5, -0.3, -0.4], [0.5, 0.6, 0.4], (24, 3))
    loose = gs.Surface(points, np.arange(24).reshape(8, 3), paint=gs.paint.Plain(0.3))
    board = gs.Surface(
        np.array([[-0.6, 0.2, -0.3], [0.5, 0.1, -0.3], [0.5, 0.1, 0.4], [-0.6, 0.2, 0.4]]),
        np.array([[0, 1, 2, 3]]),
        paint=gs.paint.Dots(0.03, 0.06),
    )
    camera = gs.Camera.from_lens((36, 24), 30, (91, 67), (0.2, -1.1, 0.1), (0, 0, 0))
    lights = [gs.PointLight((1.0, -2.0, 1.0), 40.0),
              gs.AreaLight((-1, -2, 0.5), (0, 0, 0), (0.3, 0.4), 30.0)]  # fmt: skip
    return [board, loose], camera, lights


def test_two_renders_are_equal_bit_for_bit(device: Device) -> None:
    surfaces, camera, lights = scene()
    images = [gs.render(surfaces, camera, lights, device=device).radiance for _ in range(2)]
    assert images[0].tobytes() == images[1].tobytes()
    assert len(np.unique(images[0])) > 1000


def test_bands_do_not_show(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows at a time give the bits of the whole image at once, edges and ids included."""
    surfaces, camera, lights = scene()
    whole = gs.render(surfaces, camera, lights, device=device)
    assert len(whole.bands) == 1
    monkeypatch.setattr(import_module("gpusim.optics.rendering.frame_plan"), "BAND_BYTES", 1)
    bands = gs.render(surfaces, camera, lights, device=device)
    # of 32 rows, as tiles under shadows are looked at together
    assert len(bands.bands) == 3
    assert bands.radiance.tobytes() == whole.radiance.tobytes()
    np.testing.assert_array_equal(bands.ids(), whole.ids())
    image = gs.Sensor(8, 2.0).expose(bands)
    np.testing.assert_array_equal(image, gs.Sensor(8, 2.0).expose(whole))


def test_pixels_under_many_triangles_are_resolved_alike_on_host_and_device(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    surfaces, camera, lights = scene()
    on_device = gs.render(surfaces, camera, lights, device=device).radiance
    monkeypatch.setattr(resolve, "MAX_DEPTH", 1)
    on_host = gs.render(surfaces, camera, lights, device=device).radiance
    different = np.abs(on_device - on_host)
    assert (different > 0).sum() > 20 and different.max() < 2e-5 * on_device.max() + 2e-5


def test_the_pipeline_equals_the_twins_everywhere(device: Device) -> None:
    surfaces, camera, lights = scene()
    frame = gs.render(surfaces, camera, lights, device=device)
    twin = gs.render(surfaces, camera, lights, backend="numpy").radiance
    difference = np.abs(frame.radiance - twin) / twin.max()
    print(f"device against twin: worst {difference.max():.1e}")
    assert (difference > 1e-4).sum() <= 1  # in half shadow one sample may go either way
    assert difference.max() < 1.0 / SAMPLES
