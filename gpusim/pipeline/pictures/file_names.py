"""What the pictures of a run are called in its output folder."""

from __future__ import annotations

from pathlib import Path

from gpusim.files.output_folder import inside
from gpusim.scene import Scene

FILMS = {
    "ffv1": "{}.mkv", "mraw": "{}.cih", "tiff": "{}/*.tif", "png": "{}/*.png", "mp4": "{}.mp4",
}  # fmt: skip
"""Of a camera, by the format of its film."""


def image_name(scene: Scene, camera: str, frame: int, kind: str = "") -> str:
    """What the picture of a frame is called; ``kind`` "calib-" for those of a target."""
    suffix = "png" if scene.sensor.format == "png" else "tif"
    return f"images/{camera}/{kind}{frame:04d}.{suffix}"


def image_path(scene: Scene, out: Path, camera: str, frame: int) -> Path:
    """Where it lies."""
    return inside(out, image_name(scene, camera, frame))


def film_names(scene: Scene, camera: str) -> tuple[str, str]:
    """What a camera's film is called, and the small one that the report plays."""
    assert scene.video is not None
    name = FILMS[scene.video.format].format(camera)
    return f"video/{name}", f"video/preview/{camera}.mp4"


def corners_name(picture: str) -> str:
    """What the board's corners in a picture are kept as."""
    return f"{picture.rsplit('.', 1)[0]}-corners.npz"
