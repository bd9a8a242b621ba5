"""Shadows: which share of each lamp receivers of light see, found on the device.

In the order in which data passes: `occluders` (triangles of all surfaces in Morton order),
`light_space` (the frame of a lamp), `refit` (the tree's boxes in it), `receivers` (pixels, or
pieces of pixels), `groups` (what an entry of receivers has in common), `search` (lists of what may
hide the lamp from an entry), `refine` (what of these hides nothing), `mask` (the share, sample by
sample), `visible` (all of it in one submission). `twin` says what is true without a tree, `probe`
has a small scene for the checks of all stages.
"""
