"""Effects that make a measured number differ from the true one, switched off one by one.

A source is a change of the scene's document: what has to go, so that the images don't have it.
Geometry, loads and the pixels' size stay as they are.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from gpusim.errors import InputError
from gpusim.scene.faults.key_paths import nearest

__all__ = ["SOURCES", "active_sources", "check_sources", "with_only", "without_sources"]

Document = dict[str, Any]
ELECTRONS = ("read_noise_e", "dark_current_e_per_s", "dsnu_e", "prnu_percent", "full_well_e",
             "gain_DN_per_e", "preset", "black_level_DN", "seed")  # fmt: skip
FINEST_BITS = 16


def _sensors(document: Document) -> list[Document]:
    """[sensor], and what cameras have of their own."""
    own = [camera.get("sensor") for camera in document.get("camera", [])]
    return [document.setdefault("sensor", {}), *(one for one in own if one)]


def _noise(document: Document) -> None:
    """Shot, dark and read-out noise, pixels that differ; with them the black level."""
    counted, sensors = ("preset", "full_well_e", "gain_DN_per_e"), _sensors(document)
    if any(sensor.get(key) is not None for sensor in sensors for key in counted):
        for sensor in sensors:
            for key in ELECTRONS:
                sensor.pop(key, None)


def _quantisation(document: Document) -> None:
    """Grey values in whole numbers: 16 bits instead of the sensor's."""
    for sensor in _sensors(document):
        sensor["bits"] = FINEST_BITS


def _psf(document: Document) -> None:
    """The lens's point spread and the gaps between pixels."""
    for camera in document.get("camera", []):
        lens = camera.get("lens") or {}
        lens.pop("psf", None)
        if "fill_factor" in lens:
            lens["fill_factor"] = 1.0


def _defocus(document: Document) -> None:
    """Depth of field."""
    for camera in document.get("camera", []):
        lens = camera.get("lens") or {}
        for key in ("f_number", "focus_distance_mm", "focal_mm", "positions"):
            lens.pop(key, None)


def _vignetting(document: Document) -> None:
    """Fall-off towards the corners."""
    for camera in document.get("camera", []):
        (camera.get("lens") or {}).pop("vignetting", None)


def _distortion(document: Document) -> None:
    """The lens's distortion, as far as it stands in the scene (not in a calibration file)."""
    for camera in document.get("camera", []):
        camera["distortion"] = []


def _motion(document: Document) -> None:
    """Motion while the shutter is open."""
    for camera in document.get("camera", []):
        camera.pop("shutter", None)


def _shadows(document: Document) -> None:
    """What surfaces hide of lamps and surroundings."""
    for lamp in document.get("light", []):
        for key in ("shadows", "occlusion"):
            if key in lamp:
                lamp[key] = False


def _light(document: Document) -> None:
    """Uneven light, shadows included: every paint has its albedo's grey."""
    if document.get("light"):
        document["light"] = []
        for sensor in _sensors(document):
            sensor["exposure"] = "auto"  # radiance is albedo now


SOURCES: Mapping[str, Callable[[Document], None]] = {
    "noise": _noise,
    "quantisation": _quantisation,
    "psf": _psf,
    "defocus": _defocus,
    "vignetting": _vignetting,
    "distortion": _distortion,
    "motion": _motion,
    "shadows": _shadows,
    "light": _light,
}
"""What takes an effect out of a document, by the effect's name."""


def active_sources(document: Mapping[str, Any]) -> tuple[str, ...]:
    """The effects that the scene has: those without which it would be another one."""
    return tuple(name for name in SOURCES if _without(document, [name]) != document)


def without_sources(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    """The document without some effects.

    Raises
    ------
    InputError
        A name that isn't one of `SOURCES`.
    """
    check_sources(names, "--no")
    return _without(document, names)


def with_only(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    """The document with none of the effects but ``names``. Raises InputError as above."""
    check_sources(names, "--only")
    # shadows are a part of the light: with the light goes what they fall on
    kept = {*names, "light"} if "shadows" in names else set(names)
    kept |= {"shadows"} if "light" in names else set()
    return _without(document, [name for name in SOURCES if name not in kept])


def check_sources(names: Iterable[str], option: str) -> None:
    """Raise InputError for a name that isn't an effect."""
    for name in names:
        if name not in SOURCES:
            near = nearest(name, list(SOURCES))
            hint = f"; did you mean {near}?" if near else ""
            raise InputError(
                f"{option}: unknown effect; got {name!r}; expected {', '.join(SOURCES)}{hint}"
            )


def _without(document: Mapping[str, Any], names: Sequence[str]) -> Document:
    result = copy.deepcopy(dict(document))
    for name in names:
        SOURCES[name](result)
    return result
