"""Surfaces: validation, paint coordinates, regions, and the skin of a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.mesh import Mesh, boundary_faces
from gpusim.surface.surface import face_normals, triangulate

POINTS = np.array([[0.0, 0, 0], [0.9, 0, 0], [0.9, 0, 0.6], [0.0, 0, 0.6]])  # normal -y
QUAD = np.array([[0, 1, 2, 3]])
NAN_POINTS = POINTS.copy()
NAN_POINTS[2, 1] = np.nan


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ({"points": POINTS[:, :2]}, ("points", "(4, 2)", "(P, 3)")),
        ({"points": NAN_POINTS}, ("points row 2", "nan", "finite")),
        ({"reference": POINTS[:3]}, ("reference", "(3, 3)", "(4, 3)")),
        ({"reference": NAN_POINTS}, ("reference row 2", "nan", "finite")),
        ({"faces": QUAD[0]}, ("faces", "(4,)", "(F, 3) or (F, 4)")),
        ({"faces": np.zeros((0, 4), int)}, ("faces", "(0, 4)", "(F, 3) or (F, 4)")),
        ({"faces": QUAD.astype(float)}, ("faces", "float64", "integers")),
        ({"faces": QUAD + 1}, ("face 0", "[1, 2, 3, 4]", "0 to 3")),
        ({"faces": np.array([[0, 1, -1, 3]])}, ("face 0", "[0, 1, -1, 3]", "0 to 3")),
        ({"faces": np.array([[0, 1, 2, -2]])}, ("face 0", "-2", "0 to 3")),
        ({"faces": [[0, 1, 2**32 + 2]]}, ("face 0", "4294967298", "0 to 3")),
        ({"faces": np.array([[0, 1, 1, -1]])}, ("face 0", "[0, 1, 1", "area")),
        ({"paint": {"a": gs.paint.Plain(), "b": gs.paint.Plain()}}, ("region", "None", "2 paints")),
        ({"region": np.array([1])}, ("region", "to 1", "0 to 0")),
        ({"region": np.array([2**32])}, ("region", "to 4294967296", "0 to 0")),
        ({"region": np.array([0.0])}, ("region", "float64", "integers")),
        ({"region": np.array([0, 0])}, ("region", "(2,)", "(1,)")),
        ({"paint": {}}, ("paint", "{}", "at least one")),
        ({"paint": gs.paint.Plain}, ("paint", "Plain", "Paint")),
        ({"paint": 0.5}, ("paint", "0.5", "Paint")),
        ({"smooth_angle": np.nan}, ("smooth_angle", "nan", "0 to pi")),
        (
            {"frames": {"other": gs.PaintFrame(np.zeros(3), *np.eye(3)[:2])}},
            ("frames", "other", "surface"),
        ),
    ],
)
def test_faults_say_where_got_and_expected(arguments: dict[str, Any], parts: tuple) -> None:
    values = {"points": POINTS, "faces": QUAD, "name": "plate", **arguments}
    with pytest.raises(InputError) as caught:
        gs.Surface(**values)
    for part in ("plate", *parts):
        assert part in str(caught.value)


def test_triangles_among_quadrilaterals() -> None:
    faces = np.array([[0, 1, 2, 3], [4, 5, 6, -1], [3, 2, 1, 0]])
    triangles, source = triangulate(faces)
    np.testing.assert_array_equal(source, [0, 0, 1, 2, 2])
    np.testing.assert_array_equal(triangles[2], [4, 5, 6])
    points = np.random.default_rng(1).normal(size=(7, 3))
    normals = face_normals(points, faces)
    half = 0.5 * np.cross(points[5] - points[4], points[6] - points[4])
    np.testing.assert_allclose(normals[1], half, atol=1e-15)
    np.testing.assert_allclose(normals[2], -normals[0], atol=1e-15)


def test_a_paint_frame_is_upright_seen_from_outside() -> None:
    """Somebody before the face sees s to the right and t up; the origin is its lower left."""
    for normal, right, up in (
        ((0.0, -1, 0), (1.0, 0, 0), (0.0, 0, 1)),
        ((0.0, 1, 0), (-1.0, 0, 0), (0.0, 0, 1)),
        ((1.0, 0, 0), (0.0, 1, 0), (0.0, 0, 1)),
        ((0.0, 0, 1), (1.0, 0, 0), (0.0, 1, 0)),
        ((0.0, 0, -1), (-1.0, 0, 0), (0.0, 1, 0)),
    ):
        points = np.random.default_rng(2).uniform(-1, 1, (9, 3)) * (1.0 - np.abs(normal))
        frame = gs.PaintFrame.facing(np.array(normal), points + 3.0 * np.array(normal))
        np.testing.assert_allclose(frame.s_axis, right, atol=1e-15)
        np.testing.assert_allclose(frame.t_axis, up, atol=1e-15)
        st = frame.coordinates(points)
        np.testing.assert_allclose(st.min(axis=0), 0.0, atol=1e-14)
    with pytest.raises(InputError, match="along the plane's normal"):
        gs.PaintFrame.facing(np.array([0.0, 0, 1]), POINTS, (0, 0, 2))


def looking(width: int = 91, height: int = 61, y: float = -1.0) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width), 36.0, (width, height), (0.45, y, 0.3), (0.45, 0, 0.3)
    )


def test_markers_stand_upright_and_a_pattern_is_not_mirrored(device: Device) -> None:
    """Dark squares lower left and upper right; an asymmetric set of markers reads like an F."""
    centres = np.array([[0.2, 0.1], [0.2, 0.3], [0.2, 0.5], [0.4, 0.3], [0.4, 0.5], [0.6, 0.5]])
    paint = gs.paint.Markers(centres, 0.1, dark=0.1, light=0.9, ground=0.5)
    for points, faces, y in (
        (POINTS, QUAD, -1.0),  # from the front
        (POINTS[[1, 0, 3, 2]], QUAD, 1.0),  # a face that looks to +y: s runs to -x
    ):
        surface = gs.Surface(points, faces, paint=paint)
        camera = looking(y=y)
        image = gs.render([surface], camera, device=device).radiance
        frame = surface.paint_frame(0)

        def at(
            s: float, t: float, frame: gs.PaintFrame = frame, camera: gs.Camera = camera,
            image: np.ndarray = image,
        ) -> float:  # fmt: skip
            place = frame.origin + s * frame.s_axis + t * frame.t_axis
            x, row = np.rint(camera.project(place)).astype(int)
            return float(image[row, x])

        for x, z in centres:
            assert at(x - 0.025, z - 0.025) == pytest.approx(0.1, abs=1e-6)
            assert at(x + 0.025, z + 0.025) == pytest.approx(0.1, abs=1e-6)
            assert at(x - 0.025, z + 0.025) == pytest.approx(0.9, abs=1e-6)
        assert at(0.6, 0.1) == pytest.approx(0.5, abs=1e-6)
        # on the picture itself: the stem is left, the long bar on top
        marked = np.abs(image - 0.5) > 0.1
        rows, columns = np.nonzero(marked & (image > 0))
        assert marked[:30].sum() > 1.5 * (marked[31:] & (image[31:] > 0)).sum()
        assert np.median(columns) < 45 and np.median(rows) < 30


def test_a_pattern_sticks_to_the_material(device: Device) -> None:
    """A stretched, turned plate carries its checker along: corners where the material goes."""
    paint = gs.paint.Checker(0.15)
    plate = gs.Surface(POINTS, QUAD, paint=paint)
    matrix = np.array([[0.9, 0, 0.1], [0, 1, 0], [-0.15, 0, 0.9]])
    moved = plate.moved(POINTS @ matrix.T + [0.05, 0.1, 0.02])
    np.testing.assert_array_equal(moved.rest, plate.rest)
    image = gs.render([moved], looking(181, 121), device=device).radiance
    for i in range(6):
        for j in range(4):
            material = np.array([0.15 * i + 0.075, 0.0, 0.15 * j + 0.075])
            column, row = np.rint(
                looking(181, 121).project(material @ matrix.T + [0.05, 0.1, 0.02])
            ).astype(int)
            want = paint.dark if (i + j) % 2 == 0 else paint.light
            assert image[row, column] == pytest.approx(want, abs=1e-6)
    # moved again from there, the paint frame is still that of the undeformed plate
    again = moved.moved(plate.points)
    same = gs.render([again], looking(), device=device).radiance
    np.testing.assert_array_equal(same, gs.render([plate], looking(), device=device).radiance)


def test_regions_have_their_own_paint(device: Device) -> None:
    points = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.9, 0, 0], [0.0, 0, 0.6], [0.3, 0, 0.6],
                       [0.9, 0, 0.6]])  # fmt: skip
    surface = gs.Surface(
        points,
        np.array([[0, 1, 4, 3], [1, 2, 5, -1], [1, 5, 4, -1]]),
        paint={"steel": gs.paint.Plain(0.2), "paint": gs.paint.Plain(0.8)},
        region=np.array([0, 1, 0]),
    )
    frame = gs.render([surface], looking(), device=device)
    camera = looking()
    for place, albedo in (((0.1, 0.3), 0.2), ((0.8, 0.1), 0.8), ((0.4, 0.5), 0.2)):
        x, y = np.rint(camera.project((place[0], 0.0, place[1]))).astype(int)
        assert frame.radiance[y, x] == pytest.approx(albedo, abs=1e-7)
    # the border between them runs through pixels: both albedos by area
    ids = frame.ids()
    assert set(np.unique(frame.view.paint[ids[ids > 0].astype(int) - 1])) == {0, 1}
    between = (frame.radiance > 0.21) & (frame.radiance < 0.79)
    assert between.sum() > 40


def test_a_pattern_on_a_bent_region_is_refused(device: Device) -> None:
    points = np.concatenate([POINTS, POINTS[1:3] + np.array([0.0, 0.4, 0.0])])
    faces = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
    bent = gs.Surface(points, faces, paint=gs.paint.Checker(0.1), name="angle")
    with pytest.raises(InputError, match=r"angle.*plane region.*1 degree"):
        gs.render([bent], looking(), device=device)
    gs.render([gs.Surface(points, faces)], looking(), device=device)  # plain paint: fine
    frame = gs.PaintFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    given = gs.Surface(points, faces, paint=gs.paint.Checker(0.1), frames={"surface": frame})
    gs.render([given], looking(), device=device)


def block() -> Mesh:
    grid = np.stack(np.meshgrid([0.0, 0.3, 0.5], [0.0, 0.4, 0.6], [0.0, 0.2, 0.7],
                                indexing="ij"), axis=-1)  # fmt: skip
    number = np.arange(27).reshape(3, 3, 3)
    cells = [
        [number[i, j, k], number[i + 1, j, k], number[i + 1, j + 1, k], number[i, j + 1, k],
         number[i, j, k + 1], number[i + 1, j, k + 1], number[i + 1, j + 1, k + 1],
         number[i, j + 1, k + 1]]
        for i in range(2) for j in range(2) for k in range(2)
    ]  # fmt: skip
    return Mesh(grid.reshape(-1, 3), {"hex8": np.array(cells)})


def test_the_skin_of_a_mesh_leaves_the_inside_out() -> None:
    mesh = block()
    skin = gs.Skin(mesh, boundary_faces(mesh))
    assert len(skin.nodes) == 26 and 13 not in skin.nodes  # all but the middle
    assert len(skin.faces) == 24
    surface = skin.surface({"all": gs.paint.Plain()}, np.zeros(24, np.int32), {}, "block")
    centre = surface.points[surface.faces].mean(axis=1) - [0.25, 0.3, 0.35]
    assert (np.sum(face_normals(surface.points, surface.faces) * centre, axis=1) > 0).all()
    u = np.random.default_rng(3).normal(size=(27, 3)) * 1e-3
    moved = skin.moved(surface, u)
    np.testing.assert_allclose(moved.points - surface.points, u[skin.nodes], atol=1e-15)


def test_the_skin_locates_points_with_the_faces_own_shape_functions() -> None:
    mesh = block()
    skin = gs.Skin(mesh, boundary_faces(mesh))
    points = np.array([[0.4, 0.0, 0.33], [0.0, 0.5, 0.1], [0.5, 0.6, 0.7], [0.17, 0.22, 0.7]])
    nodes, weights = skin.locate(points)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(
        np.einsum("nk,nka->na", weights, mesh.points[nodes]), points, atol=1e-12
    )
    with pytest.raises(InputError, match=r"0\.25.*expected one on the surface"):
        skin.locate(np.array([[0.25, 0.3, 0.3]]))
    with pytest.raises(InputError, match=r"nan.*expected one on the surface"):
        skin.locate(np.array([[0.4, 0.0, 0.33], [0.4, np.nan, 0.33]]))
