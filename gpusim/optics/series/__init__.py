"""Series: a fine surface's vertices projected on the device, image after image.

In the order in which data passes:

- `normals`: Normals of a surface's vertices, found on the device where its vertices have moved.
- `steady`: What stays the same of a surface wherever its vertices go: for views that the device
  projects.
- `project`: Where a surface's vertices lie on the image, found on the device from their places in
  the world.
- `resident`: What a device keeps of a surface from one image to the next: its triangles, places,
  normals.
- `late_vertices`: Vertices of a view that the device projects: the host finds what it is asked
  for, and no more.
- `late`: Images of one fine surface in a series: the device looks at all of its vertices, the
  host at few.
- `speckled_layer`: Speckle on a fine surface in a series, whose vertices the device looks at
  (`gpusim.optics.series.late`).
"""
