"""The cases of `benchmarks.identical`: each is a small function that returns named arrays.

Only public names of gpusim and `benchmarks.faces` are used, so that modules can be moved and
renamed behind them. Scenes are small and without symmetry; every case makes its own objects, so
that it gives the same alone as after others.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import gpusim as gs
from benchmarks.faces import SCENES, camera_of, scene_of
from gpusim import fem, measure, mesh

Arrays = Mapping[str, npt.NDArray[Any]]
Case = Callable[[], Arrays]

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
STEEL = gs.paint.Plain(0.56, 0.35, 1.0)
LAMP = gs.AreaLight((-1.0, -2.0, 1.0), (0.0, 0.0, 0.0), (0.3, 0.2), 50.0)
BULB = gs.PointLight((-0.7, -1.6, 0.9), 50.0, shadows=False)


def fields(result: Any, *names: str) -> Arrays:
    """Some numbers of a result."""
    return {name: np.asarray(getattr(result, name)) for name in names}


def radiance_of(frame: gs.Frame) -> Arrays:
    """What a frame shows; its device memory is given back."""
    result = fields(frame, "radiance")
    frame.release()
    return result


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


METAL = gs.Isotropic(70e9, 0.33, 2700.0, 2.3e-5)
RUBBER = gs.Isotropic(1e6, 0.499)
SIZE = (0.2, 0.11, 0.07)


def bent(shape: mesh.Mesh, material: gs.Isotropic = METAL) -> gs.Model:
    """A body that is held at its least x and pulled askew at its greatest, and heavy."""
    x = shape.points[:, 0]
    fixed = np.repeat(x[:, None] <= x.min() + 1e-9, 3, axis=1)
    force = fem.nodal_force(shape, np.flatnonzero(x >= x.max() - 1e-9), [30.0, -70.0, 110.0])
    weight = fem.body_force(shape, 2700.0, [0.0, 0.0, -9.81])
    return gs.Model(shape, [material], fixed, np.stack([force, weight]))


def skewed(shape: mesh.Mesh) -> mesh.Mesh:
    """The same cells, none like another."""
    points = shape.points.copy()
    span = points.max(axis=0)
    points[:, 1] += 0.07 * span[1] * np.sin(5.0 * points[:, 0] / span[0] + 1.0)
    points[:, 2] *= 1.0 + 0.2 * points[:, 0] / span[0] + 0.1 * points[:, 1] / span[1]
    return mesh.Mesh(points, shape.cells)


MESHES: dict[str, Callable[[], mesh.Mesh]] = {
    "hex8-lattice": lambda: mesh.box(SIZE, (14, 12, 10)),
    "hex8": lambda: skewed(mesh.box(SIZE, (14, 12, 10))),
    "hex8-hole": lambda: mesh.plate_with_hole(0.2, 0.1, 0.01, 0.03, around=16, radial=4),
    "hex20-lattice": lambda: mesh.quadratic(mesh.box(SIZE, (7, 6, 5))),
    "hex20": lambda: mesh.quadratic(skewed(mesh.box(SIZE, (7, 6, 5)))),
    "tet4": lambda: mesh.split(skewed(mesh.box(SIZE, (9, 8, 7)))),
    "tet10": lambda: mesh.quadratic(mesh.split(skewed(mesh.box(SIZE, (6, 5, 4))))),
}


def solved(
    name: str, material: gs.Isotropic = METAL, real: str | None = None, **options: Any
) -> Arrays:
    """Displacements and reactions; ``real``: of a device of its own."""
    device = gs.Device(real=real) if real else None
    return fields(gs.solve(bent(MESHES[name](), material), device, tolerance=1e-5, **options),
                  "u", "reactions")  # fmt: skip


def stresses() -> Arrays:
    """Stresses of a thermal load, and masses."""
    model = bent(MESHES["hex8-hole"]())
    rise = 40.0 + 300.0 * model.mesh.points[:, 0]
    forces = fem.thermal(model.mesh, [METAL], rise)
    solution = gs.solve(gs.Model(model.mesh, [METAL], model.fixed, forces))
    found = fem.stress(model, solution.u, temperature=rise)
    mass = np.asarray(fem.lumped_mass(model))
    return {"mass": mass, **fields(solution, "u"), **fields(found, "nodal", "cell", "error")}


def waves(shift: tuple[float, float], strain: float = 0.0) -> npt.NDArray[np.uint8]:
    """A random picture (180, 200) of plane waves, moved and stretched in closed form."""
    rng = np.random.default_rng(9)
    vectors, phases = rng.normal(0.0, 0.6, (60, 2)), rng.uniform(0.0, 2.0 * np.pi, 60)
    y, x = np.indices((180, 200), dtype=np.float64)
    x, y = (1.0 - strain) * x - shift[0], y - 0.6 * strain * x - shift[1]
    total = sum(np.sin(u * x + v * y + p) for (u, v), p in zip(vectors, phases, strict=True))
    return np.clip(np.rint(128.0 + 9.0 * total), 0, 255).astype(np.uint8)


def picture(name: str) -> npt.NDArray[np.uint8]:
    """A paint as albedo in 8 bit."""
    surface, camera = tilted(PAINTS[name]())
    values = radiance_of(gs.render([surface], camera, background=0.3))["radiance"]
    return np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)


def correlated(backend: str) -> Arrays:
    """Image correlation of a pair, and strains."""
    first, second = waves((0.0, 0.0)), waves((0.37, -0.21), 0.004)
    result = measure.dic(first, second, subset=21, step=12, backend=backend)
    found = fields(result, "points", "displacement", "gradient", "zncc", "sigma", "status")
    return {**found, **fields(measure.strain(result), "tensor", "residual")}


def tracked() -> Arrays:
    """A few points followed."""
    points = np.array([[60.0, 50.0], [120.5, 70.25], [90.0, 130.0]])
    return vars(measure.track(waves((0.0, 0.0)), waves((1.37, -0.71)), points, subset=25))


def targets() -> Arrays:
    """Markers, dots and codes."""
    markers = measure.find_markers(picture("markers"), (20.0, 50.0))
    return {
        **fields(markers, "points", "size", "angle", "contrast", "residual", "status"),
        "dots": measure.find_dots(picture("dots"), (5.0, 12.0)).points,
        "codes": measure.find_aruco(picture("aruco")).corners,
    }


def calibrated() -> Arrays:
    """A camera from seven images of a chessboard."""
    board = measure.Chessboard(9, 8, 0.05)
    paint = gs.paint.Checker(0.05, 9, 8, (0.1, 0.1), 0.9, 0.05, 0.8)
    flat = np.array([[0.0, 0.0, 0.0], [0.65, 0.0, 0.0], [0.65, 0.0, 0.6], [0.0, 0.0, 0.6]])
    camera = replace(camera_of("board", 480), distortion=BROWN)
    rng, sightings = np.random.default_rng(8), []
    for _ in range(7):
        turn = Rotation.from_euler("xyz", rng.uniform(-25.0, 25.0, 3), degrees=True).as_matrix()
        points = (flat - [0.325, 0.0, 0.3]) @ turn.T + rng.uniform(-0.05, 0.05, 3)
        surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint, reference=flat)
        values = radiance_of(gs.render([surface], camera, background=0.4))["radiance"]
        image = np.rint(255.0 * values).astype(np.uint8)
        sightings.append(measure.find_chessboard(image, board))
    found = measure.calibrate(sightings, lens="brown")
    lens = fields(found.cameras[0], "K", "distortion")
    return {**lens, **fields(found, "rms", "view_poses", "covariance")}


def example(name: str, changes: Mapping[str, Any]) -> Arrays:
    """A scene of the examples run into a folder: what it writes but reports and figures."""
    scene = gs.load_scene(EXAMPLES / f"{name}.toml", changes)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        gs.run(scene, out)
        result: dict[str, npt.NDArray[Any]] = {}
        for path in sorted(out.rglob("*")):
            relative = path.relative_to(out)
            if "figures" not in relative.parts:
                result |= {f"{relative}{key}": value for key, value in _read(path).items()}
    return result


def _read(path: Path) -> Arrays:
    if path.suffix == ".npz":
        with np.load(path) as stored:
            return {f":{key}": stored[key] for key in stored}
    if path.suffix == ".h5":
        parts: list[tuple[str, Any]] = []
        with h5py.File(path) as file:
            file.visititems(lambda key, item: parts.append((key, item)))
            return {f":{key}": item[()] for key, item in parts
                    if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub"}  # fmt: skip
    if path.suffix in (".png", ".tif", ".tiff"):
        return {"": np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))}
    if path.suffix in (".csv", ".vtu"):
        return {"": np.frombuffer(path.read_bytes(), np.uint8)}
    return {}


EXAMPLE_CHANGES: dict[str, dict[str, Any]] = {
    "bimetal": {"camera.side.resolution_px": [1000, 400]},
    "cantilever": {"camera.side.resolution_px": [1000, 400]},
    "crane": {"camera.front.resolution_px": [702, 468], "body.crane.mesh.element_mm": 6.0,
              "measure": []},
    "damaged_beam": {"camera.front.resolution_px": [1280, 300],
                     "body.beam.mesh.divisions": [100, 1, 6]},
    "lug": {"camera.above.resolution_px": [300, 200]},
    "strip": {"camera.above.resolution_px": [240, 160]},
}  # fmt: skip


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
    **{f"fem/{name}-direct": partial(solved, name, method="direct") for name in MESHES},
    **{f"fem/{name}-{backend}": partial(solved, name, method="multigrid", backend=backend)
       for name in MESHES for backend in ("numpy", "gpu")},
    **{f"fem/incompressible-{name}-{backend}":
       partial(solved, name, RUBBER, backend=backend, method="multigrid")
       for name in ("hex8", "tet10") for backend in ("numpy", "gpu")},
    "fem/double-single": partial(solved, "hex8", real="double_single", method="multigrid"),
    "fem/stresses": stresses,
    "measure/dic": partial(correlated, "gpu"),
    "measure/dic-numpy": partial(correlated, "numpy"),
    "measure/track": tracked,
    "measure/targets": targets,
    "measure/calibration": calibrated,
    **{f"example/{name}": partial(example, name, EXAMPLE_CHANGES[name])
       for name in EXAMPLE_CHANGES},
}  # fmt: skip
"""By name; a name's first part is its group."""
