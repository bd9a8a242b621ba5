"""gpusim: measurement-grade synthetic images of loaded structures, with exact ground truth.

Every layer is usable alone: solve a mesh, render a displacement field, measure images::

    import gpusim as gs

    report = gs.run(gs.load_scene("examples/crane.toml"), "out/crane")

Names are imported when they are first used, so that ``import gpusim`` is quick. Examples in
docstrings take ``import gpusim as gs`` and ``import numpy as np`` for granted.

Its parts, in the order in which they import each other:

- `_version`: Where the version stands.
- `choices`: What users choose from by a word: lenses, strains, shapes of subsets.
- `errors`: Every error that is raised on purpose.
- `validation`: Arguments of the Python API, checked before any work.
- `interrupts`: Ctrl-C while a command starts, and at a window.
- `printable`: Texts of other people, shown without what commands a terminal.
- `display`: How objects show themselves in notebooks, and draw themselves.
- `field_summary`: How objects with arrays show themselves at a prompt.
- `public_names`: What a package shows of itself.
- `arrays`: What NumPy lacks, or does slowly.
- `files`: Read once, written whole.
- `parallel`: Processors, threads, processes and memory of this machine.
- `gpu`: The device: programs, buffers, recordings, the check against NumPy.
- `scene`: Scene files, and what they say in SI.
- `mesh`: Points and cells, builders, readers, selections.
- `fem`: Linear elastic finite elements.
- `field`: Displacement fields of other programs.
- `deck`: Input decks of Abaqus and CalculiX.
- `surface`: What cameras see: surfaces and their paint.
- `optics`: Images: cameras, lights, shading, shadows, sensor, ground truth.
- `measure`: Measuring images; sees pictures only.
- `motion`: Where the nodes of a body are: the only door to displacements.
- `export`: Files that other programs read.
- `applications`: Files in, results and a page out: correlation, calibration, decks.
- `graph`: A run as a graph of stages; results by content.
- `plan`: The stages of a run, and their costs.
- `visualization`: Bodies in the colours of a field, and what is drawn over pictures.
- `report`: What a run found.
- `pipeline`: From a scene to an output folder.
- `studies`: Many states of one scene, and the table of what was measured.
- `notebook`: Tables, pictures and plots for notebooks.
- `view`: The preview window.
- `bench`: Run time against error, on this machine.
- `twin_checks`: Each shader against its NumPy twin.
- `cli`: The command line.
- `__main__`: Where it begins.
"""

import typing as _typing

from gpusim._version import __version__ as __version__
from gpusim.public_names import public_names as _public_names

if _typing.TYPE_CHECKING:
    from gpusim import applications as applications
    from gpusim import errors as errors
    from gpusim import export as export
    from gpusim import fem as fem
    from gpusim import measure as measure
    from gpusim import mesh as mesh
    from gpusim.applications.field_scene import field_scene as field_scene
    from gpusim.deck import Deck as Deck
    from gpusim.deck import load_deck as load_deck
    from gpusim.errors import DeviceError as DeviceError
    from gpusim.errors import DeviceLost as DeviceLost
    from gpusim.errors import GpusimError as GpusimError
    from gpusim.errors import InputError as InputError
    from gpusim.errors import NoAdapter as NoAdapter
    from gpusim.errors import NotConverged as NotConverged
    from gpusim.errors import OutOfDeviceMemory as OutOfDeviceMemory
    from gpusim.errors import SceneError as SceneError
    from gpusim.errors import TwinMismatch as TwinMismatch
    from gpusim.export.video import write_video as write_video
    from gpusim.fem import J2 as J2
    from gpusim.fem import Buckling as Buckling
    from gpusim.fem import Hencky as Hencky
    from gpusim.fem import History as History
    from gpusim.fem import Isotropic as Isotropic
    from gpusim.fem import ModalDamping as ModalDamping
    from gpusim.fem import Model as Model
    from gpusim.fem import Modes as Modes
    from gpusim.fem import NeoHookean as NeoHookean
    from gpusim.fem import Orthotropic as Orthotropic
    from gpusim.fem import Rayleigh as Rayleigh
    from gpusim.fem import Record as Record
    from gpusim.fem import SaintVenantKirchhoff as SaintVenantKirchhoff
    from gpusim.fem import Solution as Solution
    from gpusim.fem import StructuralDamping as StructuralDamping
    from gpusim.fem import buckling as buckling
    from gpusim.fem import frequency_response as frequency_response
    from gpusim.fem import harmonic as harmonic
    from gpusim.fem import modes as modes
    from gpusim.fem import random_response as random_response
    from gpusim.fem import read_record as read_record
    from gpusim.fem import transient as transient
    from gpusim.field import Field as Field
    from gpusim.field import read_field as read_field
    from gpusim.files.frame_source import FrameSource as FrameSource
    from gpusim.files.frame_source import read_frames as read_frames
    from gpusim.files.frame_source import read_video as read_video
    from gpusim.gpu import Device as Device
    from gpusim.mesh import Mesh as Mesh
    from gpusim.mesh import mesh_cad as mesh_cad
    from gpusim.mesh import read_mesh as read_mesh
    from gpusim.optics import AmbientLight as AmbientLight
    from gpusim.optics import AreaLight as AreaLight
    from gpusim.optics import Camera as Camera
    from gpusim.optics import EnvironmentLight as EnvironmentLight
    from gpusim.optics import Flicker as Flicker
    from gpusim.optics import Frame as Frame
    from gpusim.optics import Lens as Lens
    from gpusim.optics import PointLight as PointLight
    from gpusim.optics import Sensor as Sensor
    from gpusim.optics import Shutter as Shutter
    from gpusim.optics import SpotLight as SpotLight
    from gpusim.optics import SunLight as SunLight
    from gpusim.optics import Truth as Truth
    from gpusim.optics import Vignetting as Vignetting
    from gpusim.optics import blackbody as blackbody
    from gpusim.optics import photograph as photograph
    from gpusim.optics import psf as psf
    from gpusim.optics import render as render
    from gpusim.optics.calibration.calibration_files import (
        write_calibration_files as write_calibration_files,
    )
    from gpusim.optics.calibration.formats import read_calibration as read_calibration
    from gpusim.optics.calibration.formats import write_calibration as write_calibration
    from gpusim.optics.calibration.lens_fit import fit_lens as fit_lens
    from gpusim.pipeline import run as run
    from gpusim.pipeline.runner.explanation import explain as explain
    from gpusim.pipeline.scene_solution import solve as solve
    from gpusim.report import Report as Report
    from gpusim.scene import Scene as Scene
    from gpusim.scene import load_scene as load_scene
    from gpusim.studies import load_study as load_study
    from gpusim.studies.study import study as study
    from gpusim.surface import Atlas as Atlas
    from gpusim.surface import CylinderFrame as CylinderFrame
    from gpusim.surface import PaintFrame as PaintFrame
    from gpusim.surface import Skin as Skin
    from gpusim.surface import Surface as Surface
    from gpusim.surface import paint as paint

_HOMES = {
    "gpusim": "applications errors export fem measure mesh",
    "gpusim._version": "__version__",
    "gpusim.applications.field_scene": "field_scene",
    "gpusim.deck": "Deck load_deck",
    "gpusim.errors": (
        "DeviceError DeviceLost GpusimError InputError NoAdapter NotConverged "
        "OutOfDeviceMemory SceneError TwinMismatch"
    ),
    "gpusim.export.video": "write_video",
    "gpusim.fem": (
        "Buckling Hencky History Isotropic J2 ModalDamping Model Modes NeoHookean Orthotropic "
        "Rayleigh Record SaintVenantKirchhoff Solution StructuralDamping buckling "
        "frequency_response harmonic modes random_response read_record transient"
    ),
    "gpusim.field": "Field read_field",
    "gpusim.files.frame_source": "FrameSource read_frames read_video",
    "gpusim.gpu": "Device",
    "gpusim.mesh": "Mesh mesh_cad read_mesh",
    "gpusim.optics": (
        "AmbientLight AreaLight Camera EnvironmentLight Flicker Frame Lens PointLight Sensor "
        "Shutter SpotLight SunLight Truth Vignetting blackbody photograph psf render"
    ),
    "gpusim.optics.calibration.calibration_files": "write_calibration_files",
    "gpusim.optics.calibration.formats": "read_calibration write_calibration",
    "gpusim.optics.calibration.lens_fit": "fit_lens",
    "gpusim.pipeline": "run",
    "gpusim.pipeline.runner.explanation": "explain",
    "gpusim.pipeline.scene_solution": "solve",
    "gpusim.report": "Report",
    "gpusim.scene": "Scene load_scene",
    "gpusim.studies": "load_study",
    "gpusim.studies.study": "study",
    "gpusim.surface": "Atlas CylinderFrame PaintFrame Skin Surface paint",
}
__all__, __getattr__, __dir__ = _public_names(__name__, _HOMES)
