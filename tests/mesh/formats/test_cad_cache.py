"""Meshes of CAD files are made once: what is kept, when it is used, and what bounds it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import Mesh, mesh_cad
from gpusim.mesh.formats import cad_cache
from gpusim.mesh.formats.cad_cache import cached_cad_mesh
from tests.support.gmsh_meshes import Gmsh


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cad") / "box.step"
    with Gmsh() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 40, 30, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of meshes that are kept."""
    monkeypatch.delenv("GPUSIM_NO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "gpusim" / "meshes"


@pytest.fixture
def meshed(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Sizes that Gmsh was asked for."""
    sizes: list[float] = []

    def counted(path: Any, **options: Any) -> Mesh:
        sizes.append(options["size"])
        return mesh_cad(path, **options)

    monkeypatch.setattr(cad_cache, "mesh_cad", counted)
    return sizes


def same(one: Mesh, other: Mesh) -> bool:
    mappings = ("cells", "node_sets", "face_sets", "cell_sets")
    pairs = [(getattr(one, name), getattr(other, name)) for name in mappings]
    return np.array_equal(one.points, other.points) and all(
        list(a) == list(b) and all(np.array_equal(a[name], b[name]) for name in a) for a, b in pairs
    )


def test_a_part_is_meshed_once(box: Path, kept: Path, meshed: list[float], tmp_path: Path) -> None:
    first = cached_cad_mesh(box, size=10.0, time_limit=60.0)
    assert same(first, mesh_cad(box, size=10.0)) and len(first.face_sets) == 6
    moved = tmp_path / "moved.step"
    moved.write_bytes(box.read_bytes())
    assert same(first, cached_cad_mesh(moved, size=10.0, time_limit=90.0))
    assert meshed == [10.0] and len(list(kept.iterdir())) == 1
    for options in ({"size": 4.0}, {"size": 10.0, "order": 2}, {"size": 10.0, "scale": 2.0}):
        assert not same(first, cached_cad_mesh(box, **options))
    moved.write_bytes(box.read_bytes().replace(b"40.", b"44."))
    assert cached_cad_mesh(moved, size=10.0).bounds[1, 0] == 44.0
    assert meshed == [10.0, 4.0, 10.0, 10.0, 10.0]


def test_nothing_is_kept_where_caches_are_switched_off(
    box: Path, kept: Path, meshed: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GPUSIM_NO_CACHE", "1")
    for _ in range(2):
        cached_cad_mesh(box, size=10.0)
    assert meshed == [10.0, 10.0] and not kept.exists()


def test_a_part_that_cant_be_meshed_is_tried_again(
    box: Path, kept: Path, meshed: list[float]
) -> None:
    for _ in range(2):
        with pytest.raises(InputError, match=r"makes about 8e\+13 elements"):
            cached_cad_mesh(box, size=1.1e-3)
    assert len(meshed) == 2 and not kept.exists()


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def _changed(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[300] ^= 1
    path.write_bytes(content)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _link(path: Path) -> None:
    path.rename(path.with_suffix(".other"))
    path.symlink_to(path.with_suffix(".other"))


def _huge(path: Path) -> None:
    os.truncate(path, 3_000_000_000)


def _pickled(path: Path) -> None:
    with np.load(path) as stored:
        arrays = dict(stored)
    np.savez(path, **{**arrays, "points": np.array([object()])})


def _other(path: Path) -> None:
    with np.load(path) as stored:
        arrays = dict(stored)
    heads = str(arrays["heads"]).replace(path.name[:8], "00000000")
    np.savez(path, **{**arrays, "heads": np.array(heads)})


def _inverted(path: Path) -> None:
    with np.load(path) as stored:
        arrays = dict(stored)
    np.savez(path, **{**arrays, "points": -arrays["points"]})


@pytest.mark.parametrize(
    "damage", [_cut, _changed, _pipe, _link, _huge, _pickled, _other, _inverted]
)
def test_what_is_damaged_is_made_anew(
    box: Path, kept: Path, meshed: list[float], damage: Any
) -> None:
    first = cached_cad_mesh(box, size=10.0)
    (path,) = kept.iterdir()
    damage(path)
    assert same(first, cached_cad_mesh(box, size=10.0))
    assert same(first, cached_cad_mesh(box, size=10.0))
    assert meshed == [10.0, 10.0] and path.is_file() and not path.is_symlink()


def test_the_oldest_go(
    box: Path, kept: Path, meshed: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cad_cache, "MOST_MESHES", 2)
    for number, size in enumerate((10.0, 11.0)):
        cached_cad_mesh(box, size=size)
        for path in kept.iterdir():
            os.utime(path, (number, number + path.stat().st_mtime % 1))
    cached_cad_mesh(box, size=10.0)  # in use
    cached_cad_mesh(box, size=12.0)
    assert len(list(kept.iterdir())) == 2
    meshed.clear()
    for size in (10.0, 12.0, 11.0):
        cached_cad_mesh(box, size=size)
    assert meshed == [11.0]
    most = 200_000
    monkeypatch.setattr(cad_cache, "MOST_BYTES", most)
    for _ in range(2):
        cached_cad_mesh(box, size=5.0)
    assert meshed == [11.0, 5.0]
    assert 0 < sum(path.stat().st_size for path in kept.iterdir()) <= most
