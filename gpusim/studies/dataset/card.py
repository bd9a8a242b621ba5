"""The card of a data set: how it was made, what its labels mean, how much there is of what."""

from __future__ import annotations

import platform
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from gpusim._version import __version__
from gpusim.graph.stage import digest
from gpusim.pipeline.pictures.file_names import image_name

if TYPE_CHECKING:  # who calls this knows them
    from gpusim.studies.study_tables import Study

MANIFESTS = "manifest.parquet", "manifest.csv"


def card_text(
    study: Study,
    counts: Mapping[str, Sequence[int]],
    used: int,
    samples: int,
    files: Collection[str],
) -> str:
    """The card, README.md: ``counts`` of items, structures and samples by split, ``samples`` of the
    study, of which so many are ``used``; ``files`` beside it."""
    pages = Environment(
        loader=PackageLoader("gpusim.studies", "dataset"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    tables = study.tables
    content = [tables.model_dump(mode="json", by_alias=True), study.scene.digest()]
    return pages.get_template("card.md.j2").render(
        study=tables, table=tables.dataset, scene=study.scene.name, counts=counts, samples=samples,
        used=used, version=__version__, python=platform.python_version(), digest=digest(content),
        suffix=Path(image_name(study.scene, "", 0)).suffix,
        manifest=MANIFESTS[MANIFESTS[0] not in files],
    )  # fmt: skip
