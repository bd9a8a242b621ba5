"""The renderer's picture without shadows and soft edges: what is shown while the view moves.

Pixels show the triangle at their centres, with its paint and the light of its lamps as ever. The
host finds edge pixels, and their pieces, for longer than all else takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Band, Frame
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import AmbientLight, EnvironmentLight, Light
from gpusim.optics.rendering.frame_plan import plan_frame
from gpusim.optics.rendering.local_origin import local, seen_from_origin
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import ShadingPass
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.surface.color import Color
from gpusim.surface.surface import Surface


def unshadowed(lights: Sequence[Light]) -> list[Light]:
    """The same lights, which nothing hides.

    Examples
    --------
    >>> from gpusim.view.picture.moving_picture import unshadowed
    >>> [light.shadows for light in unshadowed([gs.SunLight((0, 0, -1), 800.0)])]
    [False]
    """
    return [
        replace(light, occlusion=False)
        if isinstance(light, AmbientLight | EnvironmentLight)
        else replace(light, shadows=False)
        for light in lights
    ]


@one_blas_thread()
def moving_picture(
    device: Device,
    surfaces: Sequence[Surface],
    camera: Camera,
    lights: Sequence[Light] | None,
    background: Color = 0.0,
) -> Frame:
    """As `gpusim.optics.render` shows ``surfaces``, but for shadows and edges.

    ``lights``: such as `unshadowed` gives; the same objects again are the quicker for it.

    Raises
    ------
    DeviceError, InputError
    """
    there, viewer, lamps, origin = local(surfaces, camera, lights)
    view = look(there, viewer, lamps is not None)
    plan = plan_frame(view, lamps)
    setup = Setup.build(view, lamps, background, there, device)
    buffers = SceneBuffers(device, setup, None, fine=plan.deferred)
    shading = ShadingPass(buffers, plan.rows, plan.deferred)
    bands = []
    for row0 in range(0, camera.height, plan.rows):
        rows = min(plan.rows, camera.height - row0)
        bands.append(Band.of(device, row0, rows, shading.stride, len(setup.bands)))
        shading.draw(bands[-1])
    return Frame.of_bands(seen_from_origin(view, origin), device, bands)
