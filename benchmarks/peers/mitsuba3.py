"""Mitsuba 3 on the CPU (LLVM), box filter: paths that end at the first surface, or at a lamp."""

import drjit as dr
import mitsuba as mi
import numpy as np
from pictures import main

mi.set_variant("llvm_ad_mono")

PATHS = 24_000_000
"""Traced at once: their state takes some hundred bytes each (21 Mpx at 16 samples: 50 GB)."""


def run(problem, options):
    if options["tag"]:  # the windows alone, for a reference
        samples = options["samples"][0]
        image = np.zeros((problem.height, problem.width))
        for window in problem.windows:
            r0, r1, c0, c1 = (int(v) for v in window)
            crop = (c0, r0, c1 - c0, r1 - r0)
            part = mi.load_dict(_scene(problem, crop, _middle(problem, crop), 1000.0))
            image[r0:r1, c0:c1] = np.array(mi.render(part, spp=samples, seed=1))[:, :, 0]
        yield f"Mitsuba, {samples} samples", lambda: image
        return
    scene = mi.load_dict(_scene(problem))
    for samples in options["samples"]:
        rows = max(1, PATHS // (problem.width * samples))
        bands = [(0, r, problem.width, min(rows, problem.height - r))
                 for r in range(0, problem.height, rows)]  # fmt: skip
        sensors = [mi.load_dict(_sensor(problem, crop)) for crop in bands]

        def render(samples=samples, sensors=sensors):
            parts = []
            for sensor in sensors:
                part = mi.render(scene, sensor=sensor, spp=samples, seed=1)
                dr.eval(part)
                parts.append(np.array(part)[:, :, 0])
            return np.concatenate(parts)

        render()  # compiles
        yield f"Mitsuba, {samples} samples", render


def _middle(problem, crop):
    """The farthest point that the middle of a window may see."""
    x = crop[0] + 0.5 * crop[2] - 0.5 * problem.width
    y = crop[1] + 0.5 * crop[3] - 0.5 * problem.height
    farthest = max(float(corners[..., 2].max()) for _, corners in problem.groups())
    return farthest * np.array([x / problem.focal, y / problem.focal, 1.0])


def _scene(problem, crop=None, origin=(0.0, 0.0, 0.0), scale=1.0):
    """The scene about ``origin``, ``scale`` times as large.

    Shadow rays start 9e-5 (1 + the largest coordinate) off their surface: 0.2 mm on the crane's
    wall in m about the camera, which moves shadows by 0.04 px; 0.005 mm in mm about the window.
    """
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2 if problem.lit else 1},
        "sensor": _sensor(problem, crop, origin, scale),
    }  # fmt: skip
    for number, (value, corners) in enumerate(problem.groups()):
        colour = {"type": "uniform", "value": value}
        if problem.textured:
            data = problem.texture.astype(np.float32)[:, :, None] / 255.0
            colour = {"type": "bitmap", "bitmap": mi.Bitmap(data), "raw": True}
        corners = scale * (corners - origin)
        scene[f"group{number}"] = _mesh(problem, corners, colour, problem.lit)
    for number, (centre, a, b) in enumerate(problem.lamps):
        matrix = np.eye(4)
        axis = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        matrix[:3] = np.stack([scale * a, scale * b, axis, scale * (centre - origin)], axis=1)
        scene[f"lamp{number}"] = {
            "type": "rectangle", "to_world": mi.ScalarTransform4f(matrix),
            "emitter": {"type": "area", "radiance": {
                "type": "uniform", "value": float(problem.radiance[number])}},
        }  # fmt: skip
    return scene


def _sensor(problem, crop=None, origin=(0.0, 0.0, 0.0), scale=1.0):
    eye = -scale * np.array(origin)
    ahead = eye + np.array([0.0, 0.0, 1.0])
    view = mi.ScalarTransform4f().look_at(eye.tolist(), ahead.tolist(), [0, -1, 0])
    film = {"type": "hdrfilm", "width": problem.width, "height": problem.height,
            "pixel_format": "luminance", "component_format": "float32",
            "rfilter": {"type": "box"}}  # fmt: skip
    if crop is not None:
        keys = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        film |= dict(zip(keys, crop, strict=True))
    angle = 2 * np.degrees(np.arctan(0.5 * problem.width / problem.focal))
    return {"type": "perspective", "fov": float(angle), "fov_axis": "x",
            "near_clip": 0.05 * scale, "far_clip": 50.0 * scale, "to_world": view,
            "film": film, "sampler": {"type": "multijitter"}}  # fmt: skip


def _mesh(problem, corners, colour, lit):
    properties = mi.Properties()
    if lit:
        inner = {"type": "diffuse", "reflectance": colour}
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": inner})
    else:
        properties["bsdf"] = mi.load_dict({"type": "diffuse"})
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": colour})
    mesh = mi.Mesh("m", 3 * len(corners), len(corners), has_vertex_normals=False,
                   has_vertex_texcoords=problem.textured, props=properties)  # fmt: skip
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ascontiguousarray(corners.reshape(-1), np.float32)
    parameters["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
    if problem.textured:
        parameters["vertex_texcoords"] = np.ascontiguousarray(problem.uv.reshape(-1), np.float32)
    parameters.update()
    return mesh


if __name__ == "__main__":
    main(run)
