"""Light: lamps, surroundings, and materials that reflect them.

In the order in which data passes:

- `panorama`: Pictures of surroundings: radiances in files, equirectangular.
- `blackbody`: The colour of what glows: Planck's spectrum as the CIE 1931 standard observer sees
  it.
- `light_color`: Colours of lights, which act upon how strong a light is in each band.
- `flicker`: Light that varies in time: lamps on the mains, and lamps that are switched on and off
  quickly.
- `lights`: Lights, in radiometric units; `gpusim.optics.light.quadrature` turns them into what is
  summed up.
- `quadrature`: Lamps reduced to tables of point emitters, and the faces that shadows are taken
  of.
- `studio`: A photographer's studio as surroundings.
- `environment`: Surroundings far away: what they light diffusely, and what glossy paints mirror
  of them.
- `microfacet_material`: Glossy paints of a view: their microfacets, and tables of what they
  reflect of surroundings.
"""
