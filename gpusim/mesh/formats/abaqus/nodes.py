"""Nodes of an Abaqus or CalculiX file: given, in systems of their own, and generated."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.mesh.file_content.coordinate_systems import Frame, from_cylindrical, rotation
from gpusim.mesh.formats.abaqus.cards import LARGEST, Card, number, numbers_at_once, whole

MAX_GENERATED = 5_000_000
"""Nodes, and elements, that the generating cards of a file may make."""

# ends of an arc may differ by this share in their distance from its centre: files round
_UNROUND = 1e-2


class Nodes:
    """Reads *SYSTEM, *NODE, *NGEN and *NFILL in their order; a node given again takes its last
    place, as in CalculiX. ``sets`` collects (name, labels) of the cards that name a set."""

    def __init__(self) -> None:
        self.labels: list[Long] = []
        self.points: list[Float] = []
        self.sets: list[tuple[str, Long]] = []
        self.frame: Frame | None = None
        self.generated = 0
        self._places: dict[int, tuple[float, ...]] | None = None

    def read(self, card: Card, members: Callable[[str, str], Long]) -> None:
        """One card; ``members(name, where)`` are the labels of a node set as known so far."""
        if card.keyword == "SYSTEM":
            self.frame = _system(card)
        elif card.keyword == "NODE":
            table = _node_table(card)
            points = table[:, 1:]
            if card.parameters.get("SYSTEM", "R").upper() == "C":
                points = from_cylindrical(points)
            self._add(card, table[:, 0].astype(np.int64), self._global(points))
        elif card.keyword == "NGEN":
            self._lines(card)
        else:
            self._filling(card, members)

    def merged(self) -> tuple[Long, Float]:
        """Sorted labels (N,) and their points (N,3)."""
        labels = np.concatenate([np.zeros(0, dtype=np.int64), *self.labels])
        points = np.concatenate([np.zeros((0, 3)), *self.points])
        unique, last = np.unique(labels[::-1], return_index=True)
        return unique, points[::-1][last]

    def _global(self, points: Float) -> Float:
        return points if self.frame is None else self.frame.place(points)

    def _add(self, card: Card, labels: Long, points: Float) -> None:
        self.labels.append(labels)
        self.points.append(points)
        if self._places is not None:
            self._places.update(zip(labels.tolist(), map(tuple, points.tolist()), strict=True))
        if card.parameters.get("NSET"):
            self.sets.append((card.parameters["NSET"], labels))

    def _point(self, label: int, where: str) -> Float:
        if self._places is None:
            labels, points = self.merged()
            self._places = dict(zip(labels.tolist(), map(tuple, points.tolist()), strict=True))
        if label not in self._places:
            raise InputError(f"{where}: node {label} isn't there yet; expected it above this line")
        return np.array(self._places[label])

    def _count(self, more: int, where: str) -> None:
        self.generated += more
        if self.generated > MAX_GENERATED:
            raise InputError(
                f"{where}: would make {self.generated} nodes; expected at most {MAX_GENERATED}"
            )

    def _lines(self, card: Card) -> None:
        """*NGEN: first and last node, increment, and the centre of an arc."""
        circle = card.parameters.get("LINE", "").upper() == "C"
        expected = "first node, last node, increment" + circle * ", centre, normal"
        for where, row in card.records(2, 10 if circle else 3, expected, counted=True):
            first, last = whole(row[0], where), whole(row[1], where)
            step = whole(row[2], where) if len(row) > 2 and row[2] else 1
            if step == 0 or (last - first) % step or (last - first) // step < 1:
                raise InputError(
                    f"{where}: got nodes {first} to {last} by {step}; expected whole steps from "
                    "the first to the last"
                )
            count = (last - first) // step
            self._count(count - 1, where)
            start, end = self._point(first, where), self._point(last, where)
            share = np.arange(count + 1)[:, None] / count
            points = start + (end - start) * share
            if circle:
                points = _arc(start, end, share, *self._centre(row, where), where)
            points[-1] = end
            self._add(card, first + step * np.arange(count + 1), points)

    def _centre(self, row: list[str], where: str) -> tuple[Float, Float | None]:
        """Centre of an arc, by number or coordinates, and its normal where one is given."""
        values = [number(text or "0", where) for text in row[4:]]
        normal = np.array(values[3:]) if len(values) == 6 else None
        if len(row) > 3 and row[3]:
            return self._point(whole(row[3], where), where), normal
        if len(values) not in (3, 6):
            raise InputError(f"{where}: no centre; expected its node, or its three coordinates")
        return self._global(np.array([values[:3]]))[0], normal

    def _filling(self, card: Card, members: Callable[[str, str], Long]) -> None:
        """*NFILL: two node sets, the number of intervals between them, increment."""
        expected = "two node sets, the number of intervals, increment"
        for where, row in card.records(3, 4, expected, counted=True):
            first, last = members(row[0], where), members(row[1], where)
            count = whole(row[2], where)
            step = whole(row[3], where) if len(row) == 4 and row[3] else 1
            if len(first) != len(last) or count < 1 or step == 0:
                raise InputError(
                    f"{where}: got sets of {len(first)} and {len(last)} nodes, {count} intervals "
                    f"by {step}; expected sets of equal size"
                )
            self._count((count - 1) * len(first), where)
            start = np.array([self._point(int(label), where) for label in first]).reshape(-1, 3)
            end = np.array([self._point(int(label), where) for label in last]).reshape(-1, 3)
            share = np.arange(1, count)[:, None, None] / count
            labels = (first + step * np.arange(1, count)[:, None]).ravel()
            self._add(card, labels, (start + (end - start) * share).reshape(-1, 3))
            if card.parameters.get("NSET"):
                self.sets += [(card.parameters["NSET"], both) for both in (first, last)]


NODE_CARDS = frozenset(["SYSTEM", "NODE", "NGEN", "NFILL"])


def _arc(
    start: Float, end: Float, share: Float, centre: Float, normal: Float | None, where: str
) -> Float:
    """Points (K,3) on a circle about ``centre``, the shorter way round unless a normal says it."""
    a, b = start - centre, end - centre
    radii = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    axis = np.cross(a, b) if normal is None else normal
    if not (min(radii) > 0.0 and abs(radii[1] - radii[0]) <= _UNROUND * radii[0]):
        raise InputError(f"{where}: got ends {radii[0]:g} and {radii[1]:g} from the centre of an "
                         "arc; expected equal distances")  # fmt: skip
    if not np.linalg.norm(axis) > 1e-9 * radii[0] * (radii[0] if normal is None else 0.0):
        raise InputError(f"{where}: a half circle needs a normal; expected it in fields 8 to 10")
    axis = axis / np.linalg.norm(axis)
    angle = float(np.rad2deg(np.arctan2(np.cross(a, b) @ axis, a @ b))) % 360.0
    turned = np.stack([rotation(axis, angle * one) @ a for one in share[:, 0].tolist()])
    return np.asarray(centre + turned * (1.0 + (radii[1] / radii[0] - 1.0) * share))


def _system(card: Card) -> Frame | None:
    """*SYSTEM: origin, a point on x; a point on the side of y. Without data: the global one."""
    rows = list(card.records())
    if not rows:
        return None
    values = [[number(text or "0", where) for text in row] for where, row in rows]
    first = values[0] + [0.0] * (3 - len(values[0]))
    second = values[1] if len(values) > 1 else []
    if len(values) > 2 or len(first) not in (3, 6) or len(second) not in (0, 3):
        card.fail(
            f"got {', '.join(str(len(one)) for one in values)} numbers in its "
            "lines; expected the origin, a point on x, and in a second line a point beside it"
        )
    origin = np.array(first[:3])
    if len(first) == 3:
        return Frame(origin, np.eye(3))
    x = np.array(first[3:])
    if not second:  # z stays, x is seen along it
        x[2] = origin[2]
        second = (origin + np.cross([0.0, 0.0, 1.0], x - origin)).tolist()
    return Frame.from_x(origin, x, np.array(second), rows[0][0])


def _node_table(card: Card) -> Float:
    """(K,4) label and coordinates; missing coordinates are zero."""
    if card.lines and all(line.count(",") == 3 for line in card.lines):
        quick = numbers_at_once(",".join(card.lines).split(","), np.float64)
        if quick is not None and (np.abs(quick) <= LARGEST).all():
            labels = quick[::4]
            if ((np.abs(labels) < 2**53) & (labels % 1.0 == 0.0)).all():
                return quick.reshape(-1, 4)
    rows: Sequence[list[float]] = [_node_row(row, where) for where, row in card.records()]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _node_row(row: list[str], where: str) -> list[float]:
    # more fields are normals, which solids don't have
    coordinates = [number(text or "0", where) for text in row[1:4]]
    return [float(whole(row[0], where)), *coordinates, *[0.0] * (3 - len(coordinates))]
