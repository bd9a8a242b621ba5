"""The error of a measured field in parts that add up, and what they say in words.

What faults of calibration, scale, lens and out-of-plane motion do is known without any matching
(`geometric_error`); the rest of an error came about in the pictures. Of that an effect's part is
the mean of what it adds to pictures without any effect and of what goes with it from pictures with
all of them: where effects act on each other in pairs, each has half of what they do together, and
the parts still add up (Shapley's values in a game of pairs).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.pipeline.measurements.dic.geometric_error import CALIBRATION, CAUSE
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.results import rms
from gpusim.scene.description.table import name_and_unit

NOTABLE = 10.0
"""Percent of the error from which on a part, or what parts do together, is told of."""
RIGID = 1e-6
"""Strain up to which a true motion counts as rigid."""
BENT = 0.05
"""Share of a map's variance beyond its plane from which on it is a parabola, not a tilt."""


@dataclass(frozen=True, eq=False)
class ErrorParts:
    """Errors (M, Q) of displacements, the first ``lengths`` columns, and strains at M points in the
    last frame of ``result``: the ``whole``, its ``parts`` by name, what ``together`` does beside
    what each effect does alone, and the ``causes`` of a part "calibration"."""

    result: FullFieldResult
    whole: Float
    parts: Mapping[str, Float]
    together: Mapping[str, Float]
    causes: Mapping[str, Float]

    @property
    def lengths(self) -> int:
        """How many of the quantities are displacements."""
        return len(self.result.displacements)

    @property
    def missing(self) -> Float:
        """What the parts don't add up to."""
        return np.asarray(self.whole - sum(self.parts.values()))

    def size(self, part: Float) -> tuple[float, ...]:
        """RMS displacement of a part, its share of the whole in percent, RMS strain in microstrain,
        its share."""
        told = []
        for columns, unit in ((slice(None, self.lengths), 1.0), (slice(self.lengths, None), 1e6)):
            own, whole = part[:, columns], self.whole[:, columns]
            squares = np.nansum(whole**2)
            share = float(np.nansum(own * whole) / squares) if squares else np.nan
            told += [unit * rms(own), 100.0 * share]
        return tuple(told)

    def sizes(self) -> dict[str, tuple[float, ...]]:
        """Of all parts, what they miss, and the whole."""
        every = {**self.parts, "missing": self.missing, "measured less true": self.whole}
        return {name: self.size(one) for name, one in every.items()}


def error_parts(
    whole: FullFieldResult,
    none: FullFieldResult,
    only: Mapping[str, FullFieldResult],
    no: Mapping[str, FullFieldResult],
    others: Sequence[FullFieldResult] = (),
) -> ErrorParts:
    """The parts of the ``whole``, from what was measured with none of some effects, with each of
    them alone, with all but each, and with none in ``others`` of the random patterns.

    Raises GpusimError if there is no point that all of them have.
    """
    known = dict(zip(whole.known_names, whole.known_errors, strict=True))
    causes = {
        name.removeprefix(CAUSE): known.pop(name) for name in [*known] if name.startswith(CAUSE)
    }
    parts, together = dict(known), dict[str, Float]()
    bare, full = _in_pictures(none), _in_pictures(whole)
    for name in only:
        added, taken = _in_pictures(only[name]) - bare, full - _in_pictures(no[name])
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

    return ErrorParts(whole, np.where(fine, error, np.nan), kept(parts), kept(together),
                      kept(causes))  # fmt: skip


def _errors(result: FullFieldResult, kind: str) -> Float:
    """(M, Q) less the truth, in the last frame."""
    names = [*result.displacements, *result.strains]
    return np.asarray((result.values(kind, names) - result.values("true", names))[-1])


def _in_pictures(result: FullFieldResult) -> Float:
    """The error without what is known to come from elsewhere."""
    known = [
        one for name, one in zip(result.known_names, result.known_errors, strict=True)
        if not name.startswith(CAUSE)
    ]  # fmt: skip
    return np.asarray(_errors(result, "measured") - sum(known))


def remarks(found: ErrorParts) -> list[str]:
    """What the parts say, in sentences."""
    shares = {name: found.size(one)[1] for name, one in found.parts.items()}
    most = max(shares, key=lambda name: shares[name])
    told = [f"The largest part of the error of displacements is {most}: {shares[most]:.0f} %."]
    for name in found.result.known_names:
        if abs(shares.get(name, 0.0)) >= NOTABLE:
            told += [_rigid_motion(found, name, found.parts[name]), _causes(found, name)]
    return [one for one in told if one] + [_sum(found)]


def _causes(found: ErrorParts, name: str) -> str:
    """Which parameters a part comes from, by their projections on it; nothing if none are known."""
    part = found.parts[name][:, : found.lengths]
    shares = {
        cause: 100.0 * np.nansum(one[:, : found.lengths] * part) / np.nansum(part**2)
        for cause, one in found.causes.items() if name == CALIBRATION
    }  # fmt: skip
    told = [f"{cause} ({one:+.0f} %)" for cause, one in shares.items() if abs(one) >= NOTABLE]
    return f"What {name} does comes from: {'; '.join(told)}." if told else ""


def _rigid_motion(found: ErrorParts, name: str, part: Float) -> str:
    """How a part of the error looks if nothing is really strained; else nothing."""
    result, count = found.result, found.lengths
    true = result.values("true", [*result.displacements, *result.strains])[-1]
    if not result.strains or not np.nanmax(np.abs(true[:, count:])) <= RIGID:
        return ""
    x, y = (result.table[f"{axis}_px"][-1] for axis in "xy")
    place = np.stack([x - x.mean(), y - y.mean()]) / max(np.ptp(x), np.ptp(y), 1.0)
    plane = np.vstack([np.ones_like(x), place])
    degrees = plane, np.vstack([plane, place**2, place[0] * place[1]])
    spread = np.nanstd(part[:, :count], axis=0).tolist()
    bent = []
    for quantity, values, own in zip(result.displacements, part.T, spread, strict=False):
        flat, curved = (_unfitted(values, terms) for terms in degrees)
        if flat > BENT > curved / flat and own > 0.1 * max(spread):
            bent.append(name_and_unit(quantity)[0])
    shape = f"a parabola in {' and '.join(bent)}" if bent else "a stretch or tilt"
    unit = name_and_unit(result.displacements[0])[1]
    moved, wrong = (
        float(np.nanmax(np.linalg.norm(one[:, :count], axis=1))) for one in (true, part)
    )
    strain = 1e6 * np.nanmax(np.abs(part[:, count:]))
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
    missing = _over_whole(found, found.missing)
    kinds = ("displacements", "strains")[: len(missing)]
    told = " and ".join(f"{one:.1f} % of {kind}" for one, kind in zip(missing, kinds, strict=True))
    words = f"The parts add up to the error but for {told} (RMS)."
    acting = [
        name for name, one in found.together.items() if max(_over_whole(found, one)) > NOTABLE
    ]
    if acting:
        words += f" What {', '.join(acting)} do depends on the other effects: half of it is theirs."
    return words


def _over_whole(found: ErrorParts, part: Float) -> list[float]:
    """RMS of a part in percent of that of the whole error, of displacements and, if there are any,
    strains; 0 of nothing."""
    sizes = zip(found.size(part)[::2], found.size(found.whole)[::2], strict=True)
    return [
        100.0 * one / whole if whole > 0.0 else 0.0 for one, whole in sizes if not np.isnan(whole)
    ]
