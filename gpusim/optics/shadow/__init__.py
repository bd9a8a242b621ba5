"""Shadows: which share of each lamp receivers of light see, found on the device.

In the order in which data passes:

- `sample_mask`: The samples at which a lamp and a receiver are looked at: a mask of 512 bits.
- `light_space`: A lamp's light space, the frame in which what hides it is looked for.
- `occluders`: Occluders: the triangles of all surfaces in Morton order, and what lies across
  their edges.
- `bvh_refit`: A lamp's tree: boxes in its light space around occluders, and which way these face
  it.
- `scene`: What hides the lamps of a view: occluders, where they are now, and the lamps' light
  spaces.
- `single_layer`: What hides nothing of itself: what a lamp lights of it is a single layer, from
  all of the lamp.
- `receivers`: Receivers: what asks how much of each lamp it sees.
- `receiver_groups`: What the receivers of each entry have in common.
- `occluder_search`: The search for what may hide a lamp from each entry of receivers.
- `occluder_refinement`: Drops occluders listed alone that hide nothing from any receiver of the
  entry.
- `penumbra_mask`: The share of a lamp that receivers in penumbra see, on the mask of
  `gpusim.optics.shadow.sample_mask`.
- `lamp_visibility`: What receivers see of lamps: all stages of one lamp after the other, in one
  submission.
- `brute_force`: What is seen of lamps, receiver by receiver and occluder by occluder, without a
  tree.
"""
