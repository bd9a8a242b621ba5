"""Renders the pictures of docs/gallery.md into docs/gallery.

python scripts/gallery.py [NAME ...]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))  # its sources, not those of a wheel that is installed

from gallery_examples import exposures, maps, vibrating  # noqa: E402
from gallery_shapes import FACE, SQUARE, ball, box, sheet, turned_body  # noqa: E402

import gpusim as gs  # noqa: E402
from gpusim.optics.light.studio import studio  # noqa: E402

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]
"""Red, green, blue, by the curve of sRGB."""
OUT = ROOT / "docs" / "gallery"
SIZE = (720, 480)
LARGEST = 200_000
"""Bytes of a picture."""
LARGEST_FILM = 1_000_000

HALOGEN, DAYLIGHT = gs.blackbody(2856), gs.blackbody(6500)
# The ColorChecker's 24 patches, sRGB of 8 bits (published by its makers).
CHART = """735244 c29682 627a9d 576c43 8580b1 67bdaa d67e2c 505ba6 c15a63 5e3c6c 9dbc40 e0a32e
383d96 469449 af363c e7c71f bb5695 0885a1 f3f3f2 c8c8c8 a0a0a0 7a7a79 555555 343434""".split()


def developed(frame: gs.Frame, white: float, balance: Sequence[float] | None = None) -> Picture:
    """The picture for a screen: ``white`` is the radiance that becomes 255."""
    gains = None if balance is None else tuple(1.0 / np.array(balance))
    sensor = gs.Sensor(channels="rgb", gamma="srgb", full_scale=white, white_balance=gains)
    return sensor.expose(frame)


def look(eye: tuple[float, ...], target: tuple[float, ...], focal: float = 50.0) -> gs.Camera:
    """A camera with a sensor of 36 x 24 mm."""
    return gs.Camera.from_lens((36.0, 24.0), focal, SIZE, eye, target)


def crane() -> Picture:
    """The crane of examples/crane.toml, loaded; painted yellow, on a floor."""
    scene = gs.load_scene(ROOT / "examples" / "crane.toml")
    wall = scene.document["prop"][0]
    wall |= {"center_mm": [300.0, 150.0, 900.0], "size_mm": [4000.0, 1940.0]}
    wall["paint"][0]["albedo"] = "#7fa3b0"
    floor = {
        "name": "floor", "center_mm": [300.0, -1850.0, -70.0], "normal": [0.0, 0.0, 1.0],
        "up": [0.0, 1.0, 0.0], "size_mm": [4000.0, 4000.0],
        "paint": [{"name": "floor", "type": "plain", "albedo": "#a39a8c"}],
    }  # fmt: skip
    for paint in ("steel", "column", "beam"):
        for key, value in {"albedo": "#f2a900", "metallic": 0.0, "roughness": 0.5}.items():
            scene = scene.replace(f"body.crane.paint.{paint}.{key}", value)
    for key, value in {
        "camera.front.resolution_px": SIZE, "camera.front.focal_mm": 41.0,
        "camera.front.position_mm": [900.0, -900.0, 560.0],
        "camera.front.target_mm": [265.0, 0.0, 292.0], "camera.front.channels": "rgb",
        "camera.front.white_balance_K": 4200.0,
        "light.lamp-near.position_mm": [-500.0, -1500.0, 1300.0],
        "light.lamp-far.position_mm": [1500.0, -1500.0, 900.0],
        "light.lamp-near.temperature_K": 3000.0, "light.lamp-far.temperature_K": 3000.0,
        "light.room.temperature_K": 7500.0, "light.room.studio_W_m2_sr": 1.2,
        "prop": [wall, floor], "sensor.gamma": "srgb", "output.truth": [], "measure": [],
        "output.vtu": False, "output.stl": False,
    }.items():  # fmt: skip
        scene = scene.replace(key, value)
    with tempfile.TemporaryDirectory() as folder:
        gs.run(scene, folder)
        image = cv2.imread(str(Path(folder, "images", "front", "0001.png")))
    return np.asarray(image[..., ::-1], np.uint8)


def plate() -> gs.Frame:
    """A plate of 100 x 60 x 4 mm with a hole, pulled."""
    mesh = gs.mesh.plate_with_hole(0.1, 0.06, 0.004, 0.02, around=64, radial=14)
    ends = np.abs(mesh.points[:, 0]) > 0.0499
    fixed = np.repeat(ends[:, None], 3, axis=1)
    pull = np.zeros_like(mesh.points)
    pull[:, 0] = np.where(ends, 4e-3 * mesh.points[:, 0], 0.0)
    u = gs.solve(gs.Model(mesh, [gs.Isotropic(70e9, 0.33)], fixed=fixed, prescribed=pull)).u
    skin = gs.Skin(mesh, gs.mesh.boundary_faces(mesh))
    front = np.isclose(mesh.points[skin.faces.nodes[:, :4], 2], 0.004).all(axis=1)
    paints = {
        "metal": gs.paint.Plain((0.91, 0.92, 0.92), 0.4, 1.0),
        "speckle": gs.paint.Speckle(1e-3, 0.5, 5e-5, dot="#b0201c", ground="#f4f0e6", seed=3),
    }
    rest = skin.surface(paints, front.astype(np.int32), {}, "plate")
    table = gs.Surface(SQUARE - [0.0, 0.0, 0.01], FACE, paint=gs.paint.Plain("#3d5a6b"))
    view = gs.Camera.from_lens(
        (36.0, 24.0), 45.0, SIZE, (0.02, -0.045, 0.15), (0.0, -0.001, 0.0), up=(0.0, 1.0, 0.0)
    )
    lights = [
        gs.AreaLight((-0.2, 0.15, 0.5), (0.0, 0.0, 0.0), (0.2, 0.2), 1.0, color=gs.blackbody(4000)),
        gs.EnvironmentLight(image=0.25 * studio(), forward=(0.0, 1.0, 0.0)),
    ]
    return gs.render([skin.moved(rest, u), table], view, lights)


def plate_truth() -> Picture:
    """The exact displacement along x of what each pixel sees, white where there is none."""
    truth = plate().truth()
    values = np.full(truth.shape, np.nan)
    moving = np.abs(truth.displacement).max(axis=1) > 1e-9  # the table doesn't
    values[truth.row[moving], truth.column[moving]] = truth.displacement[moving, 0]
    level = np.round(255.0 * np.clip((values + 2e-4) / 4e-4, 0.0, 1.0))
    colours = cv2.applyColorMap(np.nan_to_num(level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    colours[np.isnan(values)] = 255
    return np.asarray(colours[..., ::-1], np.uint8)


def rig() -> Picture:
    """One board, two cameras."""
    paint = gs.paint.Charuco(9, 7, 0.04, 0.03, "5X5_100", (0.02, 0.02))
    board = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.4, 0, 0.32], [0.0, 0, 0.32]]) - [0.2, 0.0, 0.16]
    c, s = np.cos(0.35), np.sin(0.35)
    tilted = board @ np.array([[1.0, 0, 0], [0, c, s], [0, -s, c]]).T
    things = [
        gs.Surface(tilted, FACE, reference=board, paint=paint),
        sheet((0.0, 0.5, 0.0), (2.0, 2.0, 0.0), gs.paint.Plain("#7d9a8a")),
    ]
    lights = [
        gs.AreaLight((-0.7, -1.2, 0.9), (0.0, 0.0, 0.0), (0.3, 0.3), 12.0, color=(1.2, 1.0, 0.8)),
        gs.AmbientLight(0.25, color=(0.85, 1.0, 1.15)),
    ]
    halves = []
    for x in (-0.33, 0.33):
        camera = gs.Camera.from_lens(
            (24.0, 32.0), 50.0, (SIZE[0] // 2 - 3, SIZE[1]), (x, -0.95, 0.12), (0.0, 0.0, 0.0),
            distortion=[-0.12, 0.02, 0.0, 0.0],
        )  # fmt: skip
        halves.append(developed(gs.render(things, camera, lights), 0.95))
    return np.concatenate([halves[0], np.full((SIZE[1], 6, 3), 255, np.uint8), halves[1]], axis=1)


def dusk() -> Array:
    """Surroundings (64, 128, 3) after sunset: blue overhead, an orange band low in the west."""
    v, u = np.mgrid[:64, :128]
    height = (31.5 - v) / 32.0
    glow = np.exp(-(((u - 96.0) / 20.0) ** 2))[..., None]
    low = np.exp(-3.5 * np.abs(height))[..., None]
    sky = np.array([0.13, 0.22, 0.5]) + low * (np.array([0.5, 0.32, 0.4]) + glow * [3.2, 1.3, 0.25])
    ground = np.array([0.12, 0.1, 0.1]) + low * glow * [0.4, 0.18, 0.06]
    return np.where(height[..., None] > 0.0, sky, ground)


def metals(surroundings: Array, white: float) -> Picture:
    """Steel from polished to blasted, and smaller balls of copper, gold and blue lacquer."""
    steel, copper, gold = (0.562, 0.565, 0.578), (0.955, 0.638, 0.538), (1.0, 0.782, 0.344)
    things = [sheet((0.0, 0.0, 0.0), (40.0, 40.0), gs.paint.Plain("#8d8478"))]
    for k, roughness in enumerate((0.12, 0.3, 0.55)):
        paint = gs.paint.Plain(steel, roughness, 1.0)
        things.append(ball((1.05 * (k - 1), 0.15 * k, 0.45), 0.45, paint))
    for x, paint in (
        (-0.62, gs.paint.Plain(copper, 0.2, 1.0)), (0.0, gs.paint.Plain(gold, 0.3, 1.0)),
        (0.62, gs.paint.Plain("#1f4fa8", 0.15)),
    ):  # fmt: skip
        things.append(ball((x + 0.1, -0.85, 0.2), 0.2, paint))
    lights = [gs.EnvironmentLight(image=surroundings, forward=(0.0, 1.0, 0.0), occlusion=True)]
    camera = look((0.3, -4.5, 2.05), (0.05, -0.05, 0.38), 50.0)
    return developed(gs.render(things, camera, lights), white)


def penumbra(size: float) -> Picture:
    """A comb and a ball between a warm and a cool lamp, each ``size`` wide."""
    pale = gs.paint.Plain(0.7)
    things = [
        sheet((0.0, 0.0, 0.0), (9.0, 9.0), pale),
        sheet((0.0, 2.9, 0.0), (9.0, 4.0, 0.0), pale),
    ]
    things += [box((0.22 * k - 1.0, 0.25, 0.5), (0.05, 0.05, 0.5), pale) for k in range(6)]
    things.append(box((-0.45, 0.25, 1.05), (0.66, 0.07, 0.05), pale))
    things.append(ball((0.75, 0.0, 0.35), 0.35, gs.paint.Plain(0.7)))
    lights = [
        gs.AreaLight((-1.6, 2.2, 2.9), (0.0, 0.0, 0.2), (size, size), 60.0, color=HALOGEN),
        gs.AreaLight(
            (1.9, 1.9, 2.9), (0.0, 0.0, 0.2), (size, size), 60.0, color=gs.blackbody(20000)
        ),
        gs.AmbientLight(0.08, occlusion=True),
    ]
    frame = gs.render(things, look((0.2, -3.8, 2.5), (0.0, -0.1, 0.42), 46.0), lights)
    return developed(frame, 1.05)


def yard(occlusion: bool) -> Picture:
    """Stairs, a gate, pipes and boxes under a sky bluer than the ground."""
    stone, clay, wood = (gs.paint.Plain(own) for own in ("#d9cdb8", "#c4714a", "#8fae9b"))
    things = [sheet((0.0, 0.0, 0.0), (40.0, 40.0), gs.paint.Plain("#cfc8bd"))]
    things += [box((-1.05, 0.2 * k, 0.09 * (k + 1)), (0.45, 0.1, 0.09 * (k + 1)), stone)
               for k in range(6)]  # fmt: skip
    things += [box((x, 0.55, 0.5), (0.12, 0.12, 0.5), wood) for x in (0.0, 0.9)]
    things.append(box((0.45, 0.55, 1.1), (0.7, 0.2, 0.1), wood))
    pipe = np.array([[0.0, 0.0], [0.16, 0.0], [0.16, 0.55], [0.1, 0.55], [0.1, 0.05], [0.0, 0.05]])
    things += [turned_body(pipe, (0.15 + 0.36 * k, -0.45, 0.0), clay) for k in range(3)]
    things.append(box((-0.3, -0.55, 0.11), (0.16, 0.11, 0.11), gs.paint.Plain("#c9a227"), 0.5))
    lights = [gs.EnvironmentLight(1.0, 0.35, occlusion=occlusion)]
    frame = gs.render(things, look((1.6, -3.9, 2.3), (-0.15, 0.2, 0.5), 46.0), lights)
    return developed(frame, 0.95)


def depth_of_field(f_number: float | None) -> Picture:
    """Coded targets in a row, focused on the third."""
    floor = gs.paint.Checker(0.05, dark="#6b7f8a", light="#c3c8c4")
    things = [
        sheet((0.0, 0.4, 0.0), (4.0, 4.0), floor),
        sheet((0.0, 3.5, 0.0), (4.0, 4.0, 0.0), gs.paint.Plain("#8c9aa3")),
    ]
    cards = ("#d9534a", "#e08a2e", "#e3c33b", "#6fae5a", "#4aa3a8", "#5a78c2", "#9a62b0")
    for k, card in enumerate(cards):
        marker = gs.paint.Aruco(np.array([[0.06, 0.06]]), (k,), 0.075, light=0.9, ground=card)
        place = (0.13 * (k - 3) + 0.05, 0.22 * (k - 2), 0.06)
        things.append(sheet(place, (0.06, 0.06, 0.0), marker, 0.25))
    lights = [
        gs.AreaLight((-0.9, -1.3, 1.6), (0.0, 0.3, 0.0), (0.4, 0.4), 22.0, color=(1.15, 1.0, 0.85)),
        gs.AmbientLight(0.35),
    ]
    camera = look((0.28, -0.95, 0.3), (0.0, 0.12, 0.03), 50.0)
    lens = None
    if f_number is not None:
        lens = gs.Lens(f_number=f_number, focal_length=0.05, focus_distance=1.0, blades=7)
    return developed(gs.photograph(things, camera, lights, lens=lens), 0.9)


def wheel(shutter: gs.Shutter | None) -> Picture:
    """A wheel of twelve spokes at ten turns a second."""
    wheel_of_hues = np.uint8([[[15 * k, 190, 225] for k in range(12)]])
    hues = cv2.cvtColor(wheel_of_hues, cv2.COLOR_HSV2RGB)[0].tolist()
    paints = [gs.paint.Plain("#" + bytes(hue).hex()) for hue in hues]

    def at(time: float) -> list[gs.Surface]:
        things = [sheet((0.0, 0.3, 0.0), (3.0, 3.0, 0.0), gs.paint.Plain("#b9bfc4"))]
        for k, paint in enumerate(paints):
            blade = SQUARE[:, [0, 2, 1]] * [0.36, 0.0, 0.06] + [0.5, 0.0, 0.0]
            angle = k * np.pi / 6.0 + 20.0 * np.pi * time
            c, s = np.cos(angle), np.sin(angle)
            blade = blade @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
            things.append(gs.Surface(blade, FACE, paint=paint))
        return things

    lights = [
        gs.AreaLight((-1.2, -2.0, 1.6), (0.0, 0.0, 0.0), (0.5, 0.5), 40.0, color=(1.1, 1.0, 0.9)),
        gs.AmbientLight(0.3),
    ]
    camera = look((0.0, -3.0, 0.0), (0.0, 0.0, 0.0), 42.0)
    if shutter is None:
        return developed(gs.render(at(0.004), camera, lights), 1.1)
    return developed(gs.photograph(at, camera, lights, shutter=shutter), 1.1)


def chart(balanced: bool) -> Picture:
    """A chart of 24 colours under a halogen lamp, for a camera set to daylight or to the lamp."""
    things = [sheet((0.0, 0.02, 0.0), (3.0, 3.0, 0.0), gs.paint.Plain(0.35)),
              sheet((0.0, 0.0, 0.0), (0.33, 0.225, 0.0), gs.paint.Plain(0.03))]  # fmt: skip
    for k, patch in enumerate(CHART):
        place = (0.105 * (k % 6 - 2.5), -0.001, 0.105 * (1.5 - k // 6))
        things.append(sheet(place, (0.045, 0.045, 0.0), gs.paint.Plain(f"#{patch}")))
    lamp = gs.AreaLight((-0.9, -1.6, 0.9), (0.0, 0.0, 0.0), (0.2, 0.2), 20.0, color=HALOGEN)
    frame = gs.render(things, look((0.1, -1.02, 0.08), (0.0, 0.0, 0.0)), [lamp])
    return developed(frame, 0.75, HALOGEN) if balanced else developed(frame, 1.1, DAYLIGHT)


def mosaic() -> Picture:
    """A part of a picture, six times enlarged: radiance, raw mosaic with noise, demosaiced."""
    paint = gs.paint.Speckle(2.6e-3, 0.5, 2e-4, dot="#b0201c", ground="#f4f0e6", seed=4)
    target = sheet((0.0, 0.0, 0.0), (0.05, 0.05), paint)
    size = (SIZE[0] // 6, SIZE[1] // 6)
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 50.0, size, (0.0, 0.0, 0.05), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)
    )
    frame = gs.photograph([target], camera, lens=gs.Lens(psf=gs.psf.Gaussian(0.6)))
    chip = {"bits": 8, "full_scale": 1.0, "full_well": 1500.0, "bayer": "RGGB", "gamma": "srgb"}
    raw = gs.Sensor.preset("imx174", **chip).expose(frame)
    colour = gs.Sensor.preset("imx174", channels="rgb", demosaic="malvar", **chip).expose(frame)
    steps = [developed(frame, 1.0), np.repeat(raw[..., None], 3, axis=2), colour]
    third = size[0] // 3
    parts = [np.uint8(image)[:, k * third : (k + 1) * third] for k, image in enumerate(steps)]
    return np.kron(np.concatenate(parts, axis=1), np.ones((6, 6, 1), np.uint8))


def label() -> Picture:
    """The label of a can, which its OBJ file lays round it."""
    image = np.full((512, 1024, 3), (244, 238, 222), np.uint8)
    cv2.rectangle(image, (0, 0), (1023, 95), (176, 32, 28), -1)
    cv2.rectangle(image, (0, 416), (1023, 511), (31, 79, 140), -1)
    cv2.putText(
        image, "gpusim", (648, 210), cv2.FONT_HERSHEY_DUPLEX, 2.0, (30, 34, 40), 4, cv2.LINE_AA
    )
    for k, patch in enumerate(CHART):
        x, y = 652 + 40 * (k % 6), 245 + 40 * (k // 6)
        cv2.rectangle(image, (x, y), (x + 31, y + 31), tuple(bytes.fromhex(patch)), -1)
    return image


def can() -> Picture:
    """A can and its label, laid round it by the texture coordinates of an OBJ file."""
    n = 96
    angle = 2.0 * np.pi * np.arange(n) / n
    lines = [f"v {0.33 * np.cos(a):.6f} {0.33 * np.sin(a):.6f} {z}" for z in (0, 1) for a in angle]
    lines += [f"vt {k / n:.6f} {v}" for v in (0, 1) for k in range(n + 1)]
    for k in range(n):
        a, b, u = k + 1, (k + 1) % n + 1, k + 1
        lines.append(f"f {a}/{u} {b}/{u + 1} {n + b}/{n + u + 2}")
        lines.append(f"f {a}/{u} {n + b}/{n + u + 2} {n + a}/{n + u + 1}")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "can.obj").write_text("\n".join(lines))
        side = gs.mesh.read_textured(Path(folder, "can.obj"))
    image = label()
    atlas = gs.Atlas(side.uv[:, :3] * [image.shape[1], image.shape[0]])
    paint = gs.paint.Image(image, 1.0, gamma="srgb", roughness=0.3)
    steel = gs.paint.Plain((0.562, 0.565, 0.578), 0.25, 1.0)
    body = np.array([[0.0, 0.001], [0.325, 0.001], [0.325, 1.03], [0.0, 1.03]])
    things = [
        sheet((0.0, 0.0, 0.0), (40.0, 40.0), gs.paint.Plain("#b9b2a6")),
        gs.Surface(side.points, side.faces, paint=paint, frames={"surface": atlas}),
        turned_body(body, (0.0, 0.0, 0.0), steel, 96),
        box((-1.0, 0.35, 0.3), (0.3, 0.3, 0.3), gs.paint.Plain("#1f4f8c", 0.3), 0.4),
        ball((0.85, 0.1, 0.25), 0.25, gs.paint.Plain((0.955, 0.638, 0.538), 0.2, 1.0)),
    ]
    lights = [
        gs.AreaLight(
            (-2.0, -1.5, 3.0), (0.0, 0.0, 0.4), (0.8, 0.8), 60.0, color=gs.blackbody(4500)
        ),
        gs.EnvironmentLight(image=0.5 * studio(), forward=(0.0, 1.0, 0.0)),
    ]
    frame = gs.render(things, look((0.25, -3.6, 2.0), (-0.05, 0.0, 0.5), 50.0), lights)
    return developed(frame, 1.6)


PICTURES: dict[str, Callable[[], Picture]] = {
    "crane": crane,
    "plate": lambda: developed(plate(), 0.85),
    "plate_truth": plate_truth,
    "plate_hole_maps": lambda: maps("plate_hole_stereo", "field-strain.png"),
    "vessel_maps": lambda: maps("curved_stereo", "wall-strain.png"),
    "tensile_maps": lambda: maps("tensile", "field-strain.png"),
    "tensile_load": lambda: maps("tensile", "load-path.png"),
    "coil": lambda: exposures("coil", "side", 720),
    "ring": lambda: exposures("ring", "front", 480),
    "rigid_shift_parts": lambda: maps(
        "rigid_shift", "field-parts-displacements.png", gs.explain, 1 / 3
    ),
    "steel": lambda: metals(studio(), 1.7),
    "dusk": lambda: metals(dusk(), 1.0),
    "chart_daylight": lambda: chart(False),
    "chart_halogen": lambda: chart(True),
    "rig": rig,
    "mosaic": mosaic,
    "can": can,
    "lamp_small": lambda: penumbra(0.05),
    "lamp_large": lambda: penumbra(0.9),
    "yard_open": lambda: yard(False),
    "yard_hidden": lambda: yard(True),
    "pinhole": lambda: depth_of_field(None),
    "f1.4": lambda: depth_of_field(1.4),
    "vibration": lambda: cv2.merge(3 * vibrating("shaker_plate", 12.0, (720, 540), 0.3)[-1:]),
    "still": lambda: wheel(None),
    "motion": lambda: wheel(gs.Shutter(3e-3)),
}


FILMS = {"vibration": lambda: vibrating("shaker_plate", 12.0, (320, 240), 1.0)}


def main(names: list[str]) -> None:
    """Render and write the pictures and films named, or all."""
    if unknown := [name for name in names if name not in PICTURES]:
        sys.exit(f"gallery: got {', '.join(unknown)}; expected some of {', '.join(PICTURES)}")
    OUT.mkdir(exist_ok=True)
    for name in names or PICTURES:
        if name in FILMS:
            path = gs.write_video(OUT / f"{name}.gif", FILMS[name](), frame_rate=20.0)
            assert path.stat().st_size < LARGEST_FILM, f"{path}: {path.stat().st_size} bytes"
            print(f"wrote {path.relative_to(ROOT)}")
        path = OUT / f"{name}.jpg"
        image = np.ascontiguousarray(PICTURES[name]()[..., ::-1])
        cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 85])
        assert path.stat().st_size < LARGEST, f"{path}: {path.stat().st_size} bytes"
        print(f"wrote {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main(sys.argv[1:])
