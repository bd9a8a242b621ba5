"""How much memory new work may take: of the system, of a container, of the process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gpusim.errors import InputError
from gpusim.parallel import machine
from gpusim.pipeline.checks.resources import check_memory
from gpusim.plan.plan import make_plan
from gpusim.scene import load_scene

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")


def test_what_the_process_may_map() -> None:
    code = "from gpusim.parallel.machine import available_memory as a; print(a())"
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({int(3e9)}, -1)); {code}"
    free = int(subprocess.check_output([sys.executable, "-c", limited]))
    assert 2e9 < free < 3e9


@pytest.mark.parametrize(
    ("line", "files"),
    [
        ("0::/job/step", {"job/memory.max": "3000000", "job/memory.current": "1000000"}),
        ("0::/not/seen/inside", {"memory.max": "3000000", "memory.current": "1000000"}),
        (
            "4:cpu,memory:/job",
            {
                "memory/job/memory.limit_in_bytes": "3000000",
                "memory/job/memory.usage_in_bytes": "1500000",
                "memory/job/memory.stat": "cache 700000\ntotal_inactive_file 500000\n",
            },
        ),
    ],
)
def test_what_a_container_may_take(
    line: str, files: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in {"job/step/memory.max": "max", **files}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    read = Path.read_text
    monkeypatch.setattr(machine, "_GROUPS", tmp_path)
    monkeypatch.setattr(
        Path,
        "read_text",
        lambda path, *a, **k: line if path == Path("/proc/self/cgroup") else read(path, *a, **k),
    )
    assert machine.available_memory() == 2_000_000
    monkeypatch.setattr(machine, "_GROUPS", tmp_path / "none")
    assert machine.host_memory() > 1e8


def test_too_little_for_the_libraries_is_said_before_any_work(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(load_scene(checkout / "examples" / "cantilever.toml"))
    check_memory(plan)
    monkeypatch.setattr("gpusim.pipeline.checks.resources.host_memory", lambda: 100_000_000)
    with pytest.raises(InputError, match=r"got 100 MB free .* expected at least 256 MB"):
        check_memory(plan)
