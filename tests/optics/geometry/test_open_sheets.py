"""Open surfaces whose other side lies behind them: pictures against finer pixels and the twin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels import resolve
from gpusim.optics.edge_pixels.resolve import EdgePixelPass

Array = npt.NDArray[np.float64]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 34.0, (600, 400), (0.2, -1.2, 0.5), (0.0, 0.0, 0.0))
BARREL = gs.Camera.from_lens(
    (36.0, 24.0), 34.0, (600, 400), (0.2, -1.2, 0.5), (0.0, 0.0, 0.0),
    distortion=[-0.28, 0.09, 0.002, -0.003, -0.01],
)  # fmt: skip


def swept(around: int, along: int, place: Callable[[Array, Array], Array], closed: bool) -> Array:
    """(n, 4, 3) quads of a surface of ``around`` x ``along``: over turns and places from 0 to 1."""
    turn = np.linspace(0.0, 1.0, around + 1)
    if closed:
        turn[-1] = 0.0
    a, b = np.meshgrid(turn, np.linspace(0.0, 1.0, along + 1), indexing="ij")
    points = np.moveaxis(place(a, b), 0, -1)
    quads = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    return np.stack(quads, axis=2).reshape(-1, 4, 3)


def surface_of(quads: Array) -> gs.Surface:
    points, number = np.unique(quads.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    return gs.Surface(points, number.reshape(-1, 4), gs.paint.Plain(0.5))


def tube(a: Array, b: Array) -> Array:
    angle = 2.0 * np.pi * a
    bend = 0.05 * b**2
    return np.stack([b - 0.5, 0.1 * np.cos(angle) - 0.1, 0.1 * np.sin(angle) - bend])


def bowl(a: Array, b: Array) -> Array:
    """Open towards the camera's side and up: its inside shows beside its outside."""
    angle, rise = 2.0 * np.pi * a, 0.12 * np.pi + 0.75 * np.pi * b
    radius = 0.3 * np.sin(rise)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), -0.3 * np.cos(rise)])


def scroll(a: Array, b: Array) -> Array:
    """One and a half turns round itself."""
    angle = 3.0 * np.pi * a
    radius = 0.1 + 0.1 * a
    return np.stack([0.6 * (b - 0.5), radius * np.cos(angle), radius * np.sin(angle)])


def corrugated(a: Array, b: Array) -> Array:
    x = b - 0.5 + 0.05 * np.sin(28.0 * np.pi * b)
    return np.stack([x, 0.12 * np.cos(14.0 * np.pi * b), 0.8 * (a - 0.5)])


def bumpy(a: Array, b: Array) -> Array:
    x, y, z = tube(a, b)
    more = 1.0 + 0.12 * np.sin(40.0 * b) * np.sin(10.0 * np.pi * a)
    return np.stack([x, (y + 0.1) * more - 0.1, z * more])


def surface(name: str) -> gs.Surface:
    quads = {
        "tube": lambda: swept(60, 60, tube, True),
        "bowl": lambda: swept(70, 40, bowl, True),
        "scroll": lambda: swept(80, 30, scroll, False),
        "bumpy": lambda: swept(90, 70, bumpy, True),
        "window": lambda: swept(60, 60, tube, True),
    }[name]()
    if name == "window":
        # through which the far side shows
        quads = quads[~((np.abs(quads[:, 0, 0]) < 0.1) & (quads[:, 0, 1] < -0.13))]
    return surface_of(quads)


NAMES = ["tube", "bowl", "scroll", "bumpy", "window"]


@pytest.mark.parametrize(
    ("name", "distortion"),
    [
        *((name, None) for name in NAMES),
        ("bowl", BARREL.distortion),
        *(
            pytest.param(name, BARREL.distortion, marks=pytest.mark.slow)
            for name in NAMES
            if name != "bowl"
        ),
    ],
)
def test_pictures_are_those_of_pixels_cut_finer(
    name: str, distortion: Array | None, device: Device
) -> None:
    """Of faces of other paints side by side: edges are everywhere, and all of them exact, also
    where tens of triangles on both sides of an outline lie over a pixel."""
    shown, parts = surface(name), 4
    paints = {f"paint {k}": gs.paint.Plain(0.1 + 0.15 * k) for k in range(6)}
    region = np.random.default_rng(2).integers(0, 6, len(shown.faces)).astype(np.int32)
    shown = gs.Surface(shown.points, shown.faces, paints, region=region)

    def picture(scale: int) -> Array:
        camera = gs.Camera.from_lens(
            (36.0, 24.0), 34.0, (600 * scale, 400 * scale), tuple(CAMERA.eye), (0.0, 0.0, 0.0),
            distortion=distortion,
        )  # fmt: skip
        frame = gs.render([shown], camera, background=0.02, device=device)
        own = np.array(frame.radiance, np.float64)
        return np.asarray(own.reshape(400, scale, 600, scale).mean(axis=(1, 3)))

    own, want = picture(1), picture(parts)
    off = np.abs(own - want) / want.max()
    print(f"{name}: worst {off.max():.1e}, RMS {np.sqrt(np.mean(off**2)):.1e}")
    # a few pixels under more triangles than are put in order by pairs
    limit = 1e-3 if name != "bumpy" or distortion is None else 0.1
    assert off.max() < limit and np.count_nonzero(off > 1e-3) < 10


def test_the_device_resolves_layers_of_fine_triangles(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those behind others that are seen as a whole lose what these hide, whatever is left."""
    left: list[tuple[int, int]] = []
    write = EdgePixelPass.write

    def noted(own: EdgePixelPass, bands: object) -> None:
        left.append((int((own._values[:, 1] > 0.0).sum()), len(own.edges.pixel)))
        write(own, bands)  # type: ignore[arg-type]

    monkeypatch.setattr(EdgePixelPass, "write", noted)
    shown = surface_of(swept(240, 120, tube, True))
    lamps = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]
    got = gs.render([shown], CAMERA, lamps, background=0.02, device=device).radiance
    want = gs.render([shown], CAMERA, lamps, background=0.02, backend="numpy").radiance
    print(f"{left[0][0]} of {left[0][1]} pixels left to the host")
    assert left[0][0] < 0.25 * left[0][1]
    assert np.abs(got - want).max() < 1.5 * resolve.MAX_ERROR * float(want.max())


def test_light_on_what_the_device_is_in_doubt_about(device: Device) -> None:
    """Folds of a finely corrugated sheet: of one doubtful triangle, which part of it shows?"""
    quads = swept(40, 420, corrugated, False)
    points, number = np.unique(quads.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    paints = {f"paint {k}": gs.paint.Plain(0.1 + 0.15 * k) for k in range(6)}
    region = np.random.default_rng(2).integers(0, 6, len(quads)).astype(np.int32)
    shown = gs.Surface(points, number.reshape(-1, 4), paints, region=region)
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 34.0, (300, 200), tuple(CAMERA.eye), (0.0, 0.0, 0.0)
    )  # fmt: skip
    lamps = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]
    got = gs.render([shown], camera, lamps, background=0.02, device=device).radiance
    want = gs.render([shown], camera, lamps, background=0.02, backend="numpy").radiance
    off = np.abs(got - want) / float(want.max())
    print(f"worst {off.max():.1e}, {np.count_nonzero(off > resolve.MAX_ERROR)} pixels")
    assert off.max() < 1e-3 and np.count_nonzero(off > resolve.MAX_ERROR) < 10
