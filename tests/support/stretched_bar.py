"""A bar that is pulled and stays on rollers, so that its displacement is known in closed form, and
studies of it.

The front face lies in the plane y = 0 and stays there: u = (e x, -nu e y, -nu e z), e = stress / E.
Cameras are described here a second time, from their textbook formulas.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.scene.toml_text import toml_text

E_MPA, NU, SIZE = 1000.0, 0.3, (60.0, 10.0, 30.0)
FOCAL_PX, RESOLUTION = 400.0, (96, 48)
PARAMETERS = """
backend = "numpy"
[[parameter]]
key = "body.bar.load.pull.traction_MPa"
list = [[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [-15.0, 0.0, 0.0], [40.0, 0.0, 0.0]]
name = "traction"
[[parameter]]
key = "camera.front.position_mm"
list = [[30.0, -300.0, 15.0], [80.0, -300.0, 40.0]]
name = "place"
[dataset]
splits = { train = 0.5, val = 0.25, test = 0.25 }
"""
DOCUMENT: dict[str, Any] = {
    "schema": 1, "name": "pulled",
    "material": [{"name": "soft", "youngs_modulus_GPa": E_MPA / 1e3, "poissons_ratio": NU}],
    "body": [{
        "name": "bar", "material": "soft",
        "mesh": {"builder": "box", "size_mm": list(SIZE), "divisions": [6, 1, 3]},
        "support": [{"name": axis, "where": {"set": f"{axis}_min"}, "fix": [axis]}
                    for axis in "xyz"],
        "load": [{"name": "pull", "type": "traction", "where": {"set": "x_max"},
                  "traction_MPa": [10.0, 0.0, 0.0]}],
        "paint": [{"name": "speckle", "type": "speckle", "where": {"normal": "-y"}, "albedo": 0.8,
                   "diameter_mm": 2.5, "softness_mm": 0.4}],
    }],
    "prop": [{"name": "board", "center_mm": [30.0, 5.0, -7.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [64.0, 12.0],
              "poses": [{"position_mm": [30.0, 5.0, -7.0]},
                        {"position_mm": [32.0, 1.0, -6.5], "rotation_deg": [5.0, 3.0, 20.0]}],
              "paint": [{"name": "fields", "type": "checker", "albedo": 0.9, "cell_mm": 4.0,
                         "columns": 12, "rows": 3, "origin_mm": [6.0, 5.0, -13.0]}]}],
    "camera": [{"name": "front", "sensor_mm": [9.6, 4.8], "resolution_px": list(RESOLUTION),
                "focal_mm": 40.0, "position_mm": [30.0, -300.0, 15.0],
                "target_mm": [30.0, 0.0, 7.0]}],
    "solver": {"method": "direct"},
    "sensor": {"exposure": "auto", "full_well_e": 10000.0, "read_noise_e": 3.0},
}  # fmt: skip


def write_study(folder: Path, text: str, **changes: Any) -> Path:
    """A study of the bar; ``text``: all but the scene's name; ``changes`` of the scene's tables."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bar.toml").write_text(toml_text(DOCUMENT | changes), encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(f'scene = "bar.toml"\n{text}', encoding="utf-8")
    return path


@dataclass(frozen=True)
class PlainCamera:
    """A pinhole camera (mm, px) at ``position`` that looks at ``target``, z up."""

    position: tuple[float, float, float] = (30.0, -300.0, 15.0)
    target: tuple[float, float, float] = (30.0, 0.0, 7.0)

    @property
    def axes(self) -> Float:
        """Rows right, down, forward."""
        forward = np.subtract(self.target, self.position)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def middle(self) -> Float:
        return (np.array(RESOLUTION) - 1.0) / 2.0

    def pixels(self, points: Float) -> Float:
        """Where points (..., 3) are."""
        own = (points - np.array(self.position)) @ self.axes.T
        return self.middle + FOCAL_PX * own[..., :2] / own[..., 2:]

    def on_front(self, pixels: Float) -> Float:
        """The places (..., 3) in the plane y = 0 that pixels (..., 2) show."""
        own = np.concatenate([(pixels - self.middle) / FOCAL_PX, np.ones((*pixels.shape[:-1], 1))],
                             axis=-1)  # fmt: skip
        rays = own @ self.axes
        return np.array(self.position) - rays * (self.position[1] / rays[..., 1:2])


def stretch(stress_MPa: float) -> Float:
    """By what coordinates grow."""
    strain = stress_MPa / E_MPA
    return 1.0 + strain * np.array([1.0, -NU, -NU])


def every_pixel() -> Float:
    """(H, W, 2)."""
    row, column = np.indices(RESOLUTION[::-1])
    return np.stack([column, row], axis=2).astype(np.float64)


def true_forward_flow(camera: PlainCamera, stress_MPa: float) -> Float:
    """(H, W, 2) px from the unloaded picture to the loaded one, NaN beside the front face."""
    pixels = every_pixel()
    place = camera.on_front(pixels)
    flow = camera.pixels(place * stretch(stress_MPa)) - pixels
    flow[~_on_bar(place)] = np.nan
    return flow


def true_flow(camera: PlainCamera, stress_MPa: float) -> Float:
    """The same from the loaded picture back to the unloaded one."""
    pixels = every_pixel()
    place = camera.on_front(pixels) / stretch(stress_MPa)
    flow = camera.pixels(place) - pixels
    flow[~_on_bar(place)] = np.nan
    return flow


def _on_bar(place: Float) -> Any:
    return ((place[..., ::2] >= 0.0) & (place[..., ::2] <= np.array(SIZE)[::2])).all(axis=-1)
