"""What every ``[[measure]]`` says, whatever its kind, and the kinds that there are.

A kind of measurement is known by its ``type``: here is its table, in `gpusim.pipeline.measurements`
what measures by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, get_args

from gpusim.scene.tables.table import Name, Table

Entry = Mapping[str, Any]
MeasureFault = tuple[tuple[str | int, ...], str, Any, str]
"""Keys within the table, what is wrong there, what stands there, what is expected."""


class MeasureTable(Table):
    """One measurement in a run's pictures; each kind has a table of its own.

    A subclass gives ``type`` the kind's name (``type: Literal["mean_grey"]``), adds its keys, and
    says what they need:

    - ``references``: keys ("roi.paint": in a table of it) that name what has to be there: "camera",
      "variant", "paint", "markers paint on a body", "markers paint on a prop", or
      "measure of a <type>";
    - ``uses_calibration`` (a property): whether it needs the board's corners of [calibration];
    - ``correlates``: whether it correlates pictures, which is done on the device if there is one;
    - ``package``: the folder of `gpusim.pipeline.measurements` that measures it, if that isn't
      named by its ``type``;
    - ``compares_variants``: whether it compares what other measures have found in the variants: no
      state of the scene has it, and it needs no pictures;
    - ``least_frames``: so many have to be there, the first one of them as the reference;
    - ``endings``: what names of its files have behind its own, which no other measure may be named.
    """

    name: Name
    """Of its files in measure/, and of its rows in the report."""
    type: str

    references: ClassVar[Mapping[str, str]] = {}
    correlates: ClassVar[bool] = False
    package: ClassVar[str] = ""
    compares_variants: ClassVar[bool] = False
    least_frames: ClassVar[int] = 2
    endings: ClassVar[Sequence[str]] = ()

    @classmethod
    def kind(cls) -> str:
        """The ``type`` of the tables of this class."""
        return str(get_args(cls.model_fields["type"].annotation)[0])

    @property
    def uses_calibration(self) -> bool:
        """Whether it needs the board's corners of [calibration]."""
        return False

    @property
    def views(self) -> tuple[str, ...]:
        """The cameras that it measures with."""
        named = (getattr(self, key) for key, what in self.references.items() if what == "camera")
        return tuple(
            name for one in named for name in ((one,) if isinstance(one, str) else one or ())
        )

    def pictures(self, frames: int) -> list[tuple[str, int]]:
        """Camera and frame of every picture that it looks at, of a scene of so many ``frames``."""
        return [(camera, frame) for camera in self.views for frame in range(frames)]

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """Roughly how long it takes in pictures of so many ``pixels``, for plans."""
        return 2e-8 * pixels * frames

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """What is wrong between the table as it was written, an ``entry`` of the ``document``, and
        other tables; what isn't of the right shape there is told elsewhere."""
        yield from ()


TABLES: dict[str, type[MeasureTable]] = {}
"""The tables of all kinds by their ``type``; `gpusim.scene.measure_kinds.add_kind` adds one."""
