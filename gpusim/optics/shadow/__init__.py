"""Shadows: which share of each lamp receivers of light see, found on the device.

In the order in which data passes: `single_layer` (which lamps hide nothing), `occluders`
(triangles of all surfaces in Morton order), `light_space` (the frame of a lamp), `refit` (the
tree's boxes in it), `receivers` (pixels, or pieces of pixels), `planes` (in which pixels lie),
`groups` (cells, which have all that an entry of receivers looks from, and what these are to a
lamp), `search` (lists of what may hide the lamp from an entry), `refine` (what of these hides
nothing), `mask` (the share, sample by sample), `visible` (all of it in one submission). `scene`
has the light of a view and what hides it, `twin` says what is true without a tree, `probe` has a
small scene for the checks of all stages.
"""
