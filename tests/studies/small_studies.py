"""A study whose samples take tenths of a second, by NumPy."""

from __future__ import annotations

from pathlib import Path

from tests.hostile.tiny_runs import write_scene

__all__ = ["FOCAL", "write_study"]

FOCAL = "camera.side.focal_mm"
YOUNG = "material.0.youngs_modulus_GPa"
STUDY = f"""scene = "bar.toml"
backend = "numpy"
repeats = 2
[[parameter]]
key = "{YOUNG}"
list = [60.0, 70.0]
name = "E"
[[parameter]]
key = "{FOCAL}"
list = [29.0, 30.0]
name = "f"
"""


def write_study(folder: Path, text: str = STUDY) -> Path:
    """The study's file beside its scene, whose camera has noise."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = write_scene(folder)
    with scene.open("a", encoding="utf-8") as stream:
        stream.write('\n[sensor]\npreset = "stereo-dic-5mp"\n')
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path
