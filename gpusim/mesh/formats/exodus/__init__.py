"""Exodus II.

In the order in which data passes:

- `variables`: The variables of Exodus files, out of netCDF classic or netCDF-4 (HDF5).
- `reader`: Exodus II files: meshes, and the nodal results that a solver wrote over time.
"""
