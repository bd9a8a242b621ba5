"""Lens, shutter and sensor tables to the model: units to SI, electrons and shares."""

from __future__ import annotations

from gpusim.scene.description import photo
from gpusim.scene.schema.lens import (
    AiryTable,
    DiscTable,
    GaussianTable,
    LensTable,
    PsfTable,
    ShutterTable,
)
from gpusim.scene.schema.sensor import SensorTable

__all__ = ["lens", "sensor", "shutter"]

_SENSOR = {
    "gain_DN_per_e": ("gain", 1.0),
    "full_well_e": ("full_well", 1.0),
    "read_noise_e": ("read_noise", 1.0),
    "dark_current_e_per_s": ("dark_current", 1.0),
    "dsnu_e": ("dsnu", 1.0),
    "prnu_percent": ("prnu", 0.01),
    "black_level_DN": ("black_level", 1.0),
    "gamma": ("gamma", 1.0),
}


def _grid(rows: list[list[float]]) -> photo.Grid:
    return tuple(tuple(row) for row in rows)


def _psf(table: PsfTable) -> photo.Psf:
    if isinstance(table, GaussianTable):
        return photo.Psf("gaussian", table.sigma_px)
    if isinstance(table, AiryTable):
        return photo.Psf("airy", table.f_number, table.wavelength_nm / 1e9)
    if isinstance(table, DiscTable):
        return photo.Psf("disc", table.radius_px)
    return photo.Psf("measured", table.samples_per_px, kernel=_grid(table.kernel))


def lens(table: LensTable | None) -> photo.Lens | None:
    """The lens; None for a pinhole."""
    if table is None:
        return None
    fall = table.vignetting
    distance = table.focus_distance_mm
    return photo.Lens(
        psf=None if table.psf is None else _psf(table.psf),
        fill_factor=table.fill_factor,
        f_number=table.f_number,
        focus_distance=None if distance is None else distance / 1000.0,
        blades=table.blades,
        vignetting=None
        if fall is None
        else photo.Vignetting(
            fall.cos4, tuple(fall.polynomial), None if fall.map is None else _grid(fall.map)
        ),
        focal=None if table.focal_mm is None else table.focal_mm / 1000.0,
        positions=table.positions,
    )


def shutter(table: ShutterTable | None) -> photo.Shutter | None:
    """The shutter; None for an instant."""
    if table is None:
        return None
    return photo.Shutter(table.exposure_ms / 1e3, table.line_time_us / 1e6, table.samples)


def sensor(table: SensorTable) -> photo.Sensor:
    """The sensor, with what is given of its noise."""
    values: list[tuple[str, float | str | tuple[float, ...]]] = []
    for key, (name, factor) in _SENSOR.items():
        value = getattr(table, key)
        if value is not None:
            values.append((name, factor * value))
    if table.bayer is not None:
        values += [("bayer", table.bayer), ("bayer_response", tuple(table.bayer_response))]
    exposure = None if table.exposure == "auto" else float(table.exposure)
    return photo.Sensor(
        table.bits, exposure, table.format, table.seed, table.preset, tuple(values), table.series
    )
