"""Stages of the search for shadows and of ambient occlusion against NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Long
from gpusim.arrays.ragged import expand
from gpusim.gpu import Bound, Device, Pair, Pairs, Tolerance, Uniform, twin_check
from gpusim.optics.ambient import hemisphere_mask
from gpusim.optics.ambient.hemisphere_mask import hemisphere_masks, hemisphere_masks_twin
from gpusim.optics.ambient.silhouette_bvh import LOW, EdgeAdjacency, SamplePoints, SilhouetteBVH
from gpusim.optics.ambient.silhouette_search import (
    SilhouetteBuffers,
    contour_edges,
    faces_upward,
)
from gpusim.optics.light.quadrature import Lamp
from gpusim.optics.shading.scene_buffers import SceneBuffers, planes_on_device, planes_twin
from gpusim.optics.shadow.brute_force import (
    EdgeFunctions,
    edge_functions,
    shares_twin,
    visible_footprint,
)
from gpusim.optics.shadow.lamp_visibility import (
    CHUNK,
    LIT,
    PENUMBRA,
    UMBRA,
    OccluderSearch,
    VisibleShares,
)
from gpusim.optics.shadow.occluders import OccluderBVH, planes_of, refit_twin, single_sheets
from gpusim.optics.shadow.receiver_groups import (
    asking,
    cells_twin,
    entries_of,
    groups_twin,
    record_cells,
    record_groups,
)
from gpusim.optics.shadow.receivers import NO_OWNER, on_device, plane_words
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.twin_checks.scenes import (
    block,
    fields_setup,
    probe_pieces,
    probe_pixels,
    probe_points,
    probe_setup,
    probe_spaces,
)

SPARE = 1.1
"""How many times as many edges or faces a search may list as a point needs."""

LENGTH = CHUNK // 4 - 1
"""Words of a chunk but for the number of the next."""

GROUPS = Tolerance(1e-5, 2e-5, "float32 sums, of lengths of order one")
OUTLINES = Tolerance(2.5 / SAMPLES, 1e-5, "one or two samples fall to the other side of an outline")


@twin_check("optics/shadow/bvh_refit")
def _bvh_refit(device: Device) -> Pairs:
    for occluders, points, space in probe_spaces():
        own = OccluderBVH(device, occluders)
        own.move(points)
        with device.recording("optics.shadow.refit") as recording:
            own.fit(recording, 0, space)
        nodes = own.bindings(0)["nodes"].read().reshape(-1, 8)[1:]
        boxes, words = refit_twin(occluders, points.astype(np.float64), space)
        yield Pair(nodes[:, 7], words[1:], "exact")
        of_scene = Tolerance(1e-5 * space.scale, 1e-5, "float32 of the scene's size")
        yield Pair(nodes[:, [0, 2, 4, 1, 3, 5, 6]], boxes[1:], of_scene)


@twin_check("optics/shading/receiver_planes")
def _receiver_planes(device: Device) -> Pairs:
    # records by the device and by the host, smooth shading through a lens, strips along lines
    for setup in (probe_setup(fine=False), probe_setup(), fields_setup(True)):
        count = setup.view.count
        on = np.where(np.arange(count) % 3 > 0, np.arange(count), -1)
        words = planes_on_device(SceneBuffers(device, setup), on.astype(np.int32)).read()[:count]
        planes, lean = planes_twin(setup.view)
        size = np.linalg.norm(planes, axis=1)[:, None]
        got = np.ascontiguousarray(words[:, :3]).view(np.float32) / size
        yield Pair(got, planes / size, Tolerance(1e-5, 0.0, "float32 of order one"))
        want = plane_words(on, lean)
        yield Pair(words[:, 3] & NO_OWNER, want & NO_OWNER, "exact")
        yield Pair(words[:, 3] >> 24, want >> 24, Tolerance(1.0, 0.0, "rounded up to whole steps"))


@twin_check("optics/shadow/receiver_groups", GROUPS)
def _receiver_groups(device: Device) -> Pairs:
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        own, trees = on_device(device, receivers, occluders), OccluderBVH(device, occluders)
        trees.move(probe_points())
        corners = probe_points().astype(np.float64)[occluders.triangles]
        bindings = {**own.bindings(1), **trees.bindings(0)}
        bound = Bound(device, bindings)
        with device.recording("optics.shadow.cells") as recording:
            trees.gather(recording)
            record_cells(recording, own, bound)
        got = own.cells.read(np.float32, (own.entries, 16))[:, :13]
        yield Pair(got, cells_twin(receivers, occluders.sheet))
        for space in spaces:
            light = Uniform(device, space.uniform(), "shadow.light")
            groups_of = device.empty(48 * own.entries, "shadow.groups")
            bound = Bound(device, {"light": light, "groups_of": groups_of, **bindings})
            with device.recording("optics.shadow.groups") as recording:
                trees.fit(recording, 0, space)
                record_groups(recording, own, bound)
            got = groups_of.read(np.float32, (own.entries, 12))
            single = single_sheets(space, occluders, corners)
            want = groups_twin(receivers, space, occluders.sheet, single)
            empty = want[:, 0] > want[:, 1]
            yield Pair(got[empty, 0] > got[empty, 1], empty[empty], "exact")
            yield Pair(got[~empty], want[~empty])


def states_twin(states: npt.NDArray[np.uint32], shares: Any, entry: Any) -> Long:
    """(E,): what ``states`` of entries should be by the ``shares`` (n,) that the receivers in each
    ``entry`` (n,) see. Those may be looked at closely that needn't be, and nothing is said where
    nobody asks."""
    least, most = np.ones(len(states)), np.zeros(len(states))
    np.minimum.at(least, entry, shares)
    np.maximum.at(most, entry, shares)
    # one sample may lie on an outline
    sample = 1.5 / SAMPLES
    want = np.where(least > 1.0 - sample, LIT, np.where(most < sample, UMBRA, PENUMBRA))
    used = np.isin(np.arange(len(states)), entry)
    return np.where((states == PENUMBRA) | ~used, states, want)


@twin_check("optics/shadow/occluder_search", "exact")
def _occluder_search(device: Device) -> Pairs:
    points = probe_points()
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        for space in spaces[::2]:
            shares = VisibleShares(device, occluders, receivers)
            shares.find(points, [space])
            _, own, entry = asking(receivers, space)
            flat = shares_twin(occluders, points[:, :3].astype(np.float64), [space], own)[:, 0]
            got = shares.states_of(space.number)
            yield Pair(got, states_twin(got, flat, entry))


def listed_alone(search: OccluderSearch) -> tuple[Long, Long]:
    """Entry (n,) and occluder (n,) of what is listed alone; waits for the device."""
    heads = search.heads.read(np.uint32).reshape(-1, 4).astype(np.int64)
    pool = search.pool.read(np.uint32).reshape(-1, LENGTH + 1)
    entries: list[int] = []
    faces: list[int] = []
    for entry in np.flatnonzero(heads[:, 1]):
        chunk, left = heads[entry, 0], heads[entry, 1]
        while left > 0:
            own = pool[chunk, : min(left, LENGTH)]
            faces += own.tolist()
            entries += [int(entry)] * len(own)
            chunk, left = pool[chunk, LENGTH], left - LENGTH
    return np.array(entries, np.int64), np.array(faces, np.int64)


@twin_check("optics/shadow/occluder_refinement", "exact")
def _occluder_refinement(device: Device) -> Pairs:
    occluders, spaces, receivers = probe_pixels()
    points = probe_points()
    corners = points[:, :3].astype(np.float64)[occluders.triangles]
    planes = planes_of(corners)
    for space in spaces:
        shares = VisibleShares(device, occluders, receivers)
        shares.find(points, [space], until="search")
        entry, face = listed_alone(shares.search)
        shares.find(points, [space])
        kept = np.stack(listed_alone(shares.search), axis=1) @ [occluders.count, 1]
        got = np.isin(entry * occluders.count + face, kept)
        _, own, entry_of = asking(receivers, space)
        order = np.argsort(entry_of, kind="stable")
        first = np.searchsorted(entry_of[order], entry)
        last = np.searchsorted(entry_of[order], entry, side="right")
        pair, offset = expand(last - first)
        row, own_face = order[first[pair] + offset], face[pair]
        looks = visible_footprint(space.lamp, occluders, corners, planes, own[row], own_face)
        hides, may = (
            _any_of(len(entry), pair, space.lamp, seen)
            for seen in (
                edge_functions(
                    space, own[row], corners[own_face], planes[own_face],
                    occluders.open[own_face], some,
                )
                for some in (looks, np.where(looks < 0.0, 1.0, looks))
            )
        )  # fmt: skip
        # what hides no sample may stay where float32 can't tell, or if it would hide what the
        # receivers' planes go on to beyond their triangles
        want = hides[1] | (got & may[0])
        yield Pair(got.astype(np.int32), want.astype(np.int32))


def _any_of(count: int, pair: Long, lamp: Lamp, seen: EdgeFunctions) -> Bool:
    """(2, n): whether of each of so many pairs of entries and occluders some receiver may be
    hidden, and whether some sample is."""
    result = np.zeros((2, count), bool)
    hides = np.flatnonzero(seen.may_hide)
    np.logical_or.at(result[0], pair[hides], True)
    np.logical_or.at(result[1], pair[hides], seen.hidden(lamp, hides).any(axis=1))
    return result


@twin_check("optics/shadow/penumbra_mask", OUTLINES)
def _penumbra_mask(device: Device) -> Pairs:
    points = probe_points()
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        got = VisibleShares(device, occluders, receivers).find(points, spaces)
        number, own, _, _ = entries_of(receivers)
        want = shares_twin(occluders, points[:, :3].astype(np.float64), spaces, own)
        yield Pair(got[number], want)


@twin_check("optics/ambient/hemisphere_mask")
def _hemisphere_mask(device: Device) -> Pairs:
    box = block((0.1, 0.3, 0.25), (0.35, 0.2, 0.25), 0.5)
    plate = np.array([[-0.9, -0.4, 0.5], [-0.2, -0.5, 0.6], [-0.3, 0.2, 0.5], [-0.9, 0.1, 0.45]])
    corners = np.concatenate([box.points[box.faces], plate[None]])
    both = np.arange(len(corners)) == len(corners) - 1
    random = np.random.default_rng(3)
    at = np.c_[random.uniform(-1.0, 1.0, (301, 2)), np.zeros(301)]
    normal = np.c_[random.uniform(-0.4, 0.4, (301, 2)), np.ones(301)]
    normal[:150] = [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    points = SamplePoints(at, normal, np.full(301, 2e-6), np.full(301, 1e-3))
    facets = EdgeAdjacency.apart(corners, both)
    want = hemisphere_masks_twin(points, facets)
    tables = SilhouetteBuffers(device, SilhouetteBVH.of(facets))
    got = hemisphere_masks(tables, points)
    tables.release()
    few = 3.5 / (hemisphere_mask.ROWS * hemisphere_mask.COLUMNS)
    outlines = Tolerance(few, 1e-5, "a few samples fall to the other side of an edge")
    yield Pair(got.open_share, want.open_share, outlines)
    yield Pair(got.inside, want.inside, "exact")


@twin_check("optics/ambient/silhouette_search", "exact")
def _silhouette_search(device: Device) -> Pairs:
    boxes = [block((0.3 * k, 0.2, 0.1 * k), (0.1, 0.2, 0.05), 0.5) for k in range(12)]
    corners = np.concatenate([box.points[box.faces] for box in boxes])
    random = np.random.default_rng(6)
    points = SamplePoints(
        np.c_[random.uniform(-1.0, 4.0, (203, 2)), random.uniform(-0.3, 1.0, 203)],
        np.tile([0.0, 0.6, 0.8], (203, 1)), np.full(203, 2e-6), np.full(203, 1e-3),
    )  # fmt: skip
    contours = SilhouetteBVH.of(EdgeAdjacency.apart(corners, np.arange(len(corners)) % 3 == 0))
    facets = contours.facets
    to = facets.ends - points.at[:, None, None]
    sine = np.einsum("neka,na->nek", to, points.normal) / np.linalg.norm(to, axis=3)
    contour = (contour_edges(points, facets) != 0) & (sine.max(axis=2) > LOW)
    wanted = contour, faces_upward(points, facets)
    tables = SilhouetteBuffers(device, contours)
    begin = 0
    for near in tables.batches(points):
        counts = near.counts.read(np.uint32, (near.count, 2))
        for k, (buffer, every) in enumerate(zip((near.edges, near.faces), wanted, strict=True)):
            want = every[begin : begin + near.count]
            listed = np.zeros(want.shape, np.int64)
            lists = buffer.read(np.uint32, (near.count, near.most[k]))
            point, place = np.nonzero(np.arange(near.most[k]) < counts[:, k, None])
            np.add.at(listed, (point, lists[point, place]), 1)
            # all that matter, each once, and few others: clusters are larger than what is in them
            yield Pair(listed[want], np.ones(want.sum()))
            most = np.array([listed.max(), listed.sum() <= SPARE * want.sum()], np.int64)
            yield Pair(most, np.ones(2, np.int64))
        begin += near.count
        near.release()
    tables.release()
