"""VTK through OpenGL, multisampled, unlit: it has no lamps with a size or a unit."""

import numpy as np
import vtk
from pictures import main
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy


def run(problem, options):
    for samples in options["samples"]:
        window = _window(problem, samples)

        def render(window=window):
            window.Render()
            grab = vtk.vtkWindowToImageFilter()
            grab.SetInput(window)
            grab.SetInputBufferTypeToRGB()
            grab.ReadFrontBufferOff()
            grab.Update()
            data = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
            return data.reshape(problem.height, problem.width, 3)[::-1, :, 0] / 255.0

        render()  # uploads
        yield f"VTK, {samples} samples", render


def _window(problem, samples):
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(problem.corners.reshape(-1, 3), deep=True))
    count = len(problem.corners)
    cells = np.concatenate(
        [np.full((count, 1), 3), np.arange(3 * count).reshape(-1, 3)], axis=1
    ).astype(np.int64)
    array = vtk.vtkCellArray()
    array.SetCells(count, numpy_to_vtkIdTypeArray(cells.ravel(), deep=True))
    data = vtk.vtkPolyData()
    data.SetPoints(points)
    data.SetPolys(array)
    actor = vtk.vtkActor()
    if problem.textured:
        data.GetPointData().SetTCoords(numpy_to_vtk(problem.uv.reshape(-1, 2), deep=True))
        image = vtk.vtkImageData()
        rows, columns = problem.texture.shape
        image.SetDimensions(columns, rows, 1)
        grey = np.repeat(problem.texture.reshape(-1, 1), 3, axis=1)
        image.GetPointData().SetScalars(numpy_to_vtk(grey, deep=True))
        texture = vtk.vtkTexture()
        texture.SetInputData(image)
        texture.InterpolateOn()
        texture.MipmapOn()
        actor.SetTexture(texture)
    else:
        grey = np.rint(255.0 * np.repeat(problem.albedo[:, None], 3, axis=1)).astype(np.uint8)
        data.GetCellData().SetScalars(numpy_to_vtk(grey, deep=True))
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    renderer = vtk.vtkRenderer()
    renderer.AddActor(actor)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(0, 0, 0)
    camera.SetFocalPoint(0, 0, 1)
    camera.SetViewUp(0, -1, 0)
    camera.SetViewAngle(2 * np.degrees(np.arctan(0.5 * problem.height / problem.focal)))
    depth = problem.corners[..., 2]
    camera.SetClippingRange(0.9 * max(depth.min(), 1e-3), 1.1 * depth.max())
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(samples)
    window.SetSize(problem.width, problem.height)
    window.AddRenderer(renderer)
    return window


if __name__ == "__main__":
    main(run)
