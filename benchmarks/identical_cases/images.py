"""Images: shapes, paints, lamps, lenses, truth and sensors, by the device and by NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import gpusim as gs
from benchmarks.faces import SCENES, camera_of, scene_of
from benchmarks.identical_cases.arrays import Arrays, Case, fields, radiance_of

STEEL = gs.paint.Plain(0.56, 0.35, 1.0)
LAMP = gs.AreaLight((-1.0, -2.0, 1.0), (0.0, 0.0, 0.0), (0.3, 0.2), 50.0)
BULB = gs.PointLight((-0.7, -1.6, 0.9), 50.0, shadows=False)


def faces_scene(name: str, faces: int, width: int, lit: bool = True, **options: Any) -> Arrays:
    """A scene of the faces benchmark."""
    surface, behind, lights = scene_of(name, faces)
    camera = camera_of(name, width)
    return radiance_of(gs.render([surface, *behind], camera, lights if lit else None, **options))


def relit(name: str, lights: Sequence[Any], paint: Any = None, backend: str = "gpu") -> Arrays:
    """A scene of the faces benchmark under other lights and in another paint."""
    surface, behind, _ = scene_of(name, 800)
    if paint is not None:
        surface = gs.Surface(surface.points, surface.faces, paint)
    camera = camera_of(name, 231 if backend == "gpu" else 61)
    return radiance_of(gs.render([surface, *behind], camera, lights, backend=backend))


def tilted(paint: Any) -> tuple[gs.Surface, gs.Camera]:
    """A rectangle of 0.9 x 0.6 that faces -y, and a camera askew before it."""
    corners = np.array([[-0.45, 0.02, -0.3], [0.45, -0.05, -0.3], [0.45, -0.05, 0.3],
                        [-0.45, 0.02, 0.3]])  # fmt: skip
    surface = gs.Surface(corners, np.array([[0, 1, 2, 3]]), paint)
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 34.0, (345, 230), (0.17, -0.9, 0.23), (0.02, 0.0, 0.01), up=(0.1, 0.0, 1.0)
    )
    return surface, camera


PLACES = np.array([[0.13, 0.11], [0.41, 0.17], [0.7, 0.13], [0.19, 0.43], [0.52, 0.4]])
PAINTS: dict[str, Callable[[], Any]] = {
    "plain": lambda: gs.paint.Plain(0.4),
    "board": lambda: gs.paint.Checker(0.051, origin=(0.013, 0.007)),
    "board-patch": lambda: gs.paint.Checker(0.067, 9, 7, (0.113, 0.057), ground=0.5),
    "dots": lambda: gs.paint.Dots(0.021, 0.043, origin=(0.017, 0.009)),
    "markers": lambda: gs.paint.Markers(PLACES, 0.09, angle=0.2),
    "speckle": lambda: gs.paint.Speckle(0.012, seed=3),
    "speckle-soft": lambda: gs.paint.Speckle(0.014, 0.4, 0.002, "lognormal", 0.3, seed=5),
    "speckle-grid": lambda: gs.paint.Speckle(0.014, 0.4, arrangement="grid", seed=7),
    "bitmap": lambda: gs.paint.Image(np.arange(57 * 83, dtype=np.uint8).reshape(57, 83), 0.011),
    "circles": lambda: gs.paint.Circles(PLACES, (0.11, 0.06)),
    "lines": lambda: gs.paint.Lines(0.037, 0.009),
    "star": lambda: gs.paint.Star(PLACES[[1, 3]], 0.2),
    "aruco": lambda: gs.paint.Aruco(PLACES, tuple(range(5)), 0.1),
    "charuco": lambda: gs.paint.Charuco(8, 5, 0.1, 0.07, origin=(0.05, 0.05)),
    "ring-codes": lambda: gs.paint.RingCodes(PLACES, (3, 5, 9, 11, 21), 0.05),
    "relief": lambda: gs.paint.Plain(0.5, 0.4, 1.0, gs.paint.Bump(0.0006, 0.02, seed=4)),
}


def painted(name: str, backend: str = "gpu") -> Arrays:
    """A paint, as albedo and lit."""
    surface, camera = tilted(PAINTS[name]())
    if backend == "numpy":
        camera = camera_of("board", 61)
    show = partial(gs.render, [surface], camera, background=0.3, backend=backend)
    frames = {"albedo": show(), "lit": show(lights=[BULB, gs.AmbientLight(0.4)])}
    return {name: radiance_of(frame)["radiance"] for name, frame in frames.items()}


def room(occlusion: bool, image: bool = False) -> gs.EnvironmentLight:
    """Light from all around."""
    sky = np.random.default_rng(2).uniform(0.1, 2.0, (8, 16)) if image else None
    return gs.EnvironmentLight(1.6, 0.6, sky, occlusion=occlusion)


def photographed(
    backend: str = "gpu",
    lens: gs.Lens | None = None,
    shutter: gs.Shutter | None = None,
    distortion: Sequence[float] | None = None,
    speed: float = 0.0,
) -> Arrays:
    """An I beam before a wall, which may move, behind a real lens."""
    surface, behind, lights = scene_of("flanges-shadows", 300)
    pinhole = camera_of("flanges-shadows", 225 if backend == "gpu" else 45)
    camera = replace(pinhole, distortion=distortion)
    velocity = np.array([speed, 0.0, 0.3 * speed])

    def at(time: float) -> list[gs.Surface]:
        return [surface.moved(surface.points + time * velocity), *behind]

    frame = gs.photograph(at, camera, lights, lens=lens, shutter=shutter, backend=backend)
    return {**radiance_of(frame), **fields(frame.truth(), "flow", "depth")}


BROWN = (-0.21, 0.08, 0.0011, -0.0007, -0.02)
FOCUS = gs.Lens(f_number=1.4, focal_length=0.034, focus_distance=1.1, blades=6, positions=8)
PHOTOGRAPHS: dict[str, dict[str, Any]] = {
    "depth-of-field": {"lens": FOCUS},
    "point-spread": {"lens": gs.Lens(gs.psf.Gaussian(0.7), 0.8)},
    "vignetting": {"lens": gs.Lens(vignetting=gs.Vignetting(polynomial=(-0.2,)))},
    "distortion": {"distortion": BROWN},
    "motion-blur": {"shutter": gs.Shutter(0.01), "speed": 2.0},
    "rolling-shutter": {"shutter": gs.Shutter(0.004, 1e-4), "speed": 2.0, "distortion": BROWN},
}


def series() -> Arrays:
    """Images of one fine surface that moves: what stays on the device is taken again."""
    surface, _, lights = scene_of("speckle", 60_000)
    camera = camera_of("speckle", 345)
    result = {}
    for k in range(3):
        shown = surface.moved(surface.points + k * np.array([1e-3, 2e-4, -5e-4]))
        result[f"radiance-{k}"] = radiance_of(gs.render([shown], camera, lights))["radiance"]
    return result


def pierced() -> Arrays:
    """Bodies that stand in each other."""
    first, behind, lights = scene_of("beam-soft", 400)
    other = first.points @ Rotation.from_euler("y", 37.0, degrees=True).as_matrix()
    second = gs.Surface(other + np.array([0.03, 0.011, -0.02]), first.faces, STEEL)
    camera = camera_of("beam-soft", 345)
    return radiance_of(gs.render([first, second, *behind], camera, lights))


def truth(name: str, lit: bool, backend: str = "gpu") -> Arrays:
    """Truth maps of an image."""
    surface, behind, lights = scene_of(name, 1_000)
    camera = camera_of(name, 345 if backend == "gpu" else 93)
    shown = [surface, *behind]
    frame = gs.render(shown, camera, lights if lit else None, backend=backend)
    frame.release()
    found = frame.truth()
    return {"ids": frame.ids(), **fields(found, *found.LAYERS)}


def exposed(backend: str = "gpu") -> Arrays:
    """Grey levels: without noise, with it, and behind a mosaic."""
    surface, camera = tilted(PAINTS["dots"]())
    frame = gs.render([surface], camera, [BULB], backend=backend)
    plain = gs.Sensor.auto_exposed(frame, 12)
    noisy = gs.Sensor(10, plain.full_scale, full_well=9000.0, read_noise=4.0, dsnu=2.0, prnu=0.01)
    mosaic = gs.Sensor(8, plain.full_scale, gamma=2.2, bayer="RGGB")
    sensors = {"plain": plain, "noisy": noisy, "mosaic": mosaic}
    result = {name: sensor.expose(frame, seed=11, number=2) for name, sensor in sensors.items()}
    frame.release()
    return result


FINER = ("board", "shadows", "speckle", "beam-soft", "sheet-soft", "rod-soft", "tube-soft",
         "flanges-low", "eggs-shadows", "crane")  # fmt: skip
FINEST = ("board", "sheet-soft", "tube-shadows", "crane")
LIGHTS: dict[str, tuple[str, list[Any]]] = {
    "spot-and-sun": ("flanges-soft", [
        gs.SpotLight((-0.6, -1.4, 0.7), (0.0, 0.0, 0.0), 40.0, 0.6),
        gs.SunLight((0.4, 1.0, -0.7), 2.0),
    ]),
    "disc": ("eggs-low", [gs.AreaLight((1.2, -1.0, 0.6), (0, 0, 0), (0.3, 0.3), 50.0, "ellipse")]),
    "ambient-occlusion": ("flanges-soft", [gs.AmbientLight(1.0, occlusion=True)]),
    "environment": ("rod-soft", [room(False), LAMP]),
    "environment-occlusion": ("flanges-soft", [room(True, True)]),
}  # fmt: skip

CASES: dict[str, Case] = {
    **{f"faces/{name}-1000": partial(faces_scene, name, 1_000, 465) for name in SCENES},
    **{f"faces/{name}-10000": partial(faces_scene, name, 10_000, 700) for name in FINER},
    **{f"faces/{name}-30000": partial(faces_scene, name, 30_000, 465) for name in FINEST},
    **{f"unlit/{name}": partial(faces_scene, name, 3_000, 465, False) for name in FINER[::3]},
    **{f"paint/{name}": partial(painted, name) for name in PAINTS},
    **{f"light/{name}": partial(relit, *LIGHTS[name]) for name in LIGHTS},
    "light/steel": partial(relit, "rod-soft", [LAMP, room(False, True)], STEEL),
    **{f"lens/{name}": partial(photographed, **PHOTOGRAPHS[name]) for name in PHOTOGRAPHS},
    "series": series,
    "pierced": pierced,
    "truth/crane": partial(truth, "crane", True),
    "truth/beam": partial(truth, "beam", False),
    "sensor": exposed,
    **{f"numpy/{name}": partial(faces_scene, name, 300, 93, backend="numpy")
       for name in ("board", "beam-soft", "sheet-shadows", "crane")},
    **{f"numpy/{name}": partial(painted, name, "numpy") for name in ("speckle", "relief")},
    "numpy/occlusion": partial(relit, "flanges-soft", [gs.AmbientLight(1.0, True)], None, "numpy"),
    "numpy/steel": partial(relit, "rod-soft", [LAMP, room(False, True)], STEEL, "numpy"),
    "numpy/depth-of-field": partial(photographed, "numpy", replace(FOCUS, positions=3)),
    "numpy/truth": partial(truth, "beam", True, "numpy"),
    "numpy/sensor": partial(exposed, "numpy"),
}  # fmt: skip
