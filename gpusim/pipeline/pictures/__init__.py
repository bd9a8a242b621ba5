"""Pictures of a run: what they are called, what is in them, and how they are exposed.

In the order in which data passes:

- `file_names`: What the pictures of a run are called in its output folder.
- `stored_picture`: Pictures that a run has taken, from its results.
- `image_window`: The part of an image that anything is seen in: a small target needs no whole
  frame.
- `visibility`: What cameras see and what hides it, cameras and lamps inside of bodies: before any
  picture.
- `framing`: Whether what is to be measured lies within the pictures: boards, and regions of
  surfaces.
- `exposure`: Whether a picture is well exposed, and the exposure that was chosen for a camera.
"""
