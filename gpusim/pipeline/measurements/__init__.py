"""Measurements in a run's images, with the truth beside them.

A kind of measurement is a module or a folder named by its ``type`` that registers it. In the order
in which data passes:

- `marker_set`: Markers of a scene: which a measurement asks for, how they move, how wide a camera
  sees them.
- `marker_tracking`: Markers found in a first image of a camera and followed into another one.
- `material_points`: Material points that a camera sees at given places of its picture, and how
  they really move.
- `region_of_interest`: The pixels of a camera's reference picture in which something is measured.
- `sources`: What measurements are given: pictures, and the board's corners found in them.
- `results`: Results of measurements: a table over frames and points, kept in the output folder and
  told in the report.
- `kinds`: What a kind of measurement has to provide, and the kinds that there are.
- `marker_checks`: Whether a scene's markers can be measured: in sight and in focus of their
  cameras, and not moved along the axis of a single one.
- `marker_measurement`: Markers over frames and cameras: what every kind that follows them shares.
- `deflection`: The kind "deflection": displacements in the image of one camera.
- `stereo`: The kind "stereo": points in space from several cameras.
- `dic`: The kind "dic": displacements and strains of surfaces by digital image correlation.
- `series`: The kinds "extensometer", "gauge", "line" and "point": a few places over frames.
- `modes`: The kind "modes": frequencies, damping and shapes, from the pictures of a vibration.
- `damage`: The kind "damage": deflection lines of the variants compared, and where their slope
  changes.
"""
