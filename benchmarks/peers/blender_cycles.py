"""Blender's Cycles on the CPU, box filter, no denoiser, no bounces."""

import bpy
import numpy as np
from mathutils import Matrix
from pictures import main


def run(problem, options):
    _build(problem)
    scene = bpy.context.scene
    path = str(problem.folder / "cycles.exr")
    scene.render.filepath = path
    for samples in options["samples"]:

        def render(samples=samples):
            scene.cycles.samples = samples
            bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(path)
            pixels = np.empty(4 * problem.width * problem.height, np.float32)
            image.pixels.foreach_get(pixels)
            bpy.data.images.remove(image)
            return pixels.reshape(problem.height, problem.width, 4)[::-1, :, 0]

        yield f"Cycles, {samples} samples", render


def _build(problem):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.max_bounces = cycles.diffuse_bounces = 0
    render = scene.render
    render.resolution_x, render.resolution_y = problem.width, problem.height
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    for number, (value, corners) in enumerate(problem.groups()):
        points = (corners.reshape(-1, 3) * [1.0, -1.0, -1.0]).tolist()
        faces = np.arange(len(points)).reshape(-1, 3).tolist()
        mesh = bpy.data.meshes.new(f"group{number}")
        mesh.from_pydata(points, [], faces)
        if problem.textured:
            layer = mesh.uv_layers.new()
            layer.data.foreach_set("uv", problem.uv.astype(np.float32).ravel())
        mesh.materials.append(_material(problem, value))
        scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))
    for number, (centre, a, b) in enumerate(problem.lamps * [1.0, -1.0, -1.0]):
        area = 4.0 * np.linalg.norm(np.cross(a, b))
        light = bpy.data.lights.new(f"lamp{number}", "AREA")
        light.shape = "RECTANGLE"
        light.size, light.size_y = 2 * float(np.linalg.norm(a)), 2 * float(np.linalg.norm(b))
        light.energy = float(np.pi * area * problem.radiance[number])
        lamp = bpy.data.objects.new(light.name, light)
        y = b / np.linalg.norm(b)
        # a lamp shines along its own -z; a x b is where ours shines, y turned over
        z = -np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        matrix = np.eye(4)
        matrix[:3] = np.stack([np.cross(y, z), y, z, centre], axis=1)
        lamp.matrix_world = Matrix(matrix.tolist())
        scene.collection.objects.link(lamp)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", 36.0
    camera.lens = 36.0 * problem.focal / problem.width
    camera.clip_start, camera.clip_end = 0.05, 50.0
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)


def _material(problem, value):
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    out = nodes.new("ShaderNodeOutputMaterial")
    kind = "ShaderNodeBsdfDiffuse" if problem.lit else "ShaderNodeEmission"
    shader = nodes.new(kind)
    if problem.textured:
        rows, columns = problem.texture.shape
        image = bpy.data.images.new("texture", columns, rows, float_buffer=True, is_data=True)
        grey = np.repeat(problem.texture.reshape(-1, 1) / np.float32(255.0), 4, axis=1)
        image.pixels.foreach_set(np.ascontiguousarray(grey, np.float32).ravel())
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = image
        links.new(texture.outputs["Color"], shader.inputs["Color"])
    else:
        shader.inputs["Color"].default_value = (value, value, value, 1.0)
    links.new(shader.outputs[0], out.inputs["Surface"])
    return material


if __name__ == "__main__":
    main(run)
