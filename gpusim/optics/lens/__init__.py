"""Lens and shutter: point spread, depth of field, vignetting, exposure.

In the order in which data passes:

- `psf`: Point spread functions of lenses, and how they are sampled.
- `convolution`: Sums of images: along rows, then along columns of sampled kernels, and weighted
  (lens positions, moments of an exposure), and gains per pixel.
- `thin_lens`: The lens: thin-lens depth of field by lens positions, point spread, vignetting.
- `shutter`: Exposure in time: moments of the exposure, and rows that are exposed one after the
  other.
- `lit_moments`: Moments of an exposure and the lamps that light each of them, where lamps flicker.
- `tiles`: Pictures in tiles: as many cells, finer than pixels, as are rendered at once.
- `exposure`: A photograph: the exact pinhole renderer behind a real lens and shutter.
"""
