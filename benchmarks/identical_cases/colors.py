"""What has a colour: paints, lamps, surroundings, pictures by UV, and cameras that see it."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import gpusim as gs
from benchmarks.faces import camera_of, scene_of
from benchmarks.identical_cases.arrays import Arrays, Case, radiance_of
from benchmarks.identical_cases.images import FOCUS, PLACES, tilted
from benchmarks.identical_cases.runs import written

LAMPS = (
    gs.AreaLight((-1.0, -2.0, 1.0), (0.0, 0.0, 0.0), (0.3, 0.2), 50.0, color="#ffb060"),
    gs.PointLight((0.9, -1.7, 0.4), 20.0, color=(0.5, 0.9, 1.6)),
)
BRASS = gs.paint.Plain("#c8a060", 0.4, 1.0)
TEXELS = np.random.default_rng(1).uniform(0.0, 1.0, (37, 53, 3))
PAINTS = {
    "board": gs.paint.Checker(0.067, 9, 7, (0.113, 0.057), (0.05, 0.02, 0.3), "#ffd080", 0.5),
    "markers": gs.paint.Markers(PLACES, 0.09, angle=0.2, dark="#401008", light="#f0f0ff"),
    "speckle": gs.paint.Speckle(0.012, dot="#101040", ground="#f0e0d0", seed=3),
    "bitmap": gs.paint.Image(TEXELS, 0.015, roughness=0.5),
}


def sky() -> gs.EnvironmentLight:
    """Surroundings in colour, which surfaces hide from each other."""
    image = np.random.default_rng(2).uniform(0.1, 2.0, (8, 16, 3))
    return gs.EnvironmentLight(image=image, occlusion=True)


def glossy(backend: str = "gpu") -> Arrays:
    """A bent sheet of brass before a wall of dots, each in the other's shadow, in a coloured room;
    and the same out of focus."""
    surface, behind, _ = scene_of("sheet-soft", 300)
    sheet = gs.Surface(surface.points, surface.faces, BRASS)
    dots = gs.paint.Dots(0.05, 0.11, albedo="#ff2010", ground="#2040c0")
    shown = [sheet, *(gs.Surface(wall.points, wall.faces, dots) for wall in behind)]
    camera = camera_of("sheet-soft", 345 if backend == "gpu" else 61)
    lights = [*LAMPS, sky()]
    behind_all = (0.2, 0.1, 0.05)
    result = {"sharp": gs.render(shown, camera, lights, background=behind_all, backend=backend)}
    if backend == "gpu":
        result["blurred"] = gs.photograph(shown, camera, lights, lens=FOCUS)
    return {name: radiance_of(frame)["radiance"] for name, frame in result.items()}


def painted(name: str) -> Arrays:
    """A coloured paint, as albedo and lit."""
    surface, camera = tilted(PAINTS[name])
    frames = {"albedo": gs.render([surface], camera, background=(0.3, 0.2, 0.1)),
              "lit": gs.render([surface], camera, [*LAMPS, gs.AmbientLight(0.4)])}  # fmt: skip
    return {key: radiance_of(frame)["radiance"] for key, frame in frames.items()}


def exposed(backend: str = "gpu") -> Arrays:
    """Grey levels and colours of one frame by every kind of sensor."""
    surface, camera = tilted(PAINTS["board"])
    frame = gs.render([surface], camera, LAMPS, backend=backend)
    mono = gs.Sensor.auto_exposed(frame, 12)
    noise: dict[str, Any] = {"full_well": 9000.0, "read_noise": 4.0, "prnu": 0.01}
    one = partial(gs.Sensor, 8, mono.full_scale, gamma="srgb", white_balance=(1.1, 0.8, 1.7))
    sensors = {
        "mono": mono,
        "weighed": gs.Sensor(12, mono.full_scale, sensitivities=(0.2, 0.7, 0.1)),
        "chips": gs.Sensor(10, mono.full_scale, channels="rgb", **noise),
        "mosaic": gs.Sensor(10, mono.full_scale, bayer="GRBG", **noise),
        "bilinear": one(channels="rgb", bayer="RGGB", demosaic="bilinear"),
        "malvar": one(channels="rgb", bayer="GBRG", demosaic="malvar", **noise),
    }
    result = {name: sensor.expose(frame, seed=11, number=2) for name, sensor in sensors.items()}
    frame.release()
    return result


OBJ = """mtllib tent.mtl
v -30 0 -20
v 0 -6 -20
v 0 -6 20
v -30 0 20
v 30 0 -20
v 30 0 20
vt 0.1 0.05
vt 0.9 0.1
vt 0.85 0.9
vt 0.05 0.95
vt 2.9 0.2
vt 2.1 0.1
vt 2.15 0.8
usemtl photo
f 1/1 2/2 3/3 4/4
usemtl red
f 2/5 5/6 6/7
usemtl photo
f 2/5 6/7 3/6
"""
SCENE = """
schema = 1
name = "tent"
[[prop]]
name = "tent"
type = "mesh"
file = "tent.obj"
paint = [{ name = "look", type = "image", mapping = "uv", gamma = "srgb", albedo = 0.4 }]
[[light]]
name = "lamp"
type = "area"
position_mm = [-80, -150, 90]
target_mm = [0, 0, 0]
size_mm = [30, 20]
power_W = 0.4
temperature_K = 2856
[[light]]
name = "room"
type = "environment"
file = "room.npy"
[[camera]]
name = "left"
sensor_mm = [7.2, 4.8]
resolution_px = [231, 154]
focal_mm = 9.0
position_mm = [4.0, -90.0, 7.0]
target_mm = [0.0, 0.0, 0.0]
channels = "rgb"
white_balance = [0.9, 1.0, 1.6]
sensor = { bayer = "RGGB", demosaic = "malvar" }
"""


def by_uv() -> Arrays:
    """A scene run: a picture by texture coordinates, a lamp's temperature, surroundings from a
    file, a demosaiced camera."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cv2.imwrite(str(folder / "photo.png"), (255.0 * TEXELS).astype(np.uint8))
        np.save(folder / "room.npy", TEXELS[:8, :16])
        (folder / "tent.mtl").write_text(
            "newmtl photo\nKd 1 1 1\nmap_Kd photo.png\nnewmtl red\nKd 0.5 0.1 0.05\n"
        )
        (folder / "tent.obj").write_text(OBJ)
        (folder / "scene.toml").write_text(SCENE)
        return written(gs.load_scene(folder / "scene.toml"))


CASES: dict[str, Case] = {
    "color/glossy": glossy,
    "color/glossy-numpy": partial(glossy, "numpy"),
    **{f"color/{name}": partial(painted, name) for name in PAINTS},
    "color/sensors": exposed,
    "color/sensors-numpy": partial(exposed, "numpy"),
    "color/by-uv": by_uv,
}
"""By name."""
