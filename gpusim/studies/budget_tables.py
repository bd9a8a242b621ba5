"""``[budget]``: what a measurement's uncertainty comes from, and how it is drawn."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Listed, Seed, Table, fault

Key = Annotated[str, Field(min_length=1, max_length=200)]
Positive = Annotated[float, Field(gt=0)] | None
KINDS = "normal", "half_width", "percent", "choices", "seeds"


class BudgetSourceTable(Table):
    """``[[budget.source]]``: keys of the scene that aren't known better than this.

    Several tables of one name are one source. Numbers are drawn around what the scene says, each
    item of a list on its own.

    Example::

        [[budget.source]]
        name = "vibration"
        keys = ["camera.front.moved_um"]
        set = { "camera.front.moved_um" = [0.0, 0.0, 0.0] }
        normal = 5.0
    """

    name: Annotated[str, Field(min_length=1, max_length=80)]
    """What the budget calls it; that of a source which the scene has anyway replaces that one."""
    keys: Annotated[tuple[Key, ...], Listed(1, 1000, different=True)]
    """Keys of the scene, as `--set` takes them."""
    normal: Positive = None
    """Standard uncertainty of each, normally distributed, in the key's unit."""
    half_width: Positive = None
    """Half the width of an even distribution, in the key's unit."""
    percent: Positive = None
    """As ``normal``, in percent of what the scene says."""
    choices: Annotated[tuple[Any, ...], Listed(2, 1000)] | None = None
    """Values of which each is as likely as the others."""
    seeds: Literal[True] | None = None
    """Keys are seeds, another one in each draw."""
    together: bool = False
    """All keys are off by as many standard uncertainties, in place of each on its own."""
    set: dict[str, Any] = Field({})
    """Keys that this source sets before it draws: what it draws around, or what it needs."""
    degrees_of_freedom: Positive = None
    """How well its size is known; without it as many as there are draws, less one."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise fault(kinds[-1] if kinds else "", "not one distribution",
                        " and ".join(kinds) or "none", f"one of {', '.join(KINDS)}")  # fmt: skip
        return self


class BudgetTable(Table):
    """``[budget]``: the uncertainty of what a scene measures, by its sources.

    Example::

        draws = 256
        sources = ["noise", "vibration"]
    """

    draws: Annotated[int, Field(ge=5, le=1_000_000)] = 128
    """Of each source alone, and of all together; powers of 2 fill distributions best."""
    seed: Seed = 0
    """Of the draws: another one draws other values."""
    coverage: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """Probability with which an interval holds the true value."""
    calibration: Literal["nominal", "scene"] = "nominal"
    """Pairs of cameras measure with the cameras as the scene describes them, while pictures are
    those of drawn ones; "scene": with what the scene says, such as pictures of its board."""
    sources: Annotated[tuple[str, ...], Listed(different=True)] | None = None
    """Names of the sources that count, of those that the scene has anyway; by default all."""
    source: Annotated[tuple[BudgetSourceTable, ...], Listed()] = ()
    """More of them."""
