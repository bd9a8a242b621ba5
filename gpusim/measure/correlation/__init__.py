"""Digital image correlation.

In the order in which data passes:

- `warp`: Shape functions: how the pixels of one subset move.
- `matching`: What goes into matching subsets and what comes out, whichever way they are matched.
- `image_pair`: A pair of images to be matched, on the host and in parts on a device.
- `pixel_mask`: Pixels that carry no measurement: masked, not a number, or saturated over an area.
- `plain_subsets`: Subsets that show nothing but noise: no start is worth a try there.
- `start_values`: Where correlation starts: from subsets found to the nearest pixel, or large motion
  of features.
- `icgn`: Match subsets of one image in another: inverse-compositional Gauss-Newton, ZNSSD.
- `subset_filter`: What subsets make of a displacement field: a low-pass filter.
- `discontinuity`: Whether a subset is torn: a line across it on whose two sides it moved
  differently.
- `subset_consistency`: Whether all of a subset moved as its warp says, from what the match leaves
  in its parts.
- `propagation`: Points in progress: from those that are measured to their neighbours.
- `coherence`: Measured points that are given up: their subsets see two motions, or have texture to
  one side.
- `dic`: Digital image correlation of two images on a grid of points or at given ones.
- `sequence`: Correlation of a series of images with one reference, or with references that follow
  it.
- `gauge_filter`: Subset and strain window as one linear filter: what it does to noise and to waves.
- `strain`: Strain of measured displacements: a polynomial fitted over a window around each point.
- `virtual_gauges`: What an extensometer and a strain gauge would read, from displacements of a few
  subsets.
"""
