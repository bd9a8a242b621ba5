"""Effects that make a measured number differ from the true one, switched off one by one.

An effect is a change of the scene's document: what has to go, so that the images don't have it.
Geometry, loads and the pixels' size stay as they are.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from gpusim.errors import nearest_name, require

Document = dict[str, Any]
_GONE = object()


class Effect(NamedTuple):
    """What it is ``about``, and what takes it out of a document: of which tables which keys, if
    they are there, become what."""

    about: str
    changes: Mapping[str, Mapping[str, Any]]


_SENSOR, _OWN_SENSOR, _CAMERA, _LENS = "sensor", "camera.sensor", "camera", "camera.lens"
_FINE, _EXPOSED = {"bits": 16}, {"exposure": "auto"}
_NOISE = dict.fromkeys(
    ("read_noise_e", "dark_current_e_per_s", "dsnu_e", "prnu_percent", "full_well_e",
     "gain_DN_per_e", "preset", "black_level_DN", "seed"),
    _GONE,
)  # fmt: skip
_MOSAIC = {"bayer": _GONE, "bayer_response": _GONE, "demosaic": _GONE, "exposure": "auto"}
_DEPTH_OF_FIELD = ("f_number", "focus_distance_mm", "focal_mm", "positions")

EFFECTS: Mapping[str, Effect] = {
    "noise": Effect("shot, dark and read-out noise, pixels that differ, and the black level",
                    {_SENSOR: _NOISE, _OWN_SENSOR: _NOISE}),
    "quantisation": Effect("grey values in whole numbers", {_SENSOR: _FINE, _OWN_SENSOR: _FINE}),
    "mosaic": Effect("one chip under colour filters: demosaicing makes up two colours of three",
                     {_SENSOR: _MOSAIC, _OWN_SENSOR: _MOSAIC}),
    "gamma": Effect("the curve of grey values, which moves blurred edges",
                    {_SENSOR: {"gamma": _GONE}, _OWN_SENSOR: {"gamma": _GONE}}),
    "psf": Effect("the lens's point spread, and gaps between pixels",
                  {_LENS: {"psf": _GONE, "fill_factor": 1.0}}),
    "defocus": Effect("depth of field", {_LENS: dict.fromkeys(_DEPTH_OF_FIELD, _GONE)}),
    "vignetting": Effect("fall-off towards the corners", {_LENS: {"vignetting": _GONE}}),
    "distortion": Effect("that of the lens, of cameras that no calibration file tells of",
                         {_CAMERA: {"distortion": []}}),
    "motion": Effect("blur while the shutter is open",
                     {_CAMERA: {"shutter": _GONE}, "video": {"exposure_us": _GONE}}),
    "trigger": Effect("frames that aren't exposed at their times",
                      {_CAMERA: {"trigger": _GONE}}),
    "flicker": Effect("lamps that flicker", {"light": {"flicker": _GONE}}),
    "drift": Effect("light that drifts, and cameras that move, after the first frame",
                    {_SENSOR: {"drift_percent": _GONE},
                     _CAMERA: {"moved_um": _GONE, "turned_deg": _GONE}}),
    "shadows": Effect("what surfaces hide of lamps and surroundings",
                      {"light": {"shadows": False, "occlusion": False}}),
    "light": Effect("uneven light and its shadows: without, grey is the paint's albedo",
                    {"": {"light": []}, _SENSOR: _EXPOSED, _OWN_SENSOR: _EXPOSED}),
}  # fmt: skip
"""Every effect by its name."""
_NEEDS = {"shadows": ("light",), "flicker": ("light", "motion")}


def _tables(document: Document, path: str) -> list[Document]:
    """The tables at a path; a list on the way stands for every item of it."""
    here: list[Any] = [document]
    for key in filter(None, path.split(".")):
        found = [table[key] for table in here if table.get(key)]
        here = [one for some in found for one in (some if isinstance(some, list) else [some])]
    return here


def lenses_of_files(document: Mapping[str, Any]) -> dict[str, str]:
    """Cameras whose distortion a measure's calibration file undoes, and the measure: it would undo
    it as well where the pictures have none."""
    of = {
        camera: measure["name"]
        for measure in document.get("measure", ())
        if measure.get("calibration") not in (None, "true")
        for camera in measure.get("cameras") or ()
    }
    bent = [one["name"] for one in document.get("camera", ()) if one.get("distortion")]
    return {camera: of[camera] for camera in bent if camera in of}


def active_effects(document: Mapping[str, Any]) -> tuple[str, ...]:
    """The effects that the scene has: those without which it would be another one."""
    return tuple(name for name in EFFECTS if _without(document, [name]) != document)


def without_effects(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    """The document without some effects.

    Raises
    ------
    InputError
        A name that isn't one of `EFFECTS`.
    """
    check_effects(names, "--no")
    return _without(document, names)


def with_only(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    """The document with none of the effects but ``names``. Raises InputError as above."""
    check_effects(names, "--only")
    # shadows are a part of the light: with the light goes what they fall on
    kept = set(names).union(*(_NEEDS.get(name, ()) for name in names))
    kept |= {"shadows"} if "light" in names else set()
    return _without(document, [name for name in EFFECTS if name not in kept])


def with_other_patterns(document: Mapping[str, Any], number: int) -> Document:
    """The document with another drawing of every random pattern, by its ``number`` from 1 up."""
    result = copy.deepcopy(dict(document))
    for path in ("body.paint", "prop.paint"):
        for paint in _tables(result, path):
            if "seed" in paint:
                paint["seed"] = int(paint["seed"]) + number
    return result


def check_effects(names: Iterable[str], option: str) -> None:
    """Raise InputError for a name that isn't an effect."""
    for name in names:
        expected = ", ".join(EFFECTS) + nearest_name(name, EFFECTS)
        require(name in EFFECTS, f"{option}: unknown effect", repr(name), expected)


def _without(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    result = copy.deepcopy(dict(document))
    exposures = [camera.get("shutter") for camera in _tables(result, _CAMERA)]
    exposures += [video.get("exposure_us") for video in _tables(result, "video")]
    if "motion" in names and any(exposures):
        names = [*names, "flicker"]  # which nothing would average any more
    for name in names:
        if name == "noise" and not _counts_electrons(result):
            continue
        if name == "mosaic" and not any("demosaic" in sensor for sensor in _sensors(result)):
            continue  # a raw one is a grey picture, whose channels nothing keeps apart
        if name == "light" and not result.get("light"):
            continue
        kept = lenses_of_files(result) if name == "distortion" else {}
        for path, changes in EFFECTS[name].changes.items():
            for table in _tables(result, path):
                if table.get("name") in kept:
                    continue
                table |= {key: value for key, value in changes.items() if key in table}
                for key in [key for key, value in table.items() if value is _GONE]:
                    del table[key]
    return result


def _sensors(document: Document) -> list[Document]:
    return [*_tables(document, _SENSOR), *_tables(document, _OWN_SENSOR)]


def _counts_electrons(document: Document) -> bool:
    """Whether any sensor has noise; without, its seed and black level say nothing of it."""
    counted = ("preset", "full_well_e", "gain_DN_per_e")
    return any(sensor.get(key) is not None for sensor in _sensors(document) for key in counted)
