"""Stages of an image against NumPy, from visible triangles to the correlation of subsets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Single
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device, Pair, Pairs, Tolerance, twin_check
from gpusim.measure.correlation.icgn import correlate, correlate_numpy
from gpusim.measure.correlation.image_pair import Pair as ImagePair
from gpusim.measure.correlation.image_pair import Subsets
from gpusim.measure.correlation.matching import Settings, Status
from gpusim.measure.correlation.warp import SHAPES
from gpusim.measure.images import SplineImage
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.resolve import EdgePixelPass, edges_twin
from gpusim.optics.frame import Band, scatter, scatter_twin
from gpusim.optics.geometry.view import View, look
from gpusim.optics.lens.convolution import (
    ConvolvePass,
    Target,
    accumulate,
    accumulate_twin,
    convolve_twin,
)
from gpusim.optics.lens.psf import Disc, sample
from gpusim.optics.light.lights import AreaLight, EnvironmentLight, Light, PointLight, SunLight
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.sensor.digital_numbers import scaled_on_device, scaled_twin
from gpusim.optics.sensor.emva1288 import Signal, emva_twin, expose_noisy
from gpusim.optics.sensor.sensor import Sensor
from gpusim.optics.shading.relighting import RelightingPass
from gpusim.optics.shading.scene_buffers import SceneBuffers, TriangleRecords
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import ShadingPass, shade_twin
from gpusim.optics.shading.tile_light import LightTiles, TileLightPass, light_tiles_twin
from gpusim.optics.shading.triangle_records import TRIANGLE, triangle_records
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.visibility_buffer import VertexBuffers, VisibilityBuffer, visibility_twin
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface
from gpusim.twin_checks.scenes import fields_setup, probe_setup, shadow_scene


def evaluated(setup: Setup, words: npt.NDArray[np.generic]) -> tuple[Float, Float]:
    """What records say, whatever their anchors and cells: of each triangle (T, 6), and at its
    corners (T, 3, 13) 1 / depth, paint coordinates, normal and how these change."""
    records = np.ascontiguousarray(words).view(np.uint32).reshape(-1).view(TRIANGLE)
    r = {name: records[name].astype(np.float64) for name in TRIANGLE.names or ()}
    each = np.concatenate([r["nx"][:, 3:], r["ny"][:, 3:], r["more"]], axis=1)
    d = setup.view.ideal - r["anchor"][:, None]
    size = setup.table.paints["cell"].astype(np.float64)[setup.view.paint][:, None, None]

    def plane(at: Float, across: Float, down: Float) -> tuple[Float, Float]:
        slope = np.stack([across, down], axis=1)
        same = np.broadcast_to(slope[:, None], (*d.shape[:2], *slope.shape[1:]))
        return at[:, None] + d @ slope, same

    w, change = plane(r["n0"][:, 3:], r["w"][:, :1], r["w"][:, 1:])
    st = r["st"]
    s, slope = plane(st[:, [0, 3]], np.c_[st[:, 1], r["t"][:, 0]], np.c_[st[:, 2], r["t"][:, 1]])
    n, turn = plane(r["n0"][:, :3], r["nx"][:, :3], r["ny"][:, :3])
    place = s / w + r["cell"][:, None] * size
    foot = (slope - (s / w)[:, :, None] * change) / w[..., None]
    featured = setup.table.paints["featured"][setup.view.paint] > 0
    place[~featured] = foot[~featured] = 0.0
    flat = [v.reshape(*v.shape[:2], -1) for v in (w, change, place, foot, n / w, turn)]
    return each, np.concatenate(flat, axis=2)


def _tile_probe(coloured: bool) -> Setup:
    """A floor and a wall of two planes, seen through a lens, under lamps of several kinds."""
    quad = np.array([[-1.2, -1.0], [1.1, -1.0], [1.1, 0.9], [-1.2, 0.9]])
    face = np.array([[0, 1, 2, 3]])
    floor = np.concatenate([quad, 0.1 * quad[:, :1]], axis=1)
    wall = np.stack([quad[:, 0], np.full(4, 0.9), 0.6 * (quad[:, 1] + 1.0) + 0.11], axis=1)
    surfaces = [Surface(floor, face, paint=Plain(0.4)), Surface(wall, face, paint=Plain(0.7))]
    camera = Camera.from_lens(
        (36.0, 72.0), 40.0, (211, 422), (0.3, -2.4, 1.1), (0.03, 0.45, 0.1),
        distortion=[0.05, -0.02, 1e-3, -2e-3],
    )  # fmt: skip
    lights: list[Light] = [
        AreaLight((-0.9, -1.4, 1.9), (0.0, 0.0, 0.1), (0.42, 0.23), 8.0),
        PointLight((0.8, -1.6, 1.4), 6.0),
        SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05),
        EnvironmentLight(0.3, 0.1, up=(0.1, 0.2, 1.0)),
    ]
    if coloured:
        lights = [replace(one, color=(1.0 + k, 2.0, 3.0 - 0.5 * k)) for k, one in enumerate(lights)]
    return Setup.build(look(surfaces, camera, lit=True), lights, 0.05)


def _drawn(shading: ShadingPass | RelightingPass, setup: Setup) -> Single:
    """Radiance (planes, H, W) of a view in one band."""
    camera = setup.view.camera
    band = Band.of(shading.buffers.device, 0, camera.height, shading.stride, len(setup.bands))
    shading.draw(band)
    shading.finish()
    shape = camera.height, shading.stride
    planes = [plane.read(np.float32, shape)[:, : camera.width] for plane in band.planes]
    return np.stack(planes)


def _off_edges(setup: Setup, got: Single, want: Single) -> tuple[Single, Single]:
    """Radiances (planes, n) of pixels that no edge crosses: hardware and twin may see different
    triangles at the centre of others."""
    off = np.ones(want[0].size, bool)
    off[find_edge_pixels(setup.view).pixel] = False
    return got.reshape(len(got), -1)[:, off], want.reshape(len(want), -1)[:, off]


def near_an_edge(view: View, distance: float) -> Bool:
    """(H, W): pixel centres closer than ``distance`` px to any edge of any triangle."""
    camera = view.camera
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    near = np.zeros(x.shape, bool)
    for a, b in zip(
        view.screen.reshape(-1, 2), np.roll(view.screen, -1, axis=1).reshape(-1, 2), strict=True
    ):
        along = b - a
        t = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / (along @ along), 0.0, 1.0)
        near |= np.hypot(x - a[0] - t * along[0], y - a[1] - t * along[1]) < distance
    return near


def probe_view() -> View:
    """A small view with overlap, perspective and an odd size, for the twin checks."""
    rng = np.random.default_rng(5)
    points = np.array(
        [[-1.0, -0.8, 4.0], [1.1, -0.7, 5.0], [0.9, 0.9, 4.5], [-0.8, 0.7, 6.0],
         [-0.4, -1.0, 3.5], [0.7, 0.1, 3.8], [-0.2, 0.9, 7.0]]
    )  # fmt: skip
    points += rng.normal(size=points.shape) * 1e-3
    faces = np.array([[0, 3, 2, 1], [4, 6, 5, -1]])
    camera = Camera(57, 33, np.array([[61.0, 0.3, 27.7], [0.0, 60.0, 15.2], [0.0, 0.0, 1.0]]))
    return look([Surface(points, faces)], camera, lit=False)


@twin_check("optics/raster/id_buffer", "exact")
def _id_buffer(device: Device) -> Pairs:
    view = probe_view()
    got, want = VisibilityBuffer.of(device, view, 20).read(), visibility_twin(view)
    # the hardware snaps to 1/256 px: a pixel centre that close to an edge may fall either way
    apart = ~near_an_edge(view, 1.0 / 128.0)
    yield Pair(got[apart], want[apart])


@twin_check(
    "optics/shading/triangle_records", Tolerance(2e-6, 2e-5, "float32, of numbers of order one")
)
def _triangle_records(device: Device) -> Pairs:
    setup = probe_setup(fine=False)
    found = TriangleRecords.of(device, setup, VertexBuffers(device, setup.view, "records"))
    if found is None:
        raise TwinMismatch("optics/shading/triangle_records: nothing to compare")
    count, per = setup.view.count, TRIANGLE.itemsize // 16
    with device.recording("optics.records") as recording:
        found.make(recording)
    got = found.texels.read().reshape(-1, 4 * per)[:count]
    want = evaluated(setup, triangle_records(setup))
    for name, one, other in zip(("numbers", "values"), evaluated(setup, got), want, strict=True):
        yield Pair(one, other, part=name)


@twin_check("optics/shading/forward_pass", "pixel")
def _forward_pass(device: Device) -> Pairs:
    for setup in (probe_setup(), probe_setup(coloured=True)):
        want = shade_twin(setup, visibility_twin(setup.view))
        for deferred in (False, True):
            lines = None if deferred else BoardLines.of(setup.view, setup.traits.printed)
            buffers, tiles = SceneBuffers(device, setup, lines), LightTiles.of(setup)
            shading = ShadingPass(buffers, setup.view.camera.height, deferred, tiles=tiles)
            yield Pair(*_off_edges(setup, _drawn(shading, setup), want))


@twin_check("optics/shading/tile_light", "pixel")
def _tile_light(device: Device) -> Pairs:
    for setup in (_tile_probe(False), _tile_probe(True)):
        tiles = LightTiles.of(setup, tolerance=np.inf)
        assert tiles is not None
        work = TileLightPass(SceneBuffers(device, setup), tiles)
        with device.recording("optics.light_tiles") as recording:
            work.record(recording)
        got = work.texels.read().reshape(*work.shape, len(setup.bands), 4)
        yield Pair(got, light_tiles_twin(setup, tiles))


@twin_check("optics/shading/relighting")
def _relighting(device: Device) -> Pairs:
    surfaces, camera, lights = shadow_scene()
    plain, blue = (
        [surfaces[0], *(replace(own, paint=Plain(albedo)) for own in surfaces[1:])]
        for albedo in (0.6, (0.1, 0.3, 0.9))
    )
    for shown in (surfaces, plain, blue):
        view = look(shown, camera, lit=True)
        setup = Setup.build(view, lights, 0.05, shown, device)
        buffers = SceneBuffers(device, setup, BoardLines.of(view, setup.traits.printed))
        shading = ShadingPass(buffers, camera.height, tiles=LightTiles.of(setup), marked=True)
        want = shade_twin(setup, visibility_twin(view))
        sample = 2.5 / SAMPLES * float(want.max())
        outlines = Tolerance(sample, 2e-5, "one sample falls to the other side of an outline")
        yield Pair(*_off_edges(setup, _drawn(RelightingPass(shading), setup), want), outlines)


@twin_check("optics/edge_pixels/resolve", "pixel")
def _resolve(device: Device) -> Pairs:
    setups = (probe_setup(), fields_setup(True), fields_setup(False), probe_setup(coloured=True))
    for setup in setups:
        edges = find_edge_pixels(setup.view)
        camera = setup.view.camera
        start = np.full((len(setup.bands), camera.height, camera.width), 0.25, np.float32)
        out = tuple(device.buffer(plane, "edges.radiance") for plane in start)
        edge_pass = EdgePixelPass(SceneBuffers(device, setup), edges)
        edge_pass.find()
        edge_pass.host_pass()
        edge_pass.write([Band(0, camera.height, camera.width, out)])
        got = np.stack([plane.read(np.float32, start.shape[1:]) for plane in out])
        yield Pair(got, edges_twin(setup, edges, start))


@twin_check("optics/edge_pixels/scatter", "exact")
def _scatter(device: Device) -> Pairs:
    random = np.random.default_rng(11)
    there = random.uniform(0.0, 1.0, (19, 32)).astype(np.float32)
    places = random.permutation(there.size)[:201]
    values = random.uniform(-2.0, 2.0, len(places)).astype(np.float32)
    target = device.buffer(there, "scatter.radiance")
    scatter(device, places, values, target)
    yield Pair(target.read(np.float32, there.shape), scatter_twin(there, places, values))


@twin_check("optics/lens/convolution", Tolerance(5e-6, 1e-5, "float32 sums of some hundred"))
def _convolution(device: Device) -> Pairs:
    kernel = sample(Disc(1.3), fill_factor=0.8, n=3)
    columns, rows = 37, 22  # blocks of four that aren't full, in both directions
    shape = (rows * 3 + 2 * kernel.halo, columns * 3 + 2 * kernel.halo)
    cells = np.random.default_rng(5).uniform(0.0, 1.0, shape).astype(np.float32)
    work = ConvolvePass(device, kernel, columns, rows)
    out = device.empty(4 * 3 * (40 * rows + 5), "convolve.out")
    work.run(device.buffer(cells, "convolve.cells"), columns, rows, Target(out, 5, 40))
    got = out.read(np.float32)[5 : 5 + 40 * rows].reshape(rows, 40)[:, :columns]
    yield Pair(got, convolve_twin(kernel, cells))


@twin_check("optics/lens/accumulation")
def _accumulation(device: Device) -> Pairs:
    random = np.random.default_rng(8)
    values = random.uniform(-1.0, 1.0, (23, 40)).astype(np.float32)
    there = random.uniform(-1.0, 1.0, (30, 50)).astype(np.float32)
    for gain in (False, True):
        sums = device.buffer(there, "accumulate.sums")
        place = Target(sums, 4 * 50 + 7, 50)
        accumulate(
            device, device.buffer(values, "accumulate.values"), 40, (23, 37), place, weight=0.3,
            gain=gain,
        )  # fmt: skip
        want = there.astype(np.float64)
        want[4:27, 7:44] = accumulate_twin(want[4:27, 7:44], values[:, :37], 0.3, gain)
        yield Pair(sums.read(np.float32, (30, 50)), want)


@twin_check("optics/sensor/sensor", "exact")
def _sensor(device: Device) -> Pairs:
    radiance = np.random.default_rng(3).uniform(-0.1, 1.2, (33, 64)).astype(np.float32)
    for bits in (8, 12):
        sensor = Sensor(bits, 0.9)
        buffer = device.buffer(radiance, "sensor.radiance")
        got = scaled_on_device(sensor, device, [Band(0, 33, 64, (buffer,))], 57)
        yield Pair(got, scaled_twin(sensor, radiance[:, :57]), part=f"{bits} bit")


@twin_check("optics/sensor/emva1288")
def _emva1288(device: Device) -> Pairs:
    radiance = np.random.default_rng(4).uniform(-0.02, 1.1, (29, 64)).astype(np.float32)
    radiance[:7] *= 0.01  # so dark that electrons are counted
    signal = Signal(12, 3000.0, 1.3, 40.0, 3100.0, True, 2.0, 2.5, 1.5, 0.01, 1.0,
                    (0.6, 1.0, 1.0, 0.5), 77, 5, 3)  # fmt: skip
    band = Band(3, 29, 64, (device.buffer(radiance, "emva.radiance"),))
    got = expose_noisy(device, signal, band, 57, np.uint16)
    want = emva_twin(signal, radiance[:, :57], 3)
    quantiles = "the last bit of a logarithm may make an electron (1.3 grey values) more"
    yield Pair(got.astype(float), want.astype(float), Tolerance(2.0, 0.0, quantiles))
    rare = Tolerance(2e-3, 0.0, "which happens to one pixel in some thousands")
    yield Pair([float(np.mean(got != want))], [0.0], rare, "share of pixels that differ")


@twin_check("measure/correlation/icgn")
def _icgn(device: Device) -> Pairs:
    """Subsets of a smooth pattern that is stretched, turned and shifted; every shape."""
    row, column = np.indices((57, 83), dtype=np.float64)

    def pattern(x: Float, y: Float) -> Float:
        result: Float = (
            np.sin(0.61 * x + 0.2 * y) + np.sin(0.17 * x - 0.73 * y) + np.sin(0.4 * x + 0.5 * y)
        )
        return result

    reference = SplineImage.from_image(pattern(column, row))
    deformed = SplineImage.from_image(
        0.6 * pattern(0.99 * column - 0.02 * row + 0.7, 0.01 * column + 1.01 * row - 0.4) + 3.0
    )
    points = np.array([[20.3, 21.8], [41.0, 30.5], [60.7, 35.2], [4.0, 30.0], [41.0, 55.0]])
    subsets = Subsets(ImagePair(reference, deformed), points, np.zeros((5, 2, 6)))
    for shape in SHAPES:
        settings = Settings(np.ones((21, 21)), shape, min_zncc=0.0)
        got, want = correlate(subsets, settings, device), correlate_numpy(subsets, settings)
        yield Pair(got.status, want.status, "exact", f"{shape}.status")
        good = want.status == Status.OK
        steps = Tolerance(2e-5, 0.0, "px: float32 sums; a step more or less where it stops")
        yield Pair(got.coefficients[good], want.coefficients[good], steps, f"{shape}.coefficients")
        sums = Tolerance(2e-6, 0.0, "float32 sums")
        yield Pair(got.zncc[good], want.zncc[good], sums, f"{shape}.zncc")
