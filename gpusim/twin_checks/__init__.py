"""Each shader against its NumPy twin on the same small input: what ``gpusim doctor`` runs.

Nothing but `gpusim.gpu.twin_checks` imports these modules, so they may see all of the package.
"""
