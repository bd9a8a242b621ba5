"""``study.toml``: what is varied in a scene, and how; read, checked and resolved."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from gpusim.errors import Fault, InputError, SceneError
from gpusim.files.input_file import read_input
from gpusim.gpu import chosen_backend
from gpusim.scene import Scene, load_scene
from gpusim.scene.faults.faults import faults_of, unread
from gpusim.scene.faults.key_paths import key_lines
from gpusim.scene.tables.table import Count, Listed, Pair, Seed, Table, fault
from gpusim.scene.toml_text import parse_toml, toml_text
from gpusim.studies.budget_tables import BudgetTable
from gpusim.studies.dataset_table import DatasetTable
from gpusim.studies.expressions import FUNCTIONS

COPY = "study.toml"
"""The study in its folder."""
DISTRIBUTIONS = "uniform", "log_uniform", "normal", "log_normal"
_COLUMNS = "sample", "repeat", "status", "error", "seconds"  # of the table of samples

Key = Annotated[str, Field(min_length=1, max_length=200)]
Expression = Annotated[str, Field(min_length=1, max_length=500)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=64)]


class ParameterTable(Table):
    """``[[parameter]]``: a key of the scene that takes several values.

    Example::

        [[parameter]]
        key = "camera.front.focal_mm"
        uniform = [25.0, 35.0]
        name = "f"
    """

    key: Key
    """A key of the scene, as `--set` takes it."""
    name: Identifier | None = None
    """Its name in expressions and in the table of samples; by default the key."""
    list_: Annotated[tuple[Any, ...], Listed(1, 10_000)] | None = Field(None, alias="list")
    """Its values."""
    uniform: Pair | None = None
    """The smallest and the largest value."""
    log_uniform: Pair | None = None
    """The same; its logarithm is uniform."""
    normal: Pair | None = None
    """Mean and standard deviation."""
    log_normal: Pair | None = None
    """Median, and standard deviation of the natural logarithm."""
    low: float | None = None
    """Below it a normal or log-normal distribution is cut off."""
    high: float | None = None
    """Above it a normal or log-normal distribution is cut off."""

    @property
    def label(self) -> str:
        """Its name, or its key."""
        return self.name or self.key

    @property
    def distribution(self) -> str:
        """The name of its distribution; "" for a list."""
        return next((one for one in DISTRIBUTIONS if getattr(self, one) is not None), "")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = ["list"] * (self.list_ is not None)
        kinds += [one for one in DISTRIBUTIONS if getattr(self, one) is not None]
        if len(kinds) != 1:
            got, expected = " and ".join(kinds) or "none", ", ".join(("list", *DISTRIBUTIONS))
            raise fault("", "not one kind of values", got, f"one of {expected}")
        if self.name in FUNCTIONS:
            raise fault("name", "is a function of expressions", self.name, "another name")
        if self.name in _COLUMNS:
            raise fault("name", "is another column of samples.csv", self.name, "another name")
        kind = self.distribution
        first, second = getattr(self, kind) if kind else (1.0, 2.0)
        low, high = self.low, self.high
        for key, wrong, problem, expected in (
            (kind, kind.startswith("log") and not first > 0, "has no logarithm", "numbers above 0"),
            (kind, kind.endswith("uniform") and not first < second, "isn't a range",
             "the smaller number, then the larger one"),
            (kind, kind.endswith("normal") and not second > 0, "has no width",
             "a standard deviation above 0"),
            ("high" if low is None else "low", not kind.endswith("normal")
             and (low is not None or high is not None), "cuts off nothing", "normal or log_normal"),
            ("high", low is not None and high is not None and not low < high, "isn't above low",
             "more"),
        ):  # fmt: skip
            if wrong:
                raise fault(key, problem, getattr(self, key), expected)
        return self


class DerivedTable(Table):
    """``[[derived]]``: a key of the scene that follows from parameters.

    Example::

        [[derived]]
        key = "camera.front.position_mm"
        value = ["300", "-20 - 40 * f", "290"]
    """

    key: Key
    """A key of the scene, as `--set` takes it."""
    value: Expression | float | Annotated[tuple[Any, ...], Listed(1, 1000)]
    """An expression of parameters' names, or a list of such and of numbers."""


class ConstraintTable(Table):
    """``[[constraint]]``: what samples have to fulfil; others are recorded as refused.

    Example::

        [[constraint]]
        expression = "f < 50"
    """

    expression: Expression
    """A comparison of expressions, or several joined by and, or, not."""


class StudyTable(Table):
    """A study file."""

    scene: Key
    """The scene that is varied; relative to the study."""
    design: Literal["random", "latin_hypercube", "sobol", "halton"] = "sobol"
    """How points of the distributions are chosen."""
    samples: Count | None = None
    """Points of the distributions, for each combination of the lists."""
    combine: Literal["grid", "zip"] = "grid"
    """How lists are combined: all with all, or the first with the first."""
    repeats: Count = 1
    """How often each point is made, with other seeds."""
    seeds: Annotated[tuple[Key, ...], Listed(1, different=True)] = ("sensor.seed",)
    """Keys that count up from repeat to repeat."""
    seed: Seed = 0
    """Of the design: another one draws other points."""
    backend: Literal["auto", "gpu", "numpy"] = "auto"
    """What makes them: a device where there is one, a device, or NumPy."""
    sensitivity: bool = False
    """Choose the points that Sobol indices are computed of."""
    keep: Literal["results", "numbers"] = "results"
    """What stays in the store: all that was made, or meshes and solutions alone. Pictures and
    fields then go as soon as the rows are there, and are made again for `--sample`."""
    rows: Key | None = None
    """A CSV file of points, whose columns are keys of the scene; relative to the study."""
    parameter: Annotated[tuple[ParameterTable, ...], Listed()] = ()
    """What is varied."""
    derived: Annotated[tuple[DerivedTable, ...], Listed()] = ()
    """What follows from it."""
    constraint: Annotated[tuple[ConstraintTable, ...], Listed()] = ()
    """What samples have to fulfil."""
    budget: BudgetTable | None = None
    """Of the scene's measurements the uncertainty, in place of parameters."""
    dataset: DatasetTable | None = None
    """A data set that is made of the samples' pictures and truth."""

    @property
    def drawn(self) -> tuple[ParameterTable, ...]:
        """Parameters with a distribution."""
        return tuple(one for one in self.parameter if one.distribution)

    @model_validator(mode="after")
    def _together(self) -> Self:
        varied = self.parameter or self.derived or self.constraint or self.rows
        if self.budget is not None and (varied or self.repeats > 1):
            expected = "a study without parameters, rows and repeats"
            raise fault("budget", "draws by itself", "both", expected)
        if self.keep == "numbers" and self.dataset is not None:
            raise fault("keep", "leaves no pictures for [dataset]", self.keep, '"results"')
        if bool(self.drawn) != (self.samples is not None):
            expected = (
                "a number of points" if self.drawn else "none where nothing has a distribution"
            )
            raise fault("samples", "doesn't fit the parameters", self.samples, expected)
        if self.sensitivity and len(self.drawn) != len(self.parameter) + (self.rows is not None):
            raise fault("sensitivity", "takes distributions alone", "lists", "no lists, no rows")
        if self.sensitivity and (not self.samples or self.samples & (self.samples - 1)):
            raise fault("samples", "not a power of 2", self.samples, "64, 128, 256, ...")
        for what in ("label", "key"):
            counts = Counter(getattr(one, what) for one in self.parameter)
            if what == "key":
                counts.update(one.key for one in self.derived)
            for name, count in counts.items():
                if count > 1:
                    raise fault("parameter", "stands twice", name, "each once")
        return self


@dataclass(frozen=True)
class Study:
    """A study that was read: its ``tables``, the base ``scene``, the ``folder`` of the study's
    file, its name (``source``), the ``backend`` that it is made by ("gpu" or "numpy"), and whether
    each sample's ``truth`` is made (truth.h5, labels.json; as far as the scene asks for it)."""

    tables: StudyTable
    scene: Scene
    folder: Path
    source: str = "study"
    backend: str = "gpu"
    truth: bool = False


def load_study(
    path: str | PathLike[str], backend: str | None = None, *, budget: bool = False
) -> Study:
    """Read and check a study file, and the scene that it names; ``backend``: in place of its own.
    ``budget``: the file is a scene, whose uncertainty budget the study is.

    Raises SceneError with every fault of the tables, or of the scene; InputError for a scene that
    has variants.

    Examples
    --------
    >>> from gpusim.studies import load_study
    >>> from pathlib import Path
    >>> _ = Path("study.toml").write_text('''scene = "bar.toml"
    ... samples = 4
    ... [[parameter]]
    ... key = "camera.side.focal_mm"
    ... uniform = [49.0, 51.0]
    ... ''')
    >>> load_study("study.toml").tables.design
    'sobol'
    """
    place = Path(path)
    try:
        text = toml_text({"scene": place.name, "budget": {}}) if budget else (
            read_input(place, "a study file").text("TOML in UTF-8"))  # fmt: skip
    except InputError as error:
        raise SceneError(str(place), [unread(error, "file", place)]) from None
    document = parse_toml(text)
    if isinstance(document, Fault):
        raise SceneError(str(place), [document])
    if "schema" in document and "scene" not in document:
        expected = f'a file with scene = "{place.name}" and what is varied, or --budget'
        raise InputError(f"{place}: a scene, no study; expected {expected}")
    try:
        json.dumps(document)
        tables = StudyTable.model_validate(document)
    except TypeError:
        expected = "expected numbers, texts, lists and tables"
        raise InputError(f"{place}: a date or a time; {expected}") from None
    except ValidationError as error:
        faults, more = faults_of(error, key_lines(text), _schema())
        raise SceneError(str(place), faults, more) from None
    scene = load_scene(place.parent / tables.scene)
    if scene.variants:
        names = ", ".join(one.name for one in scene.variants)
        expected = "a scene without: list what they set as a [[parameter]]"
        raise InputError(f"{place}: scene has variants; got {names}; expected {expected}")
    labelled = tables.dataset is not None
    if tables.dataset is not None:
        scene = tables.dataset.labelled(scene)
    chosen = chosen_backend("study", backend or tables.backend)
    return Study(tables, scene, place.parent.absolute(), str(place), chosen, labelled)


def study_text(study: Study) -> str:
    """The study as a file that may lie anywhere on this machine."""
    content = study.tables.model_dump(mode="json", by_alias=True, exclude_unset=True)
    content |= {"scene": str(Path(study.scene.source).absolute()), "backend": study.backend}
    if study.tables.rows is not None:
        content["rows"] = str(study.folder / study.tables.rows)
    return toml_text(content)


def _schema() -> dict[str, Any]:
    """The JSON schema of a study file, what it refers to in place of references."""
    schema = StudyTable.model_json_schema(by_alias=True)
    definitions = schema.pop("$defs", {})

    def plain(node: Any) -> Any:
        if isinstance(node, Mapping):
            if "$ref" in node:
                return plain(definitions[node["$ref"].rsplit("/", 1)[-1]])
            return {key: plain(value) for key, value in node.items()}
        return [plain(value) for value in node] if isinstance(node, list) else node

    whole: dict[str, Any] = plain(schema)
    return whole
