"""Accuracy and time of rendered images: ``python -m benchmarks.images [--write]``.

Accuracy is against 64 x 64 float64 rays a pixel (`tests.support.optics_reference`): RMS of the
grey range 0..1, least-squares shift per 48-px block, mean shift (bias). Time is that of the
crane's frames, beside the time that the bytes a frame must move would take at the device's copy
bandwidth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.triangle_records import triangle_records
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop
from tests.support.optics_reference import Plate, difference, pattern, reference

RESULTS = Path(__file__).parent / "results" / "images.md"
BACKGROUND = 0.3


def board(width: int, device: Device) -> list[str]:
    """A tilted board with its edges in view, three paints."""
    height = width * 113 // 193
    camera = gs.Camera.from_lens(
        (36.0, 36.0 * height / width), 30.0, (width, height), (0.13, -0.78, 0.21),
        (0.03, 0.0, 0.02), up=(0.1, 0.0, 1.0),
    )  # fmt: skip
    s_axis = np.array([np.cos(0.15), np.sin(0.15), 0.0])
    lines = [
        f"Board, {width} x {height} px, unlit, against {64 * 64} rays a pixel",
        "",
        "| paint | backend | RMS | worst | shift RMS px | bias x, y px | cold s | warm s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, paint in (
        ("checker", gs.paint.Checker(0.041, origin=(0.013, 0.007))),
        ("9 x 7 patch", gs.paint.Checker(0.047, 9, 7, (0.113, 0.057), ground=0.5)),
        ("dots", gs.paint.Dots(0.021, 0.043, origin=(0.017, 0.009))),
    ):
        plate = Plate(np.array([-0.32, 0.01, -0.24]), s_axis, np.array([0.0, 0, 1]), (0.73, 0.47),
                      pattern(paint))  # fmt: skip
        surface = gs.Surface(plate.corners(), np.array([[0, 1, 2, 3]]), paint=paint)
        want = reference(camera, [plate], BACKGROUND)
        for backend in ("gpu", "numpy"):
            seconds = []
            for _ in range(3):
                start = time.perf_counter()
                frame = gs.render([surface], camera, background=BACKGROUND, device=device,
                                  backend=backend)  # fmt: skip
                image = frame.radiance
                seconds.append(time.perf_counter() - start)
            d = difference(image, want)
            lines.append(
                f"| {name} | {backend} | {d.rms:.1e} | {d.worst:.1e} | {d.shift_rms:.1e} "
                f"| {d.bias[0]:+.1e}, {d.bias[1]:+.1e} | {seconds[0]:.3f} | {min(seconds):.3f} |"
            )
    return lines


def copy_bandwidth(device: Device, nbytes: int = 1 << 26) -> float:
    """Bytes per second of a copy between two buffers (read + written), best of five."""
    source, target = (device.empty(nbytes, f"copy.{name}") for name in ("source", "target"))
    best = np.inf
    for _ in range(5):
        device.sync()
        start = time.perf_counter()
        encoder = device.gpu.create_command_encoder()
        encoder.copy_buffer_to_buffer(source.gpu, 0, target.gpu, 0, nbytes)
        device.submit(encoder.finish(), "copy")
        device.sync()
        best = min(best, time.perf_counter() - start)
    source.release()
    target.release()
    return 2.0 * nbytes / best


def crane(device: Device, repeats: int) -> list[str]:
    """Frames of the crane example, lit and unlit, in parts."""
    scene = gs.load_scene("examples/crane.toml")
    surfaces = [build_body(body).surface for body in scene.bodies]
    surfaces += [build_prop(prop) for prop in scene.props]
    camera = build_camera(scene.cameras[0])
    pixels = camera.width * camera.height
    bandwidth = copy_bandwidth(device)
    lines = [
        f"Crane, {camera.width} x {camera.height} px, {sum(len(s.faces) for s in surfaces)} faces; "
        f"copy bandwidth {bandwidth / 1e9:.1f} GB/s (read + written)",
        "",
        "| | cold s | warm s | host s | device s | sensor s | ns/px | bound ms | achieved |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, lights in (("lit", build_lights(scene)), ("unlit", None)):
        rows = []
        for _ in range(repeats + 1):
            device.sync()
            start = time.perf_counter()
            frame = gs.render(surfaces, camera, lights, device=device)
            device.sync()
            rendered = time.perf_counter()
            gs.Sensor(8, 0.5).expose(frame)
            rows.append((rendered - start, time.perf_counter() - rendered))
            frame.release()
        host = min(_timed(lambda lights=lights: _host(surfaces, camera, lights)) for _ in range(3))
        warm, sensor = np.array(rows[1:]).min(axis=0)
        # radiance and depth written, radiance copied to a buffer, read by the sensor, bytes out
        moved = pixels * (4 + 4 + 8 + 4 + 1)
        bound = moved / bandwidth
        lines.append(
            f"| {name} | {sum(rows[0]):.2f} | {warm + sensor:.2f} | {host:.2f} "
            f"| {max(warm - host, 0.0):.2f} | {sensor:.2f} | {1e9 * (warm + sensor) / pixels:.1f} "
            f"| {1e3 * bound:.0f} | {100 * bound / (warm + sensor):.0f} % |"
        )
    return lines


def _host(
    surfaces: list[gs.Surface], camera: gs.Camera, lights: list[gs.PointLight] | None
) -> None:
    """What `gs.render` does in NumPy before the device starts."""
    view = look(surfaces, camera, lit=lights is not None)
    triangle_records(Setup.build(view, lights, 0.0))
    find_edge_pixels(view)


def _timed(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=386, help="of the board, px")
    parser.add_argument("--repeats", type=int, default=3, help="warm frames of the crane")
    parser.add_argument("--write", action="store_true", help=f"also write {RESULTS.name}")
    arguments = parser.parse_args()
    device = Device()
    lines = ["# Images", "", device.name, ""]
    for part in (board(arguments.width, device), crane(device, arguments.repeats)):
        print("\n".join(part), flush=True)
        print()
        lines += [*part, ""]
    if arguments.write:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
