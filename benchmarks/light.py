"""Lit and shadowed scenes against Mitsuba 3: ``python -m benchmarks.light --mitsuba PYTHON``.

A box on a plate under an area lamp, matte and as a GGX conductor. Mitsuba runs in its own Python
(``pip install mitsuba``) and renders 16 samples a pixel, and many for reference, with a box filter.
Prints the RMS difference to the reference, in parts of its largest value, and the times.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import gpusim as gs
from gpusim.gpu import Device

EYE, TARGET = (0.3, -1.2, 0.8), (0.0, 0.0, 0.05)
LAMP, AIM, SIZE, POWER = (-0.7, -0.3, 0.9), (0.0, 0.0, 0.0), (0.2, 0.12), 10.0
WIDTH, HEIGHT = 240, 160

PEER = """
import json, sys, time
import numpy as np
import mitsuba as mi
mi.set_variant("scalar_rgb")
job = json.load(open(sys.argv[1]))
T = mi.ScalarTransform4f
def material(m):
    if m["metallic"]:
        return {"type": "principled", "metallic": 1.0, "roughness": m["roughness"],
                "base_color": {"type": "rgb", "value": m["albedo"]}}
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": m["albedo"]}}
w, h = job["lamp_size"]
radiance = job["power"] / (np.pi * w * h)
scene = {
    "type": "scene",
    "integrator": {"type": "direct", "hide_emitters": True},
    "sensor": {"type": "perspective", "fov": job["fov"], "fov_axis": "x",
        "to_world": T().look_at(origin=job["eye"], target=job["target"], up=[0, 0, 1]),
        "film": {"type": "hdrfilm", "width": job["width"], "height": job["height"],
                 "rfilter": {"type": "box"}, "pixel_format": "luminance"},
        "sampler": {"type": "independent", "sample_count": 16}},
    "lamp": {"type": "rectangle",
        "to_world": T().look_at(origin=job["lamp"], target=job["aim"], up=[0, 0, 1])
            @ T().scale([w / 2, h / 2, 1]),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}},
    "plate": {"type": "rectangle", "bsdf": {"type": "twosided", "b": material(job["plate"])}},
    "box": {"type": "cube",
        "to_world": T().translate(job["box_at"]) @ T().scale(job["box_half"]),
        "bsdf": material(job["box"])},
}
s = mi.load_dict(scene)
out = {}
for name, count, repeats in (("few", 16, 1), ("many", job["samples"], job["repeats"])):
    total, start = 0.0, time.perf_counter()
    for seed in range(repeats):
        total = total + np.array(mi.render(s, spp=count, seed=seed))[..., 0].astype(float)
    out[name] = total / repeats
    out[name + "_seconds"] = time.perf_counter() - start
np.savez(sys.argv[2], **out)
"""


def scene(metallic: float) -> tuple[list[gs.Surface], gs.Camera, gs.AreaLight]:
    """Plate, box, camera and lamp."""
    finish = (0.4, 1.0) if metallic else (1.0, 0.0)
    corner = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    plate = gs.Surface(corner, np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.5, *finish))
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    points = np.array([0.05, 0.02, 0.1]) + signs * [0.12, 0.08, 0.1]
    box = gs.Surface(points, np.array(faces), paint=gs.paint.Plain(0.6, *finish))
    camera = gs.Camera.from_lens((36.0, 24.0), 30.0, (WIDTH, HEIGHT), EYE, TARGET)
    return [plate, box], camera, gs.AreaLight(LAMP, AIM, SIZE, POWER)


def peer(python: str, metallic: float, samples: int, repeats: int) -> dict[str, np.ndarray]:
    """Mitsuba's pictures and seconds."""
    material = {"metallic": metallic, "roughness": 0.4}
    job = {
        "width": WIDTH, "height": HEIGHT, "fov": float(np.degrees(2 * np.arctan(18.0 / 30.0))),
        "eye": EYE, "target": TARGET, "lamp": LAMP, "aim": AIM, "lamp_size": SIZE, "power": POWER,
        "plate": {"albedo": 0.5, **material}, "box": {"albedo": 0.6, **material},
        "box_at": [0.05, 0.02, 0.1], "box_half": [0.12, 0.08, 0.1], "samples": samples,
        "repeats": repeats,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        task, result = Path(folder) / "job.json", Path(folder) / "out.npz"
        script = Path(folder) / "peer.py"
        script.write_text(PEER)
        task.write_text(json.dumps(job))
        subprocess.run([python, str(script), str(task), str(result)], check=True)
        with np.load(result) as data:
            return dict(data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mitsuba", required=True, help="a Python that has mitsuba")
    parser.add_argument("--samples", type=int, default=512, help="of the reference, a pass")
    parser.add_argument("--repeats", type=int, default=4, help="passes of the reference")
    arguments = parser.parse_args()
    device = Device()
    print("| scene | renderer | RMS | worst | s |")
    print("|---|---|---|---|---|")
    for name, metallic in (("matte", 0.0), ("metal", 1.0)):
        surfaces, camera, lamp = scene(metallic)
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            image = gs.render(surfaces, camera, [lamp], device=device).radiance.astype(float)
            seconds.append(time.perf_counter() - start)
        theirs = peer(arguments.mitsuba, metallic, arguments.samples, arguments.repeats)
        want = theirs["many"]
        top = float(want.max())
        for who, got, spent in (
            ("gpusim", image, min(seconds)),
            ("Mitsuba 16", theirs["few"], float(theirs["few_seconds"])),
        ):
            error = (got - want) / top
            rms, worst = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
            print(f"| {name} | {who} | {rms:.1e} | {worst:.1e} | {spent:.3f} |", flush=True)


if __name__ == "__main__":
    main()
