"""Images: cameras, lights, visibility, closed-form shading, sensor and ground truth.

In the order in which data passes:

- `camera`: Pinhole, lens distortion, and its inverse.
- `calibration`: Calibration files of other programs.
- `geometry`: Surfaces as one camera sees them.
- `light`: Lamps, surroundings, and materials that reflect them.
- `paint`: Means of patterns over what a pixel sees of them.
- `visibility_buffer`: Which triangle each pixel sees.
- `shadow`: Which share of each lamp receivers of light see, found on the device.
- `ambient`: Which surroundings points of surfaces see.
- `shading`: The light of pixels that lie inside one triangle.
- `edge_pixels`: Exact areas of all triangles that touch them.
- `truth`: Ground truth per pixel, at the pixel's centre and unfiltered, in float64.
- `frame`: A rendered frame: linear radiance (on the device until somebody asks) and its ground
  truth.
- `change_detection`: Whether an image must be the same as one before, as nothing has moved.
- `rendering`: One frame, from view to radiance.
- `lens`: Point spread, depth of field, vignetting, exposure.
- `sensor`: Grey values from radiance.
"""

from gpusim.optics.camera.pinhole import Camera as Camera
from gpusim.optics.frame import Frame as Frame
from gpusim.optics.lens import psf as psf
from gpusim.optics.lens.exposure import photograph as photograph
from gpusim.optics.lens.shutter import Shutter as Shutter
from gpusim.optics.lens.thin_lens import Lens as Lens
from gpusim.optics.lens.thin_lens import Vignetting as Vignetting
from gpusim.optics.light.blackbody import blackbody as blackbody
from gpusim.optics.light.flicker import Flicker as Flicker
from gpusim.optics.light.lights import AmbientLight as AmbientLight
from gpusim.optics.light.lights import AreaLight as AreaLight
from gpusim.optics.light.lights import EnvironmentLight as EnvironmentLight
from gpusim.optics.light.lights import PointLight as PointLight
from gpusim.optics.light.lights import SpotLight as SpotLight
from gpusim.optics.light.lights import SunLight as SunLight
from gpusim.optics.rendering.renderer import render as render
from gpusim.optics.sensor.sensor import Sensor as Sensor
from gpusim.optics.truth import Truth as Truth
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
