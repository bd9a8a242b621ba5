"""Vibration in pictures: motions of points over time, modes from them, motions made visible.

In the order in which data passes:

- `sampling`: Pictures of one size, and the rate that their times keep.
- `shifted_subsets`: Subsets of a reference found in pictures, by a few sums over their pixels.
- `displacement_methods`: What of a subset is compared to find its motion: slopes, or phases.
- `point_series`: Displacements of points over time, from a sequence of pictures.
- `spectra`: Spectra of responses over time: of each, and of each with each.
- `operational_modes`: Modes that were identified: frequency, damping, shape, and how sure they are.
- `frequency_domain_decomposition`: Modes from singular values of cross spectra.
- `subspace_identification`: Modes from covariances over time.
- `identification`: Frequencies, damping and shapes of modes, from displacements of points.
- `steerable_pyramid`: Complex steerable pyramid in the frequency domain.
- `magnification`: Motion magnification by phase.
"""
