"""Shadows: which share of each lamp receivers of light see, found on the device.

In the order in which data passes:

- `sample_mask`: The samples in which receivers look at a lamp, the bits of a mask.
- `light_space`: A lamp's light space, the frame in which what hides it is looked for.
- `occluders`: Occluders: the triangles of all surfaces in Morton order, and a tree over them for
  each lamp.
- `scene`: What hides the lamps of a view: occluders, where they are now, and the lamps' light
  spaces.
- `single_layer`: What hides nothing of itself: what a lamp lights of it is a single layer, from
  all of the lamp.
- `receivers`: Receivers: what asks how much of each lamp it sees.
- `receiver_groups`: What the receivers of each entry have in common.
- `lamp_visibility`: What receivers see of lamps: all stages of one lamp after the other, in one
  submission.
- `brute_force`: What is seen of lamps, receiver by receiver and occluder by occluder, without a
  tree: what ``backend="numpy"`` lights pictures by.
"""
