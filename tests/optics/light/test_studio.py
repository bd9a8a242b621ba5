"""The studio: its mean, how smooth it is, and that flat steel finds gradients in it."""

from __future__ import annotations

import numpy as np

import gpusim as gs
from gpusim.optics.light.studio import studio


def test_the_mean_over_the_sphere_is_one_and_nothing_is_dark_or_sharp() -> None:
    image = studio()
    rows = len(image)
    edges = np.sin(np.linspace(0.5 * np.pi, -0.5 * np.pi, rows + 1))
    share = (edges[:-1] - edges[1:]) / 2.0  # of the sphere, exactly
    assert abs(float(share @ image.mean(axis=1)) - 1.0) < 1e-3
    assert image.min() > 0.2 and image.max() < 4.0
    # neighbours, round the back too: no step that gloss would show as an edge
    steps = np.abs(np.diff(image, axis=0)).max(), np.abs(image - np.roll(image, 1, axis=1)).max()
    assert max(steps) < 0.45
    north = image[: rows // 2].mean() / image[rows // 2 :].mean()
    assert north > 1.3, "light comes from above"


def test_flat_steel_has_a_gradient_where_two_even_halves_leave_one_tone() -> None:
    """A flat bar whose lower side is seen at a grazing angle, as of a crane's beam."""
    x, y, z = 0.4, 0.02, 0.3
    corners = np.array([[-x, -y, z], [-x, y, z], [x, y, z], [x, -y, z]])
    steel = gs.paint.Plain(0.5653, 0.5, 1.0)
    bar = gs.Surface(corners, [[0, 1, 2, 3]], steel)
    camera = gs.Camera.from_lens((36.0, 24.0), 30.0, (150, 100), (0.0, -1.0, 0.0), (0.0, 0.0, 0.1))

    def tones(light: gs.EnvironmentLight) -> np.ndarray:
        radiance = gs.render([bar], camera, [light], background=-0.0, backend="numpy").radiance
        rows, columns = np.nonzero(radiance)
        return np.array([radiance[rows[columns == c], c].max() for c in np.unique(columns)[2:-2]])

    room = tones(gs.EnvironmentLight(sky=1.45, ground=0.55))
    boxes = tones(gs.EnvironmentLight(image=studio()))
    print(
        f"room {room.min():.3f} to {room.max():.3f}, studio {boxes.min():.3f} to {boxes.max():.3f}"
    )
    assert room.max() / room.min() < 1.3
    assert boxes.max() / boxes.min() > 1.8
    assert boxes.mean() > room.mean()
