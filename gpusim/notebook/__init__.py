"""What notebooks show of objects, and what their ``plot`` draws.

`gpusim.display` imports a module here when an object is shown; nothing else does. Each of them has
``html`` for notebooks and ``plot`` for matplotlib:

- `page`: The HTML that a notebook shows: a heading, pictures, short tables, notes.
- `shading`: Small shaded pictures of surfaces, and cameras that fit.
- `axes`: matplotlib's axes, of two and three dimensions, and shaded faces in these.
- `mesh`: A mesh: its counts, sets and quality, and its skin.
- `surface`: A painted surface.
- `solution`: A solution: how far it can be trusted, and the deformed body.
- `frame`: A frame: the picture itself.
- `camera`: A camera: its numbers, a sketch of its image, and where it stands.
- `scene`: A scene: what is in it, how it looks, and where its cameras and lamps are.
- `correlation`: Maps of displacement and strain.
- `deflection`: A deflection line: measured, with its uncertainties, and true.
- `report`: What a run found.
- `view`: ``scene.view()``: the preview window in a notebook, or a still picture.
"""
