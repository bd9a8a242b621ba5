"""Lens and shutter: point spread, depth of field, vignetting, exposure.

In the order in which data passes:

- `psf`: Point spread functions of lenses, and how they are sampled.
- `convolution`: Sampled kernels applied to images: sums along rows, then along columns, term by
  term.
- `vignetting`: Fall-off of the irradiance from the image's centre to its corners.
- `thin_lens`: The lens: thin-lens depth of field by lens positions, point spread, vignetting.
- `shutter`: Exposure in time: moments of the exposure, and rows that are exposed one after the
  other.
- `rolling_shutter`: A rolling shutter: every vertex where it is when its own row is read, one
  rendering for all.
- `accumulation`: Weighted sums of images (lens positions, moments of an exposure), and gains per
  pixel.
- `exposure`: A photograph: the exact pinhole renderer behind a real lens and shutter.
"""
