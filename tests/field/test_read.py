"""Displacement fields of other programs: every format, every type of cell, times between steps."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export import write_pvd, write_vtu
from gpusim.field import FIELD_SUFFIXES, Field, read_field
from gpusim.mesh import CELL_TYPES
from gpusim.scene.description.mesh import FIELD_SUFFIXES as SCHEMA_SUFFIXES
from tests.mesh.formats import test_exodus as exodus

Float = npt.NDArray[np.float64]

TIMES = (0.5, 2.0)
KINDS = ("hex8", "hex20", "tet4", "tet10", "wedge6", "wedge15")
# manual of CalculiX GraphiX, "Element Types": where each node lies, as corners (from 1)
_VERTICAL = ["15", "26", "37", "48"]
_TOP = ["56", "67", "78", "85"]
FRD_MIDDLES = {
    "hex20": ["12", "23", "34", "41", *_VERTICAL, *_TOP],
    "tet10": ["12", "23", "31", "14", "24", "34"],
    "wedge15": ["12", "23", "31", "14", "25", "36", "45", "56", "64"],
}
FRD_TYPES = {"hex8": 1, "wedge6": 2, "tet4": 3, "hex20": 4, "wedge15": 5, "tet10": 6}


def displacement(points: Float, time: float) -> Float:
    """Quadratic in time, so that interpolation between steps shows."""
    x, y, z = points.T
    return np.stack([0.1 * y * time, -0.2 * z * x, 0.3 * x + y * z], axis=1) * time * 1e-2


def cell(kind: str) -> gs.Mesh:
    """One cell of a type, of unequal sides."""
    points = exodus.content(kind)[0]
    corners = np.stack([points[f"coord{axis}"] for axis in "xyz"], axis=1)
    corners = corners[: CELL_TYPES[CELL_TYPES[kind].linear].nodes]
    mesh = gs.Mesh(corners, {CELL_TYPES[kind].linear: np.arange(len(corners))[None]})
    return mesh if kind in mesh.cells else gs.mesh.quadratic(mesh)


def frd(path: Path, kind: str, steps: tuple[float, ...] = TIMES, long: bool = True) -> Path:
    """One element as CalculiX writes it, with scattered labels, in the manual's node order."""
    corners = cell(kind).points[: CELL_TYPES[kind].corners]
    middles = [
        corners[[int(c) - 1 for c in pair]].mean(axis=0) for pair in FRD_MIDDLES.get(kind, [])
    ]
    points = np.concatenate([corners, np.reshape(middles, (-1, 3))])
    labels = [7 + 3 * k for k in range(len(points))]
    wide, code = (10, 1) if long else (5, 0)

    def rows(values: Float) -> list[str]:
        return [
            f" -1{label:{wide}d}" + "".join(f"{v:12.5E}" for v in row)
            for label, row in zip(labels, values, strict=True)
        ]

    lines = ["    1C", "    1UUSER", f"    2C{len(points):30d}{code:38d}", *rows(points), " -3"]
    nodes = [f"{label:{wide}d}" for label in labels]
    lines += [f"    3C{1:30d}{code:38d}", f" -1{1:{wide}d}{FRD_TYPES[kind]:5d}    0    1"]
    lines += [" -2" + "".join(nodes[k : k + 10]) for k in range(0, len(nodes), 10)] + [" -3"]
    for number, time in enumerate(steps, 1):
        lines.append(
            f"  100CL  10{number}{time:12.5E}{len(points):12d}{0:22d}{number:5d}{code:12d}"
        )
        lines += [" -4  DISP        4    1"]
        lines += [f" -5  D{k}          1    2    {k}    0" for k in (1, 2, 3)]
        lines += [" -5  ALL         1    2    0    0    1ALL"]
        lines += [*rows(displacement(points, time)), " -3"]
    path.write_text("\n".join([*lines, " 9999", ""]))
    return path


def npz(path: Path, kind: str) -> Path:
    mesh = cell(kind)
    u = np.stack([displacement(mesh.points, time) for time in TIMES])
    np.savez(path, points=mesh.points, displacement=u, times=np.array(TIMES),
             allow_pickle=False, **{f"cells_{kind}": mesh.cells[kind]})  # fmt: skip
    return path


def pvd(path: Path, kind: str) -> Path:
    mesh = cell(kind)
    files = [(time, path.with_name(f"step-{time}.vtu")) for time in TIMES]
    for time, file in files:
        u = displacement(mesh.points, time)
        write_vtu(file, mesh.points, mesh.cells, point_data={"T": u[:, 0], "U": u})
    return write_pvd(path, files)


def series(path: Path, kind: str) -> Path:
    pvd(path.with_name("all.pvd"), kind)
    entries = [{"name": f"step-{time}.vtu", "time": time} for time in reversed(TIMES)]
    path.write_text(json.dumps({"file-series-version": "1.0", "files": entries}))
    return path


def exodus_file(path: Path, kind: str, hdf: bool = False) -> Path:
    variables, kinds = exodus.content(kind)
    points = np.stack([variables[f"coord{axis}"] for axis in "xyz"], axis=1)
    u = np.stack([displacement(points, time) for time in TIMES])
    variables["time_whole"] = np.array(TIMES)
    variables["name_nod_var"] = exodus.letters(["disp_x", "disp_y", "disp_z"])
    for axis in range(3):
        variables[f"vals_nod_var{axis + 1}"] = u[:, :, axis]
    return exodus.write(path, variables, kinds, hdf)


FORMATS: dict[str, Callable[[Path, str], Path]] = {
    "field.frd": frd,
    "old.frd": lambda path, kind: frd(path, kind, long=False),
    "field.npz": npz,
    "field.pvd": pvd,
    "field.vtu.series": series,
    "field.e": exodus_file,
    "hdf.exo": lambda path, kind: exodus_file(path, kind, hdf=True),
}


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, kind) for name in FORMATS for kind in KINDS if name != "hdf.exo" or kind == "tet10"],
)
def test_every_format_gives_every_node_its_own_displacement(
    name: str, kind: str, tmp_path: Path
) -> None:
    field = read_field(FORMATS[name](tmp_path / name, kind))
    assert list(field.mesh.cells) == [kind] and tuple(field.times) == TIMES
    points = field.mesh.points
    for number, time in enumerate(TIMES):
        want = displacement(points, time)
        assert np.abs(field.step(number) - want).max() <= 1e-5 * np.abs(want).max()
    # node order: midside nodes lie where their cell says
    for corners, node in zip(CELL_TYPES[kind].parents, range(CELL_TYPES[kind].corners, 99),
                             strict=False):  # fmt: skip
        own = field.mesh.cells[kind][0]
        middle = points[own[list(corners)]].mean(axis=0)
        assert np.abs(points[own[node]] - middle).max() <= 1e-4


@pytest.mark.parametrize("name", ["field.frd", "field.pvd"])
def test_between_steps_the_field_is_linear_and_starts_undeformed(name: str, tmp_path: Path) -> None:
    field = read_field(FORMATS[name](tmp_path / name, "hex20"), scale=1e-3, magnify=3.0)
    points = 1e3 * field.mesh.points
    low, high = (3e-3 * displacement(points, time) for time in TIMES)
    span = TIMES[1] - TIMES[0]
    for time, want in (
        (0.0, 0 * low),
        (0.2, 0.4 * low),
        (0.5, low),
        (1.1, low + (1.1 - 0.5) / span * (high - low)),
        (2.0, high),
    ):
        assert np.abs(field.at(time) - want).max() <= 1e-5 * np.abs(high).max(), time
    assert (field.start, field.end) == (0.0, 2.0)
    for time in (-0.1, 2.001, float("nan")):
        with pytest.raises(InputError, match=r"time; got .*; expected 0 to 2, what its steps"):
            field.at(time)


def test_a_field_that_begins_before_zero_is_not_made_to_rest() -> None:
    mesh = cell("tet4")
    u = np.random.default_rng(4).normal(size=(2, mesh.node_count, 3))
    field = Field(mesh, [-1.0, 1.0], u)
    assert field.start == -1.0
    np.testing.assert_allclose(field.at(0.5), 0.25 * u[0] + 0.75 * u[1])


def test_steps_are_read_when_needed_and_the_last_two_are_kept() -> None:
    mesh, asked = cell("tet4"), []

    def read(number: int) -> Float:
        asked.append(number)
        return np.full((mesh.node_count, 3), float(number))

    field = Field(mesh, [0.0, 1.0, 2.0, 3.0], read)
    assert asked == []
    for time in (0.5, 0.7, 1.5, 1.2):
        assert field.at(time)[0, 0] == pytest.approx(time)
    assert asked == [0, 1, 2]


def test_a_single_vtu_is_the_state_at_time_1_and_loose_nodes_are_left_out(tmp_path: Path) -> None:
    mesh = cell("hex8")
    points = np.concatenate([[[9.0, 9, 9]], mesh.points])
    u = displacement(points, 2.0)
    names = ("U_x", "U_y", "U_z")
    path = tmp_path / "state.vtu"
    write_vtu(path, points, {"hex8": mesh.cells["hex8"] + 1},
              point_data={name: u[:, k] for k, name in enumerate(names)})  # fmt: skip
    field = read_field(path)
    assert field.times.tolist() == [1.0] and field.mesh.node_count == 8
    np.testing.assert_allclose(field.at(0.5), 0.5 * u[1:], rtol=1e-12)
    with pytest.raises(InputError, match=r"state.vtu: .*got U_x, U_y, U_z; expected 'V'"):
        read_field(path, name="V")
    with pytest.raises(InputError, match=r"'U_x' has one number per node; expected a vector"):
        read_field(path, name="U_x")


def test_readers_and_scene_know_the_same_files() -> None:
    assert FIELD_SUFFIXES == SCHEMA_SUFFIXES


def cut(path: Path, to: str, text: str) -> None:
    path.write_text(path.read_text().replace(to, text, 1))


def test_faults_name_file_and_cause(tmp_path: Path) -> None:
    good = frd(tmp_path / "good.frd", "hex20").read_text()
    bad = tmp_path / "bad.frd"

    def refused(text: str, match: str) -> None:
        bad.write_text(text)
        with pytest.raises(InputError, match=match) as told:
            read_field(bad).at(2.0)
        assert "bad.frd" in str(told.value)

    refused(good.replace("DISP", "NDTEMP"), "no block DISP; got results NDTEMP")
    refused(good.replace("    4    0    1\n", "   40    0    1\n"), "element type '40'")
    refused(good[: len(good) // 3], "cut off")
    refused("nothing", "not an .frd file")
    lines = good.splitlines()
    last = max(k for k, line in enumerate(lines) if line.startswith(" -1"))
    refused("\n".join(lines[:last] + lines[last + 1 :]), "1 nodes without a finite value")
    refused("\n".join([*lines[:last], lines[last][:-3], *lines[last + 1 :]]), "unequal length")
    refused(good.replace("2.00000E+00", "5.00000E-01"), "growing times")
    refused(
        good.replace("    2    3    0", "    2    1    0"), "got components of .* 2 1, 2 2, 2 1"
    )
    refused(
        good.replace("    1    2", "    1    4"), "block DISP; got components of type .* 4 1, 4 2"
    )
    refused(good.replace("  100C", "  101C"), "got '101CL .*expected a block: damaged")
    step = next(line for line in lines if line.startswith("  100C"))
    refused(good.replace(step, step[:57] + "2" + step[58:]), "results of a frequency analysis")
    head = next(line for line in lines if line.startswith("    2C"))
    refused(good.replace(head, head[:-1] + "2"), "format '2' of a block; expected 0 or 1: text")

    with pytest.raises(InputError, match="not found"):
        read_field(tmp_path / "none.frd")
    (tmp_path / "field.xyz").write_text("")
    with pytest.raises(InputError, match=r"unknown kind of field; got '.xyz'"):
        read_field(tmp_path / "field.xyz")
    with pytest.raises(InputError, match=r"scale; got 0\.0; expected a factor > 0"):
        read_field(tmp_path / "good.frd", scale=0.0)
    np.savez(tmp_path / "poor.npz", points=np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"poor.npz: no array cells_hex8 or the like, displacemen"):
        read_field(tmp_path / "poor.npz")
    pieces = pvd(tmp_path / "pieces.pvd", "hex8")
    cut(pieces, 'timestep="0.5"', 'timestep="2"')
    with pytest.raises(InputError, match="two files of time 2"):
        read_field(pieces)
    gone = pvd(tmp_path / "gone.pvd", "hex8")
    (tmp_path / "step-2.0.vtu").unlink()
    with pytest.raises(InputError, match=r"names step-2.0.vtu, which isn't there"):
        read_field(gone)


@pytest.mark.parametrize(
    ("times", "u", "match"),
    [
        ([1.0, 1.0], np.zeros((2, 4, 3)), "growing times"),
        ([1.0, np.nan], np.zeros((2, 4, 3)), "finite"),
        ([1.0, 2.0], np.zeros((2, 5, 3)), r"got shape \(2, 5, 3\); expected \(2, 4, 3\)"),
        ([1.0], np.full((4, 3), np.inf), "4 nodes without a finite value"),
    ],
)
def test_bad_fields_are_refused(times: list[float], u: Float, match: str) -> None:
    with pytest.raises(InputError, match=match):
        Field(cell("tet4"), times, u).at(1.0)
