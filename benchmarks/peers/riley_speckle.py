"""riley-raster on the speckle plate: a bitmap of one texel a pixel, seen straight on.

``python riley_speckle.py FOLDER`` reads ``texture.npy`` (uint8) and ``meta.json`` (width, height,
moves as pairs of shift in px and strain, runs as pairs of filter and samples a side, repeats). It
writes ``image_RUN_MOVE.npy`` (uint8) where ``keep`` is set and prints the seconds of each run.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import riley


def render(texture, meta, sample, side):
    """(frames, H, W) and the seconds that ``riley.raster`` took."""
    height, width = texture.shape
    x, y = 0.5 * width, 0.5 * height
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    moved = np.zeros((3, 4, len(meta["moves"])))
    for k, (shift, strain) in enumerate(meta["moves"]):
        moved[0, :, k] = shift + strain * corners[:, 0]
    convention = riley.ConnectConvention(
        riley.EElemType.QUAD4, riley.EConnectAxis.ROW, 0, riley.ENodeOrder.RILEY
    )
    shader = riley.TextureShader(
        uvs=uvs, texture=texture[None], sample=getattr(riley.TextureSample, sample)
    )
    mesh = riley.create_mesh(
        convention, riley.MeshType.quad4, corners, np.array([[0, 1, 2, 3]]), shader,
        disp=tuple(np.ascontiguousarray(part) for part in moved),
    )  # fmt: skip
    distance = 4.0 * meta["width"]
    camera = riley.Camera(
        pixels_num=(meta["width"], meta["height"]), pixels_size=(1.0, 1.0),
        pos_world=(0.0, 0.0, distance), rot_world=(0.0, 0.0, 0.0), roi_cent_world=(0.0, 0.0, 0.0),
        focal_length=distance, sub_sample=side,
    )  # fmt: skip
    config = riley.RasterConfig(
        parallel=meta["threads"], save_strategy=riley.SaveStrategy.memory,
        image_save_mode=riley.ImageSaveMode.grey,
    )  # fmt: skip
    config.report = 0
    start = time.perf_counter()
    frames = riley.raster([mesh], [camera], config)
    return frames.reshape(-1, meta["height"], meta["width"]), time.perf_counter() - start


def main():
    folder = Path(sys.argv[1])
    meta = json.loads((folder / "meta.json").read_text())
    texture = np.load(folder / "texture.npy")
    seconds = []
    for number, (sample, side) in enumerate(meta["runs"]):
        taken = []
        for _ in range(meta["repeats"]):
            frames, run = render(texture, meta, sample, side)
            taken.append(run / len(frames))
        seconds.append(min(taken))
        if meta["keep"]:
            for k, frame in enumerate(frames):
                image = np.clip(np.rint(frame), 0, 255).astype(np.uint8)
                np.save(folder / f"image_{number}_{k}.npy", image)
    print(json.dumps(seconds))


if __name__ == "__main__":
    main()
