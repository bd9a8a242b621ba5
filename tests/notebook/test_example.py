"""The example runs from top to bottom, and importing gpusim brings nothing of notebooks along."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import nbformat
import pytest

HEAVY = (
    "IPython",
    "anywidget",
    "gpusim.notebook",
    "matplotlib",
    "nbclient",
    "rendercanvas.anywidget",
)


@pytest.fixture(scope="module")
def notebook(checkout: Path) -> Any:
    return nbformat.read(checkout / "examples" / "notebook.ipynb", as_version=4)


def test_it_is_committed_without_results(notebook: Any) -> None:
    codes = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert 8 <= len(codes) <= 12
    assert [cell for cell in codes if cell.outputs or cell.execution_count] == []


RUN = """
import sys, nbclient, nbformat
from pathlib import Path
path = Path(sys.argv[1])
notebook = nbformat.read(path, as_version=4)
nbclient.NotebookClient(
    notebook, timeout=120, resources={"metadata": {"path": str(path.parent)}}
).execute()
nbformat.write(notebook, sys.argv[2])
"""


def test_it_runs(checkout: Path, tmp_path: Path) -> None:
    """In a process of its own: what the kernel's protocol warns of is none of ours."""
    path, out = checkout / "examples" / "notebook.ipynb", tmp_path / "run.ipynb"
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(path), str(out)],
        capture_output=True, text=True, timeout=180,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    cells = [cell for cell in nbformat.read(out, as_version=4).cells if cell.cell_type == "code"]
    htmls = ["".join(one.get("data", {}).get("text/html", "") for one in cell.outputs)
             for cell in cells]  # fmt: skip
    titles = re.findall(r"font-weight: 600[^>]*>(.*?)</div>", "".join(htmls))
    # a live view where the extra is installed, else a still one
    (view,) = (str(cell.outputs) for cell in cells if ".view(" in cell.source)
    live = find_spec("anywidget") is not None
    assert ("jupyter.widget-view+json" in view) == live
    assert titles == [
        "Mesh", "Solution", "Camera", "Frame", "Surface plate", "DicResult", "Scene Cantilever",
        *([] if live else ["Cantilever, camera side"]), "Report of Cantilever",
    ]  # fmt: skip
    assert "".join(htmls).count("data:image/png") >= 8 and "No picture" not in "".join(htmls)
    figures = [cell for cell in cells for one in cell.outputs if "image/png" in one.get("data", {})
               and "text/html" not in one["data"]]  # fmt: skip
    assert len(figures) == 2
    (error,) = re.findall(r"RMS error (\S+) px", str([cell.outputs for cell in cells]))
    assert float(error) < 0.02


def test_importing_brings_nothing_of_it() -> None:
    code = (
        "import sys, gpusim as gs\n"
        "gs.Mesh, gs.Solution, gs.Frame, gs.Camera, gs.Scene, gs.Surface, gs.measure.DicResult\n"
        "repr(gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1)))\n"
        f"found = set({HEAVY!r}) & set(sys.modules)\n"
        "assert not found, found\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
