"""riley-raster: supersampled, unlit."""

import numpy as np
import riley
from pictures import main


def run(problem, options):
    mesh = _mesh(problem)
    for samples in options["samples"]:
        side = round(samples**0.5)
        camera = riley.Camera(
            pixels_num=(problem.width, problem.height),
            pixels_size=(1e-5, 1e-5),
            pos_world=(0.0, 0.0, 0.0),
            rot_world=(0.0, 0.0, 0.0),
            roi_cent_world=(0.0, 0.0, -1.0),
            focal_length=problem.focal * 1e-5,
            sub_sample=side,
            coord_sys=riley.CameraCoordSys.opengl,
        )
        config = riley.RasterConfig(
            parallel=2, save_strategy=riley.SaveStrategy.memory, report=riley.ReportMode.off
        )

        def render(camera=camera, config=config):
            image = np.asarray(riley.raster(mesh, camera, config))
            return image.reshape(-1, problem.height, problem.width)[0] / 255.0

        yield f"riley, {side * side} samples", render


def _mesh(problem):
    coords = problem.corners.reshape(-1, 3) * [1.0, -1.0, -1.0]
    connect = np.arange(len(coords)).reshape(-1, 3)
    if problem.textured:
        shader = riley.TextureShader(
            uvs=np.ascontiguousarray(problem.uv.reshape(-1, 2)),
            texture=problem.texture[None].copy(),
        )
    else:
        field = np.repeat(255.0 * problem.albedo, 3)[:, None]
        shader = riley.NodalShader(field=field, scaling_type=riley.ScaleStrategy.none)
    convention = riley.ConnectConvention(
        riley.EElemType.TRI3, riley.EConnectAxis.ROW, 0, riley.ENodeOrder.RILEY
    )
    return riley.create_mesh(
        convention=convention, mesh_type=riley.MeshType.tri3, coords=coords, connect=connect,
        shader=shader,
    )  # fmt: skip


if __name__ == "__main__":
    main(run)
