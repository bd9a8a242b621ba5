"""Mitsuba 3 on the CPU (LLVM), box filter: paths that end at the first surface, or at a lamp."""

import drjit as dr
import mitsuba as mi
import numpy as np
from pictures import main

mi.set_variant("llvm_ad_mono")


def run(problem, options):
    if options["tag"]:  # the windows alone, for a reference
        samples = options["samples"][0]
        image = np.zeros((problem.height, problem.width))
        for window in problem.windows:
            r0, r1, c0, c1 = (int(v) for v in window)
            part = mi.load_dict(_scene(problem, (c0, r0, c1 - c0, r1 - r0)))
            image[r0:r1, c0:c1] = np.array(mi.render(part, spp=samples, seed=1))[:, :, 0]
        yield f"Mitsuba, {samples} samples", lambda: image
        return
    scene = mi.load_dict(_scene(problem))
    for samples in options["samples"]:

        def render(samples=samples):
            image = mi.render(scene, spp=samples, seed=1)
            dr.eval(image)
            return np.array(image)[:, :, 0]

        render()  # compiles
        yield f"Mitsuba, {samples} samples", render


def _scene(problem, crop=None):
    view = mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0])
    film = {"type": "hdrfilm", "width": problem.width, "height": problem.height,
            "pixel_format": "luminance", "component_format": "float32",
            "rfilter": {"type": "box"}}  # fmt: skip
    if crop is not None:
        keys = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        film |= dict(zip(keys, crop, strict=True))
    angle = 2 * np.degrees(np.arctan(0.5 * problem.width / problem.focal))
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2 if problem.lit else 1},
        "sensor": {"type": "perspective", "fov": float(angle), "fov_axis": "x", "near_clip": 0.05,
                   "far_clip": 50.0, "to_world": view, "film": film,
                   "sampler": {"type": "multijitter"}},
    }  # fmt: skip
    for number, (value, corners) in enumerate(problem.groups()):
        colour = {"type": "uniform", "value": value}
        if problem.textured:
            data = problem.texture.astype(np.float32)[:, :, None] / 255.0
            colour = {"type": "bitmap", "bitmap": mi.Bitmap(data), "raw": True}
        scene[f"group{number}"] = _mesh(problem, corners, colour, problem.lit)
    for number, (centre, a, b) in enumerate(problem.lamps):
        matrix = np.eye(4)
        matrix[:3] = np.stack([a, b, np.cross(a, b) / np.linalg.norm(np.cross(a, b)), centre], 1)
        scene[f"lamp{number}"] = {
            "type": "rectangle", "to_world": mi.ScalarTransform4f(matrix),
            "emitter": {"type": "area", "radiance": {
                "type": "uniform", "value": float(problem.radiance[number])}},
        }  # fmt: skip
    return scene


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
