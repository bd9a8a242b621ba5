"""gpusim: measurement-grade synthetic images of loaded structures, with exact ground truth.

Every layer is usable alone: solve a mesh, render a displacement field, measure images::

    import gpusim as gs

    report = gs.run(gs.load_scene("examples/crane.toml"), "out/crane")

Names are imported when they are first used, so that ``import gpusim`` is quick. Examples in
docstrings take ``import gpusim as gs`` and ``import numpy as np`` for granted.
"""

import importlib as _importlib
import typing as _typing

from gpusim._version import __version__

if _typing.TYPE_CHECKING:
    from gpusim import errors, export, fem, measure, mesh
    from gpusim.deck import Deck, load_deck
    from gpusim.errors import (
        DeviceError,
        DeviceLost,
        GpusimError,
        InputError,
        NoAdapter,
        NotConverged,
        OutOfDeviceMemory,
        SceneError,
        TwinMismatch,
    )
    from gpusim.fem import Isotropic, Model, Orthotropic, Solution
    from gpusim.field import Field, read_field
    from gpusim.gpu import Device
    from gpusim.mesh import Mesh, mesh_cad, read_mesh
    from gpusim.optics import (
        AmbientLight,
        AreaLight,
        Camera,
        EnvironmentLight,
        Frame,
        Lens,
        PointLight,
        Sensor,
        Shutter,
        SpotLight,
        SunLight,
        Truth,
        Vignetting,
        photograph,
        psf,
        render,
    )
    from gpusim.optics.calibration.formats import read_calibration, write_calibration
    from gpusim.pipeline import run
    from gpusim.pipeline.stages.mechanics import solve
    from gpusim.report import Report
    from gpusim.scene import Scene, load_scene
    from gpusim.surface import Atlas, CylinderFrame, PaintFrame, Skin, Surface, paint

__all__ = [
    "AmbientLight",
    "AreaLight",
    "Atlas",
    "Camera",
    "CylinderFrame",
    "Deck",
    "Device",
    "DeviceError",
    "DeviceLost",
    "EnvironmentLight",
    "Field",
    "Frame",
    "GpusimError",
    "InputError",
    "Isotropic",
    "Lens",
    "Mesh",
    "Model",
    "NoAdapter",
    "NotConverged",
    "Orthotropic",
    "OutOfDeviceMemory",
    "PaintFrame",
    "PointLight",
    "Report",
    "Scene",
    "SceneError",
    "Sensor",
    "Shutter",
    "Skin",
    "Solution",
    "SpotLight",
    "SunLight",
    "Surface",
    "Truth",
    "TwinMismatch",
    "Vignetting",
    "__version__",
    "errors",
    "export",
    "fem",
    "load_deck",
    "load_scene",
    "measure",
    "mesh",
    "mesh_cad",
    "paint",
    "photograph",
    "psf",
    "read_calibration",
    "read_field",
    "read_mesh",
    "render",
    "run",
    "solve",
    "write_calibration",
]

_HOMES = {
    "gpusim.deck": ("Deck", "load_deck"),
    "gpusim.errors": (
        "DeviceError",
        "DeviceLost",
        "GpusimError",
        "InputError",
        "NoAdapter",
        "NotConverged",
        "OutOfDeviceMemory",
        "SceneError",
        "TwinMismatch",
    ),
    "gpusim.fem": ("Isotropic", "Model", "Orthotropic", "Solution"),
    "gpusim.field": ("Field", "read_field"),
    "gpusim.gpu": ("Device",),
    "gpusim.mesh": ("Mesh", "mesh_cad", "read_mesh"),
    "gpusim.optics": (
        "AmbientLight",
        "AreaLight",
        "Camera",
        "EnvironmentLight",
        "Frame",
        "Lens",
        "PointLight",
        "Sensor",
        "Shutter",
        "SpotLight",
        "SunLight",
        "Truth",
        "Vignetting",
        "photograph",
        "psf",
        "render",
    ),
    "gpusim.optics.calibration.formats": ("read_calibration", "write_calibration"),
    "gpusim.pipeline": ("run",),
    "gpusim.pipeline.stages.mechanics": ("solve",),
    "gpusim.report": ("Report",),
    "gpusim.scene": ("Scene", "load_scene"),
    "gpusim.surface": ("Atlas", "CylinderFrame", "PaintFrame", "Skin", "Surface", "paint"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
_MODULES = ("errors", "export", "fem", "measure", "mesh")


def __getattr__(name: str) -> _typing.Any:
    if name in _MODULES:
        return _importlib.import_module(f"gpusim.{name}")
    if name in _HOME_OF:
        return getattr(_importlib.import_module(_HOME_OF[name]), name)
    raise AttributeError(f"module 'gpusim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
