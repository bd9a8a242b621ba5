"""The error of a measured field in parts that add up, and what they say in words.

What calibration, scale, lens and out-of-plane motion do is known without any matching
(`geometric_error`); the rest of an error came about in the pictures. Of that an effect's part is
the mean of what it adds to pictures without any effect and of what goes with it from pictures with
all of them: where effects act on each other in pairs, each has half of what they do together, and
the parts still add up (Shapley's values in a game of pairs).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.pipeline.measurements.dic.geometric_error import CALIBRATION
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.results import rms
from gpusim.report import PartSize
from gpusim.scene.tables.table import name_and_unit

NOTABLE = 10.0
"""Percent of the error from which on a part, or what parts do together, is told of."""
RIGID = 1e-6
"""Strain up to which a true motion counts as rigid."""
BENT = 0.05
"""Share of a map's variance beyond its plane from which on it is a parabola, not a tilt."""
MOVED = "displacements"


class Kind(NamedTuple):
    """Quantities of one kind: their ``columns`` in errors (M, Q), and the ``unit`` in which sizes
    are told, for which values are multiplied by a ``factor``."""

    columns: slice
    unit: str
    factor: float


@dataclass(frozen=True, eq=False)
class ErrorParts:
    """Errors (M, Q) of displacements and strains at M points in the last frame of ``result``: the
    ``whole``, its ``parts`` by name, and what ``together`` does beside what each effect does alone.
    """

    result: FullFieldResult
    whole: Float
    parts: Mapping[str, Float]
    together: Mapping[str, Float]

    @cached_property
    def kinds(self) -> dict[str, Kind]:
        """Displacements and, if any are known, strains."""
        count = len(self.result.displacements)
        unit = name_and_unit(self.result.displacements[0])[1]
        kinds = {MOVED: Kind(slice(None, count), unit, 1.0)}
        if np.isfinite(self.whole[:, count:]).any():
            kinds["strains"] = Kind(slice(count, None), "microstrain", 1e6)
        return kinds

    @property
    def missing(self) -> Float:
        """What the parts don't add up to."""
        return np.asarray(self.whole - sum(self.parts.values()))

    def size(self, part: Float) -> dict[str, PartSize]:
        """Of a part (M, Q), by kinds of quantities."""
        sizes = {}
        for kind, (columns, _, factor) in self.kinds.items():
            own, whole = part[:, columns], self.whole[:, columns]
            squares = np.nansum(whole**2)
            share = float(np.nansum(own * whole) / squares) if squares else np.nan
            percent = 100.0 * rms(own) / rms(whole) if squares else 0.0
            sizes[kind] = PartSize(factor * rms(own), percent, 100.0 * share)
        return sizes

    @cached_property
    def sizes(self) -> dict[str, dict[str, PartSize]]:
        """Of all parts, what they miss, and the whole."""
        every = {**self.parts, "missing": self.missing, "measured less true": self.whole}
        return {name: self.size(one) for name, one in every.items()}


def error_parts(
    whole: FullFieldResult, states: Mapping[tuple[str, str], FullFieldResult]
) -> ErrorParts:
    """The parts of the ``whole``, from what was measured in ``states``: with "none" of some
    effects, first with the same and then with other random patterns, and with "only" one and with
    all but one ("no") of each name.

    Raises GpusimError if there is no point that all of them have.
    """
    parts, together = dict(whole.geometric_errors), dict[str, Float]()
    none, *others = (one for (state, _), one in states.items() if state == "none")
    bare, full = _in_pictures(none), _in_pictures(whole)
    for name in (name for state, name in states if state == "only"):
        added = _in_pictures(states["only", name]) - bare
        taken = full - _in_pictures(states["no", name])
        parts[name], together[name] = 0.5 * (added + taken), 0.5 * (taken - added)
    parts["settings"] = _errors(none, "levelled")
    rest = [_in_pictures(one) - _errors(one, "levelled") for one in (none, *others)]
    matching = np.mean(rest, axis=0)
    if others:
        parts["speckle"] = rest[0] - matching
    parts["matching"] = matching
    error = _errors(whole, "measured")
    fine = np.all(np.isfinite([error, *parts.values()]), axis=0)
    if not fine[:, 0].any():
        raise GpusimError(
            f"measure {whole.name!r}: got no point in frame {whole.table.frames[-1]} that is found "
            "with every effect and without; expected some"
        )

    def kept(maps: Mapping[str, Float]) -> dict[str, Float]:
        return {name: np.where(fine, one, np.nan) for name, one in maps.items()}

    return ErrorParts(whole, np.where(fine, error, np.nan), kept(parts), kept(together))


def _errors(result: FullFieldResult, kind: str) -> Float:
    """(M, Q) less the truth, in the last frame."""
    names = [*result.displacements, *result.strains]
    return np.asarray((result.values(kind, names) - result.values("true", names))[-1])


def _in_pictures(result: FullFieldResult) -> Float:
    """The error without what is known to come from elsewhere."""
    return np.asarray(_errors(result, "measured") - sum(result.geometric_errors.values()))


def remarks(found: ErrorParts) -> list[str]:
    """What the parts say, in sentences."""
    shares = {name: found.sizes[name][MOVED].share_percent for name in found.parts}
    most = max(shares, key=lambda name: shares[name])
    told = [f"The largest part of the error of displacements is {most}: {shares[most]:.0f} %."]
    for name in found.result.geometric_errors:
        if abs(shares[name]) >= NOTABLE:
            told.append(_rigid_motion(found, name))
            told.append(_causes(found) if name == CALIBRATION else "")
    return [one for one in told if one] + [_sum(found)]


def _causes(found: ErrorParts) -> str:
    """Which parameters the part of the calibration comes from, by their projections on it; nothing
    if none are known."""
    columns = found.kinds[MOVED].columns
    part = found.parts[CALIBRATION][:, columns]
    shares = {
        cause: 100.0 * np.nansum(one[:, columns] * part) / np.nansum(part**2)
        for cause, one in found.result.causes.items()
    }
    told = [f"{cause} ({one:+.0f} %)" for cause, one in shares.items() if abs(one) >= NOTABLE]
    return f"What {CALIBRATION} does comes from: {'; '.join(told)}." if told else ""


def _rigid_motion(found: ErrorParts, name: str) -> str:
    """How a part of the error looks if nothing is really strained; else nothing."""
    result, part = found.result, found.parts[name]
    if "strains" not in found.kinds:
        return ""
    if not np.nanmax(np.abs(result.values("true", result.strains)[-1])) <= RIGID:
        return ""
    x, y = (result.table[f"{axis}_px"][-1] for axis in "xy")
    place = np.stack([x - x.mean(), y - y.mean()]) / max(np.ptp(x), np.ptp(y), 1.0)
    plane = np.vstack([np.ones_like(x), place])
    degrees = plane, np.vstack([plane, place**2, place[0] * place[1]])
    columns, unit, _ = found.kinds[MOVED]
    errors = part[:, columns]
    spread = np.nanstd(errors, axis=0).tolist()
    bent = []
    for quantity, values, own in zip(result.displacements, errors.T, spread, strict=True):
        flat, curved = (_unfitted(values, terms) for terms in degrees)
        if flat > BENT > curved / flat and own > 0.1 * max(spread):
            bent.append(name_and_unit(quantity)[0])
    shape = f"a parabola in {' and '.join(bent)}" if bent else "a stretch or tilt"
    # of one camera with what goes across the plane that it measures in
    motion = [f"true_{one}" for one in (*result.displacements, "w_mm")]
    true = np.stack(
        [result.table[one][-1] for one in motion if one in result.table.columns], axis=1
    )
    moved, wrong = (float(np.nanmax(np.linalg.norm(one, axis=1))) for one in (true, errors))
    strain = 1e6 * np.nanmax(np.abs(part[:, found.kinds["strains"].columns]))
    return (
        f"A rigid motion of {moved:.3g} {unit} reads as {shape}, by {name}: up to {wrong:.2g} "
        f"{unit} and {strain:.0f} microstrain, where there is no strain."
    )


def _unfitted(values: Float, terms: Float) -> float:
    """The share of the variance that no combination of ``terms`` (K, M) explains."""
    fine = np.isfinite(values)
    known, basis = values[fine], terms[:, fine].T
    left = known - basis @ np.linalg.lstsq(basis, known)[0]
    spread = float(np.var(known))
    return float(np.var(left)) / spread if spread > 0.0 else 0.0


def _sum(found: ErrorParts) -> str:
    """Whether the parts add up, and which of them act on each other."""
    missing = found.sizes["missing"].items()
    told = " and ".join(f"{size.rms_percent:.1f} % of {kind}" for kind, size in missing)
    words = f"The parts add up to the error but for {told} (RMS)."
    acting = [
        name for name, one in found.together.items()
        if max(size.rms_percent for size in found.size(one).values()) > NOTABLE
    ]  # fmt: skip
    if acting:
        words += f" What {', '.join(acting)} do depends on the other effects: half of it is theirs."
    return words
