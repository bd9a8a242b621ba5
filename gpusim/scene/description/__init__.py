"""What a scene holds once it is read: frozen, in SI.

In the order in which data passes:

- `loads`: What loads and holds a body, and of what material it is: SI, as in ``model``.
- `finish`: How a painted surface shines, and its fine relief; in SI.
- `patterns`: Bitmaps and targets of a scene, and how patterns lie on curved faces; in SI.
- `lights`: Lights as `gpusim.scene.description.model` has them: SI, angles in rad.
- `photo`: Lens, shutter and sensor of a scene, in m, s, px and electrons; what they are in words.
- `mesh_recipe`: How a body's mesh is made: frozen, lengths in m.
- `measures`: What is measured in a scene's images, and the states that are compared: SI, as in
  ``model``.
- `model`: What a scene holds once it is read: frozen, in SI (m, N, Pa, kg, W), names resolved.
"""
