"""Renders the pictures of docs/gallery.md into docs/gallery.

python scripts/gallery.py [NAME ...]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

import gpusim as gs

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]
ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "docs" / "gallery"
SIZE = (720, 480)
LARGEST = 400_000
"""Bytes of a picture."""

SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
FACE = np.array([[0, 1, 2, 3]])


def grey(frame: gs.Frame, white: float) -> Picture:
    """The picture of a frame for a screen: ``white`` is the radiance that becomes 255."""
    return tone(frame.radiance / white)


def tone(linear: Array) -> Picture:
    """sRGB's gamma."""
    return np.round(255.0 * np.clip(linear, 0.0, 1.0) ** (1.0 / 2.2)).astype(np.uint8)


def look(eye: tuple[float, ...], target: tuple[float, ...], focal: float = 50.0) -> gs.Camera:
    """A camera with a sensor of 36 x 24 mm."""
    return gs.Camera.from_lens((36.0, 24.0), focal, SIZE, eye, target)


def sheet(
    centre: tuple[float, ...], half: tuple[float, ...], paint: gs.paint.Paint, turn: float = 0.0
) -> gs.Surface:
    """A level rectangle, or upright and turned by ``turn`` if it has a third half size."""
    points = SQUARE * [half[0], half[1], 0.0]
    if len(half) > 2:
        points = np.stack([points[:, 0], 0.0 * points[:, 0], points[:, 1]], axis=1)
        c, s = np.cos(turn), np.sin(turn)
        points = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return gs.Surface(points + centre, FACE, paint=paint)


def box(
    centre: tuple[float, ...], half: tuple[float, ...], paint: gs.paint.Paint, turn: float = 0.0
) -> gs.Surface:
    """A closed box, turned about z."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    faces = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    )
    c, s = np.cos(turn), np.sin(turn)
    points = signs * half @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return gs.Surface(points + centre, faces, paint=paint)


def turned_body(
    profile: Array, centre: tuple[float, ...], paint: gs.paint.Paint, count: int = 64
) -> gs.Surface:
    """A closed body of revolution about z: ``profile`` (K, 2) radius and height, from below."""
    angle = np.arange(count) * 2.0 * np.pi / count
    inner = profile[1:-1]
    rings = np.stack(
        [np.outer(inner[:, 0], np.cos(angle)), np.outer(inner[:, 0], np.sin(angle)),
         np.repeat(inner[:, 1:], count, axis=1)], axis=2,
    )  # fmt: skip
    ends = [[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]]
    points = np.concatenate([rings.reshape(-1, 3), ends])
    i, rows = np.arange(count), len(inner)
    j, last = (i + 1) % count, len(points) - 1
    faces = [np.stack([i + k, j + k, j + k + count, i + k + count], axis=1)
             for k in range(0, count * (rows - 1), count)]  # fmt: skip
    top = count * (rows - 1)
    bottom = np.full(count, last - 1)
    none = np.full(count, -1)
    faces.append(np.stack([j, i, bottom, none], axis=1))
    faces.append(np.stack([top + i, top + j, bottom + 1, none], axis=1))
    return gs.Surface(points + centre, np.concatenate(faces), paint=paint)


def ball(centre: tuple[float, ...], radius: float, paint: gs.paint.Paint) -> gs.Surface:
    """A sphere."""
    angle = np.linspace(0.0, np.pi, 25)
    profile = radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    return turned_body(profile, centre, paint, 48)


def crane() -> Picture:
    """The crane of examples/crane.toml, loaded."""
    scene = gs.load_scene(ROOT / "examples" / "crane.toml")
    for key, value in {
        "camera.front.resolution_px": [720, 480], "camera.front.focal_mm": 62.0,
        "camera.front.position_mm": [330.0, -1000.0, 330.0],
        "camera.front.target_mm": [190.0, -20.0, 425.0],
        "light.room.studio_W_m2_sr": 2.0, "light.lamp-near.size_mm": [300.0, 300.0],
        "sensor.gamma": 2.2, "output.truth": [], "measure": [],
    }.items():  # fmt: skip
        scene = scene.replace(key, value)
    with tempfile.TemporaryDirectory() as folder:
        gs.run(scene, folder)
        image = cv2.imread(str(Path(folder, "images", "front", "0001.png")), cv2.IMREAD_UNCHANGED)
    return np.asarray(image, np.uint8)


def plate() -> tuple[gs.Frame, gs.Frame]:
    """A plate of 100 x 60 x 4 mm with a hole, pulled: before and after."""
    mesh = gs.mesh.plate_with_hole(0.1, 0.06, 0.004, 0.02, around=64, radial=14)
    ends = np.abs(mesh.points[:, 0]) > 0.0499
    fixed = np.repeat(ends[:, None], 3, axis=1)
    pull = np.zeros_like(mesh.points)
    pull[:, 0] = np.where(ends, 4e-3 * mesh.points[:, 0], 0.0)
    u = gs.solve(gs.Model(mesh, [gs.Isotropic(70e9, 0.33)], fixed=fixed, prescribed=pull)).u
    skin = gs.Skin(mesh, gs.mesh.boundary_faces(mesh))
    front = np.isclose(mesh.points[skin.faces.nodes[:, :4], 2], 0.004).all(axis=1)
    paints = {"metal": gs.paint.Plain(0.5), "speckle": gs.paint.Speckle(9e-4, 0.5, 5e-5, seed=3)}
    rest = skin.surface(paints, front.astype(np.int32), {}, "plate")
    lamp = gs.AreaLight((-0.2, -0.15, 0.5), (0.0, 0.0, 0.0), (0.2, 0.2), 1.0)
    view = gs.Camera.from_lens(
        (36.0, 24.0), 45.0, SIZE, (0.02, -0.045, 0.15), (0.0, -0.001, 0.0), up=(0.0, 1.0, 0.0)
    )
    lights = [lamp, gs.AmbientLight(0.25)]
    bodies = (rest, skin.moved(rest, u))
    return tuple(gs.render([body], view, lights, background=0.02) for body in bodies)


def coloured(values: Array, low: float, high: float) -> Picture:
    """Values (H, W) in false colours, white where there are none."""
    level = np.round(255.0 * np.clip((values - low) / (high - low), 0.0, 1.0))
    colours = cv2.applyColorMap(np.nan_to_num(level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    colours[np.isnan(values)] = 255
    return np.asarray(colours, np.uint8)


def plate_speckle() -> Picture:
    """Loaded."""
    return grey(plate()[1], 0.65)


def plate_truth() -> Picture:
    """The exact displacement along x of what each pixel sees."""
    truth = plate()[1].truth()
    values = np.full(truth.shape, np.nan)
    values[truth.row, truth.column] = truth.displacement[:, 0]
    return coloured(values, -2e-4, 2e-4)


def rig() -> Picture:
    """One board, two cameras."""
    paint = gs.paint.Charuco(9, 7, 0.04, 0.03, "5X5_100", (0.02, 0.02))
    board = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.4, 0, 0.32], [0.0, 0, 0.32]]) - [0.2, 0.0, 0.16]
    c, s = np.cos(0.35), np.sin(0.35)
    tilted = board @ np.array([[1.0, 0, 0], [0, c, s], [0, -s, c]]).T
    things = [
        gs.Surface(tilted, FACE, reference=board, paint=paint),
        sheet((0.0, 0.5, 0.0), (2.0, 2.0, 0.0), gs.paint.Plain(0.35)),
    ]
    lights = [
        gs.AreaLight((-0.7, -1.2, 0.9), (0.0, 0.0, 0.0), (0.3, 0.3), 12.0),
        gs.AmbientLight(0.25),
    ]
    halves = []
    for x in (-0.33, 0.33):
        camera = gs.Camera.from_lens(
            (24.0, 32.0), 50.0, (SIZE[0] // 2 - 3, SIZE[1]), (x, -0.95, 0.12), (0.0, 0.0, 0.0),
            distortion=[-0.12, 0.02, 0.0, 0.0],
        )  # fmt: skip
        halves.append(grey(gs.render(things, camera, lights), 1.0))
    return np.concatenate([halves[0], np.full((SIZE[1], 6), 255, np.uint8), halves[1]], axis=1)


def room() -> Array:
    """Surroundings (64, 128) with a bright window, tubes at the ceiling, and a darker floor."""
    v, u = np.mgrid[:64, :128]
    image = np.where(v < 32, 0.35, 0.18) + 0.0 * u
    image[12:34, 24:42] = 6.0
    image[12:34, 32:34] = 0.3
    image[3:7, 60:110] = 9.0
    image[18:30, 92:104] = 1.5
    return image


def steel() -> Picture:
    """Balls of steel from polished to blasted, on a dark table."""
    things = [
        sheet((0.0, 0.0, 0.0), (4.0, 3.0), gs.paint.Plain(0.35)),
        sheet((0.0, 1.8, 0.0), (5.0, 3.0, 0.0), gs.paint.Plain(0.45)),
    ]
    for k, roughness in enumerate((0.12, 0.3, 0.55)):
        paint = gs.paint.Plain(0.75, roughness, 1.0)
        things.append(ball((1.05 * (k - 1), 0.15 * k, 0.45), 0.45, paint))
    lights = [
        gs.EnvironmentLight(image=room(), forward=(0.3, 1.0, 0.0), occlusion=True),
        gs.AreaLight((-2.0, -1.5, 3.0), (0.0, 0.0, 0.3), (0.8, 0.8), 60.0),
    ]
    return grey(gs.render(things, look((0.3, -4.6, 1.5), (0.05, 0.1, 0.5), 50.0), lights), 1.2)


def penumbra(size: float) -> Picture:
    """A comb and a ball under a lamp ``size`` wide."""
    things = [
        sheet((0.0, 0.0, 0.0), (3.0, 3.0), gs.paint.Plain(0.7)),
        sheet((0.0, 2.9, 0.0), (9.0, 4.0, 0.0), gs.paint.Plain(0.7)),
    ]
    paint = gs.paint.Plain(0.5)
    things += [box((0.22 * k - 1.0, 0.25, 0.5), (0.05, 0.05, 0.5), paint) for k in range(6)]
    things.append(box((-0.45, 0.25, 1.05), (0.66, 0.07, 0.05), paint))
    things.append(ball((0.75, 0.0, 0.35), 0.35, gs.paint.Plain(0.6)))
    lights = [
        gs.AreaLight((-1.6, 2.2, 2.9), (0.0, 0.0, 0.2), (size, size), 90.0),
        gs.AmbientLight(0.12, occlusion=True),
    ]
    return grey(gs.render(things, look((0.2, -3.8, 2.5), (0.0, -0.1, 0.42), 46.0), lights), 1.0)


def yard(occlusion: bool) -> Picture:
    """Stairs, a gate, pipes and boxes under an even sky."""
    paint = gs.paint.Plain(0.8)
    things = [sheet((0.0, 0.0, 0.0), (40.0, 40.0), paint)]
    things += [box((-1.05, 0.2 * k, 0.09 * (k + 1)), (0.45, 0.1, 0.09 * (k + 1)), paint)
               for k in range(6)]  # fmt: skip
    things += [box((x, 0.55, 0.5), (0.12, 0.12, 0.5), paint) for x in (0.0, 0.9)]
    things.append(box((0.45, 0.55, 1.1), (0.7, 0.2, 0.1), paint))
    pipe = np.array([[0.0, 0.0], [0.16, 0.0], [0.16, 0.55], [0.1, 0.55], [0.1, 0.05], [0.0, 0.05]])
    things += [turned_body(pipe, (0.15 + 0.36 * k, -0.45, 0.0), paint) for k in range(3)]
    things.append(box((-0.3, -0.55, 0.11), (0.16, 0.11, 0.11), paint, 0.5))
    lights = [gs.EnvironmentLight(1.0, 0.35, occlusion=occlusion)]
    return grey(gs.render(things, look((1.6, -3.9, 2.3), (-0.15, 0.2, 0.5), 46.0), lights), 0.95)


def depth_of_field(f_number: float | None) -> Picture:
    """Coded targets in a row, focused on the third."""
    things = [sheet((0.0, 0.4, 0.0), (2.0, 2.0), gs.paint.Checker(0.05, dark=0.25, light=0.5))]
    for k in range(7):
        centre = np.array([[0.06, 0.06]])
        marker = gs.paint.Aruco(centre, (k,), 0.085, ground=0.85)
        place = (0.13 * (k - 3) + 0.05, 0.22 * (k - 2), 0.06)
        things.append(sheet(place, (0.06, 0.06, 0.0), marker, 0.25))
    lights = [
        gs.AreaLight((-0.9, -1.3, 1.6), (0.0, 0.3, 0.0), (0.4, 0.4), 22.0),
        gs.AmbientLight(0.3),
    ]
    camera = look((0.28, -0.95, 0.3), (0.0, 0.12, 0.03), 50.0)
    lens = None
    if f_number is not None:
        lens = gs.Lens(f_number=f_number, focal_length=0.05, focus_distance=1.0, blades=7)
    return grey(gs.photograph(things, camera, lights, lens=lens), 1.1)


def wheel(shutter: gs.Shutter | None) -> Picture:
    """A wheel of twelve spokes at ten turns a second."""

    def at(time: float) -> list[gs.Surface]:
        things = [sheet((0.0, 0.3, 0.0), (2.0, 2.0, 0.0), gs.paint.Plain(0.5))]
        ring, turn = np.arange(12) * np.pi / 6.0, 20.0 * np.pi * time
        for k, angle in enumerate(ring + turn):
            c, s = np.cos(angle), np.sin(angle)
            blade = SQUARE[:, [0, 2, 1]] * [0.36, 0.0, 0.045] + [0.5, 0.0, 0.0]
            blade = blade @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
            things.append(gs.Surface(blade, FACE, paint=gs.paint.Plain(0.85 if k else 0.1)))
        return things

    lights = [
        gs.AreaLight((-1.2, -2.0, 1.6), (0.0, 0.0, 0.0), (0.5, 0.5), 40.0),
        gs.AmbientLight(0.3),
    ]
    camera = look((0.0, -3.0, 0.0), (0.0, 0.0, 0.0), 38.0)
    if shutter is None:
        return grey(gs.render(at(0.004), camera, lights), 1.5)
    return grey(gs.photograph(at, camera, lights, shutter=shutter), 1.5)


def noise() -> Picture:
    """A part of a dim picture, six times enlarged: without noise, and as an IMX174 gives it."""
    target = sheet((0.0, 0.0, 0.0), (0.05, 0.05), gs.paint.Speckle(2.2e-3, 0.5, 2e-4, seed=4))
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 50.0, (120, 80), (0.0, 0.0, 0.05), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)
    )
    frame = gs.photograph([target], camera, lens=gs.Lens(psf=gs.psf.Gaussian(0.6)))
    sensor = gs.Sensor.preset("imx174", full_scale=60.0)
    noisy = sensor.expose(frame, seed=1) * (60.0 / 4095.0)
    half = np.concatenate([frame.radiance[:, :60], noisy[:, 60:]], axis=1)
    return np.kron(tone(half), np.ones((6, 6), np.uint8))


PICTURES: dict[str, Callable[[], Picture]] = {
    "crane": crane,
    "steel": steel,
    "plate": plate_speckle,
    "plate_truth": plate_truth,
    "rig": rig,
    "noise": noise,
    "lamp_small": lambda: penumbra(0.05),
    "lamp_large": lambda: penumbra(0.9),
    "yard_open": lambda: yard(False),
    "yard_hidden": lambda: yard(True),
    "pinhole": lambda: depth_of_field(None),
    "f1.4": lambda: depth_of_field(1.4),
    "still": lambda: wheel(None),
    "motion": lambda: wheel(gs.Shutter(3e-3)),
}


def main(names: list[str]) -> None:
    """Render and write the pictures named, or all."""
    if unknown := [name for name in names if name not in PICTURES]:
        sys.exit(f"gallery: got {', '.join(unknown)}; expected some of {', '.join(PICTURES)}")
    OUT.mkdir(exist_ok=True)
    for name in names or PICTURES:
        path = OUT / f"{name}.jpg"
        cv2.imwrite(str(path), PICTURES[name](), [cv2.IMWRITE_JPEG_QUALITY, 90])
        assert path.stat().st_size < LARGEST, f"{path}: {path.stat().st_size} bytes"
        print(f"wrote {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main(sys.argv[1:])
