"""What is done with a scene: ``[solver]``, ``[render]``, ``[output]``, ``[[variant]]``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from gpusim.scene.tables.colors import Tint
from gpusim.scene.tables.table import Listed, Name, Table

TruthLayer = Literal[
    "reference",
    "displacement",
    "depth",
    "flow",
    "forward_flow",
    "region",
    "element",
    "visibility",
    "cameras",
    "normal",
]
CalibrationFormat = Literal["opencv", "matchid", "vic", "dice", "kalibr"]


class SolverTable(Table):
    """How far to solve.

    Example::

        tolerance = 1e-8
        method = "direct"
    """

    # the keys are arguments of `gpusim.fem.solve`

    tolerance: Annotated[float, Field(gt=0, le=0.1)] = 1e-6
    """Estimated relative error of the displacement (energy norm) at which the solver stops."""
    max_iterations: Annotated[int, Field(ge=1)] | None = None
    """Of conjugate gradients (a direct solver has none); without it the solver chooses; running out
    of them ends the run with exit code 3."""
    method: Literal["auto", "direct", "multigrid"] = "auto"
    """"auto": the quicker one of a direct solver and multigrid, by an estimate for the matrix."""


class RenderTable(Table):
    """How exact the images are.

    Example::

        error = 0.1
        background = 0.2
    """

    error: Annotated[float, Field(gt=0, le=16)] = 0.25
    """Allowed error of a pixel, in grey levels of 8 bit: so many lens positions and moments."""
    background: Tint = 0.0
    """Radiance where nothing is seen (W / (m2 sr); without lights: albedo)."""


class OutputTable(Table):
    """What is written beside images, measurements and report.

    Example::

        truth = ["reference", "displacement", "flow"]
        vtu = true
        stress = true
    """

    truth: Annotated[tuple[TruthLayer, ...], Listed(different=True)] = ()
    """Layers of truth.h5, per camera and frame, where a body is seen (not a prop)."""
    labels: bool = False
    """Where bodies and props, and the middles of their markers and corners of their boards, are in
    every picture: labels.json."""
    vtu: bool = False
    """The solution for ParaView."""
    stress: bool = False
    """Stress, von Mises stress and an error indicator, in the .vtu files and the report."""
    stl: bool = False
    """The deformed surface, one file per paint and frame."""
    fields: bool = True
    """Pictures of the bodies in the colours of their displacement, stress and strain, in the folder
    fields, and in the report. Stress and strain where stress is asked for, or the meshes have at
    most 20,000 elements together."""
    calibration: Annotated[tuple[CalibrationFormat, ...], Listed(different=True)] = ()
    """The cameras as calibration files of these programs."""


class VariantTable(Table):
    """A state of the scene. With variants, a run makes all of them, in ``variants/<name>``.

    Example::

        name = "notched"
        set = { "body.beam.notch" = [{ position_mm = 60.0, width_mm = 2.0, depth_mm = 4.0 }] }
    """

    name: Name
    """Of its folder, and what measures and the report call it."""
    changes: Annotated[dict[str, Any], Field(alias="set")] = {}
    """Keys of the scene that are different: dotted paths, as in --set."""
