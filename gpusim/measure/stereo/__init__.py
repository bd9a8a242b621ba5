"""Points, shapes and strains in space, from calibrated cameras.

In the order in which data passes:

- `triangulation`: Points in space from two or more calibrated cameras, and how far they moved.
- `epipolar_matching`: Which marker of one image is which of the other: epipolar distance, depth,
  one to one.
- `view_matching`: Which point of the right image is which of the left one, for a calibrated pair
  of cameras.
- `plane_mapping`: Measured displacements in other coordinates: without the lens's distortion, or
  on a plane.
- `stereo_correlation`: Stereo correlation: shape, displacement and strain of a surface from two
  calibrated cameras.
- `surface_strain`: Strain of a curved surface from the positions of its points before and after.
"""
