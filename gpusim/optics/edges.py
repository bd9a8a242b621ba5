"""Edge pixels: exact polygon areas of every triangle over the pixel, from front to back.

A triangle that nothing hides takes exactly the area of its polygon inside the pixel; the rest is
shared by partly hidden triangles and the background in proportion to a 16 x 32 sample mask. A
sliver that falls between the samples is seen or hidden as a whole, as its centroid is
(Carpenter, "The A-buffer", SIGGRAPH 1984, with exact areas in place of counts where they are
known). A strip between the samples that nothing in front covers belongs to the nearest hidden
triangle at its centroid, else to the background. The twin repeats the shader's steps in float64.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, compare, twin_check
from gpusim.optics.albedo import mean_albedo
from gpusim.optics.binning import EdgePixels, bin_edges
from gpusim.optics.bitmap import BITMAP, mean_over_polygons
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.edge_turns import grazing_turns, shadow_turns, speckle_turns
from gpusim.optics.pattern import LOOP_TURNS
from gpusim.optics.setup import Setup, probe_setup, radiance_of
from gpusim.optics.shade import Tables
from gpusim.optics.speckle import ROWS as SPECKLE_ROWS
from gpusim.optics.view import FIXED

__all__ = ["EdgePass", "edges_twin"]

Array = npt.NDArray[np.float64]
ROWS, COLUMNS = 16, 32
SMALLEST = 1e-9
THIN = 5e-4
"""Open area between all samples that is looked into; less of it is a seam between neighbours."""
DEEPEST = 128
"""Triangles over a pixel beyond which the host resolves it; fewer where patterns are dense."""

SHIFT = ((np.arange(ROWS) * 7) % ROWS + 0.5) / ROWS


class EdgePass:
    """The edge pixels of one view on the device."""

    def __init__(self, tables: Tables, edges: EdgePixels) -> None:
        # about what one triangle takes: clipping and samples, then its features' corners
        table, fine = tables.setup.table, tables.setup.constants([1], False)["fine"]
        turns = 200 + table.most_in_a_cell * (2000 if fine else 50) + speckle_turns(table)
        turns += 3000 if (tables.setup.groups == BITMAP).any() else 0
        each = turns + grazing_turns(tables.setup, edges) + shadow_turns(tables.setup, edges)
        deep = edges.depth > np.minimum(DEEPEST, LOOP_TURNS // each)
        self._deep = edges.select(deep)
        self._deep_values = _resolve(tables.setup, self._deep).astype(np.float32)
        edges = edges.select(~deep)
        self.tables, self.edges = tables, edges
        count = len(edges.pixel)
        lists = np.zeros(2 * (count + 1) + len(edges.triangle), np.uint32)
        lists[0 : 2 * count : 2] = edges.pixel
        lists[1 : 2 * count + 2 : 2] = edges.start + 2 * (count + 1)
        lists[2 * (count + 1) :] = edges.triangle
        self._lists = tables.device.buffer(lists, "edges.lists")

    def record(
        self, recording: Recording, radiance: Buffer, row0: int, rows: int, stride: int
    ) -> None:
        """Resolve the edge pixels of a band of rows in place; ``stride`` px from row to row."""
        setup = self.tables.setup
        width = setup.view.camera.width
        first, last = np.searchsorted(self.edges.pixel, [row0 * width, (row0 + rows) * width])
        if first == last:
            return
        groups = np.unique(setup.groups).tolist()
        constants = setup.constants(groups, bool(setup.shiny.any()))
        kernel = self.tables.device.kernel("optics/edges", constants=constants)
        bindings = kernel.bind(
            params={
                "rays": self.tables.rays(),
                "width": width,
                "stride": stride,
                "row0": row0,
                "background": setup.background,
            },
            range={
                "first": first,
                "count": last - first,
                "sides": 3,
                "corners": 4,
                "mask_rows": ROWS,
                "hard_rows": 2 * SPECKLE_ROWS,
                "thin": THIN,
            },
            lists=self._lists,
            radiance=radiance,
            **self.tables.shared(),
            **self.tables.shadows.bindings(),
            gloss_table=self.tables.gloss,
        )
        recording.dispatch(kernel, bindings, threads=(int(last - first),))

    def write_deep(self, radiance: Buffer, row0: int, rows: int, stride: int) -> None:
        """Write the few pixels that the host resolved; call it once the recording is submitted."""
        width = self.tables.setup.view.camera.width
        first, last = np.searchsorted(self._deep.pixel, [row0 * width, (row0 + rows) * width])
        for k in range(first, last):
            row, column = divmod(int(self._deep.pixel[k]), width)
            place = (row - row0) * stride + column
            radiance.write(self._deep_values[k : k + 1], 4 * place)


def edges_twin(
    setup: Setup, edges: EdgePixels, radiance: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """A copy of ``radiance`` (H, W) with the edge pixels resolved."""
    result = radiance.copy()
    result.reshape(-1)[edges.pixel] = _resolve(setup, edges)
    return result


def _resolve(setup: Setup, edges: EdgePixels) -> Array:
    """Radiance of the edge pixels."""
    view, width = setup.view, setup.view.camera.width
    count = len(edges.pixel)
    covered = np.zeros((count, ROWS), np.uint32)
    opened = np.full(count, ROWS * COLUMNS)
    free_area, free_light = np.zeros(count), np.zeros(count)
    free_moment = np.zeros((count, 2))
    hidden_count, hidden_light = np.zeros(count), np.zeros(count)
    corners_of = np.rint(view.screen * FIXED) / FIXED
    depth = edges.depth
    for k in range(int(depth.max(initial=0))):
        strip = (hidden_count == 0) & (free_area < 1.0 - THIN)
        entry = np.flatnonzero((depth > k) & ((opened > 0) | strip))
        triangle = edges.triangle[edges.start[entry] + k]
        pixel = edges.pixel[entry]
        at = np.stack([pixel % width, pixel // width], axis=1).astype(np.float64)
        planes = _half_planes(corners_of[triangle] - at[:, None])
        polygon = _clip_square(planes)
        area, centroid = _moments(polygon)
        keep = area > SMALLEST
        entry, triangle, at, planes = entry[keep], triangle[keep], at[keep], planes[keep]
        polygon, area, centroid = polygon[keep], area[keep], centroid[keep]
        bits = _mask(planes)
        own = np.bitwise_count(bits).sum(axis=1).astype(np.int64)
        seen = np.bitwise_count(bits & ~covered[entry]).sum(axis=1).astype(np.int64)
        visible = seen == own
        covered[entry] |= bits
        sliver = np.flatnonzero(own == 0)
        if len(sliver):
            r = np.clip(np.floor((centroid[sliver, 1] + 0.5) * ROWS), 0, ROWS - 1).astype(int)
            c = np.clip(np.floor((centroid[sliver, 0] + 0.5) * COLUMNS), 0, COLUMNS - 1)
            bit = np.uint32(1) << c.astype(np.uint32)
            visible[sliver] = (covered[entry[sliver], r] & bit) == 0
            doubtful = sliver[~visible[sliver]]
            visible[doubtful] = ~_is_covered(
                corners_of, edges, entry[doubtful], k, at[doubtful] + centroid[doubtful]
            )
        between = np.flatnonzero(~visible & (own > 0) & (opened[entry] == 0))
        gap = -free_moment[entry[between]] / (1.0 - free_area[entry[between]])[:, None]
        reach = np.sum(planes[between, :, :2] * gap[:, None], axis=2) + planes[between, :, 2]
        seen[between[(reach >= 0.0).all(axis=1)]] = 1
        opened[entry] = np.maximum(opened[entry] - seen, 0)
        keep = visible | (seen > 0)
        entry, triangle, at, area = entry[keep], triangle[keep], at[keep], area[keep]
        centroid = centroid[keep]
        light = _light(setup, triangle, at, polygon[keep], centroid, area)
        visible, seen = visible[keep], seen[keep]
        free_area[entry] += np.where(visible, area, 0.0)
        free_moment[entry] += np.where(visible, area, 0.0)[:, None] * centroid
        free_light[entry] += np.where(visible, area * light, 0.0)
        hidden_count[entry] += np.where(visible, 0, seen)
        hidden_light[entry] += np.where(visible, 0.0, seen * light)
    hidden_light += opened * setup.background
    hidden_count += opened
    beyond = (hidden_count == 0) & (free_area < 1.0 - THIN)
    hidden_light[beyond], hidden_count[beyond] = setup.background, 1.0
    rest = np.maximum(1.0 - free_area, 0.0)
    value = free_light / np.maximum(free_area, 1.0)
    some = hidden_count > 0
    value[some] += rest[some] * hidden_light[some] / hidden_count[some]
    bare = ~some & (free_area < 1.0)
    value[bare] = free_light[bare] / free_area[bare]
    result: Array = value
    return result


def _is_covered(
    corners: Array, edges: EdgePixels, entry: npt.NDArray[np.int64], k: int, at: Array
) -> npt.NDArray[np.bool_]:
    """Whether points (n, 2) px lie inside one of the first k triangles of their edge pixels."""
    triangle = edges.triangle[edges.start[entry][:, None] + np.arange(k)]
    v = corners[triangle] - at[:, None, None]
    w = np.roll(v, -1, axis=2)
    side = v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]
    inside = (side > 0.0).all(axis=2) | (side < 0.0).all(axis=2)
    result: npt.NDArray[np.bool_] = inside.any(axis=1)
    return result


def _light(
    setup: Setup,
    triangle: npt.NDArray[np.int64],
    at: Array,
    polygon: Array,
    centroid: Array,
    area: Array,
) -> Array:
    """Radiance of clipped polygons: mean albedo x light at the centroid."""
    x, y = (at + centroid).T
    paint = setup.view.paint[triangle]
    albedo = setup.table.paints["ground"][paint].astype(np.float64)
    featured = setup.table.paints["featured"][paint]
    # all of a polygon through the cubic of its pixel
    ideal = _undistorted(setup, at, at[:, None] + np.concatenate([centroid[:, None], polygon], 1))
    rows = np.flatnonzero((featured > 0) & (featured < BITMAP))
    if len(rows):
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, ideal[rows, :1])
        corners, w = _paint_positions(setup, own, ideal[rows, 1:])
        albedo[rows] = mean_albedo(
            setup.table, paint[rows], setup.cell[own], middle[:, 0], corners - middle, w / w0
        )
    for number, image in setup.bitmaps.images.items():
        rows = np.flatnonzero(paint == number)
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, ideal[rows, :1])
        corners, w = _paint_positions(setup, own, ideal[rows, 1:])
        albedo[rows] = mean_over_polygons(
            image, image.ground, setup.cell[own], middle[:, 0], corners - middle, w / w0
        )
    printed = np.zeros(len(albedo))
    rows = np.flatnonzero((featured == 1) & setup.shiny[triangle])
    if len(rows):
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, (at + centroid)[rows][:, None])
        corners, w = _paint_positions(setup, own, at[rows, None] + polygon[rows])
        printed[rows] = mean_albedo(
            setup.table.mask(), paint[rows], setup.cell[own], middle[:, 0], corners - middle, w / w0
        )
    return radiance_of(setup, triangle, x, y, albedo, printed, np.sqrt(area))


def _undistorted(setup: Setup, pixel: Array, at: Array) -> Array:
    """Ideal positions of image positions (n, V, 2) in pixels (n, 2)."""
    bends = distortion_map(setup.view.camera)
    if bends is None:
        return at
    owner = np.repeat(pixel.astype(np.int64), at.shape[1], axis=0)
    flat = at.reshape(-1, 2)
    return (flat + bends.evaluate(owner, flat - owner)[0]).reshape(at.shape)


def _paint_positions(
    setup: Setup, triangle: npt.NDArray[np.int64], pixels: Array
) -> tuple[Array, Array]:
    """Paint positions (n, V, 2) of ideal positions (n, V, 2), and 1 / z (n, V) to scale."""
    d = pixels - setup.anchor[triangle][:, None]
    planes = setup.planes[triangle][:, :3]
    values = d @ np.swapaxes(planes[:, :, :2], 1, 2) + planes[:, None, :, 2]
    return values[..., :2] / values[..., 2:], values[..., 2]


def _half_planes(corners: Array) -> Array:
    """(n, 3, 3): a x + b y + c >= 0 inside the triangles (n, 3, 2)."""
    v, w = corners, np.roll(corners, -1, axis=1)
    planes = np.stack(
        [v[..., 1] - w[..., 1], w[..., 0] - v[..., 0],
         v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]], axis=-1
    )  # fmt: skip
    result: Array = planes * np.where(planes[..., 2].sum(axis=1) > 0.0, 1.0, -1.0)[:, None, None]
    return result


def _clip_square(planes: Array) -> Array:
    """The unit square cut by three half planes: (n, 8, 2), padded by repeating a vertex."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    n = len(planes)
    polygon = np.zeros((n, 8, 2))
    polygon[:, :4] = square
    count = np.full(n, 4)
    rows = np.arange(n)
    for k in range(3):
        d = planes[:, k]
        clipped, size = np.zeros_like(polygon), np.zeros(n, np.int64)
        a = polygon[rows, np.maximum(count - 1, 0)]
        da = np.sum(d[:, :2] * a, axis=1) + d[:, 2]
        for i in range(7):
            active = i < count
            b = polygon[:, i]
            db = np.sum(d[:, :2] * b, axis=1) + d[:, 2]
            crossing = active & ((da < 0.0) != (db < 0.0)) & (size < 8)
            t = np.where(crossing, da / np.where(crossing, da - db, 1.0), 0.0)
            clipped[rows[crossing], size[crossing]] = (a + t[:, None] * (b - a))[crossing]
            size += crossing
            inside = active & (db >= 0.0) & (size < 8)
            clipped[rows[inside], size[inside]] = b[inside]
            size += inside
            a, da = np.where(active[:, None], b, a), np.where(active, db, da)
        polygon, count = clipped, size
    last = polygon[rows, np.maximum(count - 1, 0)]
    padding = np.arange(8) >= count[:, None]
    polygon[padding] = np.broadcast_to(last[:, None], polygon.shape)[padding]
    return polygon


def _moments(polygon: Array) -> tuple[Array, Array]:
    """Signed area (n,) and centroid (n, 2)."""
    origin = polygon[:, :1]
    a, b = polygon[:, 1:-1] - origin, polygon[:, 2:] - origin
    twice = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    total = twice.sum(axis=1)
    safe = np.where(total != 0.0, 3.0 * total, 1.0)[:, None]
    centroid = origin[:, 0] + np.sum(twice[..., None] * (a + b), axis=1) / safe
    return 0.5 * total, centroid


def _mask(planes: Array) -> npt.NDArray[np.uint32]:
    """(n, 16) rows of 32 samples inside three half planes."""
    y = (np.arange(ROWS) + 0.5) / ROWS - 0.5
    low = np.full((len(planes), ROWS), -1.0)
    high = np.ones((len(planes), ROWS))
    for k in range(3):
        a, b, c = (planes[:, k, i : i + 1] for i in range(3))
        value = b * y + c
        cut = -value / np.where(a != 0.0, a, 1.0)
        low = np.where(a > 0.0, np.maximum(low, cut), low)
        high = np.where(a < 0.0, np.minimum(high, cut), high)
        high = np.where((a == 0.0) & (value < 0.0), -1.0, high)
    first = np.clip(np.ceil((low + 0.5) * COLUMNS - SHIFT), 0, COLUMNS).astype(np.uint64)
    last = np.clip(np.ceil((high + 0.5) * COLUMNS - SHIFT), 0, COLUMNS).astype(np.uint64)
    one = np.uint64(1)
    bits = ((one << last) - one) & ~((one << first) - one)
    return np.where(low < high, bits, 0).astype(np.uint32)


@twin_check("optics/edges")
def _check(device: Device) -> None:
    setup = probe_setup()
    edges = bin_edges(setup.view)
    camera = setup.view.camera
    start = np.full((camera.height, camera.width), 0.25, np.float32)
    out = device.buffer(start, "edges.radiance")
    with device.recording("optics.edges") as recording:
        edge_pass = EdgePass(Tables(device, setup), edges)
        edge_pass.record(recording, out, 0, camera.height, camera.width)
    edge_pass.write_deep(out, 0, camera.height, camera.width)
    got = out.read(np.float32, start.shape)
    compare("optics/edges", got, edges_twin(setup, edges, start), "pixel")
