"""Digital image correlation.

In the order in which data passes:

- `warp`: Shape functions: how the pixels of one subset move.
- `image_tiles`: Parts of a pair of images on a device: any image size, within what a device
  takes.
- `matching`: What goes into matching subsets and what comes out, shared by the kernel and its
  twin.
- `subsets`: Choices that every subset-based measurement shares: window, limits, result.
- `pixel_mask`: Pixels that carry no measurement: masked, not a number, or saturated over an area.
- `features`: Large motion from features: what moved together, how far it turned and stretched.
- `pixel_search`: Where a subset went, to the nearest pixel: normalised cross-correlation over a
  search square.
- `normal_equations`: Many small normal equations at once: Cholesky factors and solutions,
  vectorised over subsets.
- `icgn`: Match subsets of one image in another: inverse-compositional Gauss-Newton, ZNSSD.
- `discontinuity`: Whether a subset is torn: a line across it on whose two sides it moved
  differently.
- `subset_consistency`: Whether all of a subset moved as its warp says, from what the match leaves
  in its parts.
- `propagation`: Points in progress: from those that are measured to their neighbours.
- `blur_uncertainty`: How uncertain matches of blurred images are: noise that a blur has made
  small and correlated.
- `dic`: Digital image correlation of two images on a grid of points or at given ones.
- `sequence`: Correlation of a series of images with one reference, or with references that follow
  it.
- `strain`: Strain of measured displacements: a polynomial fitted over a window around each point.
"""
