"""Points, shapes and strains in space, from calibrated cameras.

In the order in which data passes:

- `triangulation`: Points in space from two or more calibrated cameras, and how far they moved.
- `epipolar_matching`: Which point of one image is which of the other, for a calibrated pair of
  cameras.
- `plane_mapping`: Measured displacements in other coordinates: without the lens's distortion, or
  on a plane.
- `stereo_correlation`: Stereo correlation: shape and displacement of a surface from two calibrated
  cameras.
"""
