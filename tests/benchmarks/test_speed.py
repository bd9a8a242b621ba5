"""What is kept of how fast a machine is."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from gpusim.files.cache_files import cache_folder
from gpusim.plan.machine_speed import Speed, Workload
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene, load_scene

DRAW = Workload("render", "5616x3744 px, 3 lights", 12.0, 9.0)
MORE = Workload("render", "400x300 px, 3 lights", 0.5)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("GPUSIM_NO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "gpusim" / "speed.json"


def test_a_machine_that_is_half_as_fast(cache: Path) -> None:
    speed = Speed.read("gpu")
    assert speed.seconds(DRAW) == 12.0 and not cache.exists()
    speed.learn({Workload("solve", "a", 2.0): 4.0, MORE: 1.0}, "a card")
    speed.save()
    again = Speed.read("gpu")
    assert again.adapter == "a card"
    assert again.seconds(Workload("solve", "b", 3.0)) == 6.0
    assert again.seconds(Workload("solve", "a", 2.0)) == 4.0
    # pictures twice as slow; of shaders nothing is known
    assert again.seconds(DRAW) == 2.0 * 3.0 + 9.0
    assert Speed.read("numpy").seconds(Workload("solve", "b", 3.0)) == 3.0
    again.learn({DRAW: 30.0}, "a card")
    assert again.seconds(DRAW) == 30.0
    # most of that were shaders: it says nothing of pictures
    assert again.ratios["render"] == 2.0
    # another card has all to be learned
    again.learn({MORE: 0.1}, "another card")
    assert again.seconds(Workload("solve", "b", 3.0)) == 3.0 and again.ratios == {"render": 0.2}


def test_the_last_run_counts(cache: Path) -> None:
    del cache
    speed = Speed()
    for seconds in (1.0, 8.0, 0.125):
        speed.learn({MORE: seconds}, "")
        assert speed.seconds(MORE) == seconds
    assert speed.ratios == {"render": 0.25}


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", '{"version": 1}', '{"version": 3, "machines": []}', "[" * 100_000, "\udcff",
     '{"version": 3, "machines": {"M": {"ratios": {"solve": 1e99}}}}',
     '{"version": 3, "machines": {"M": {"ratios": {"solve": "NaN"}}}}',
     '{"version": 3, "machines": {"M": {"known": 3}}}'],
)  # fmt: skip
def test_a_damaged_file_is_as_none_at_all(cache: Path, text: str) -> None:
    cache.parent.mkdir()
    machine = Speed.read("gpu").machine
    cache.write_bytes(text.replace('"M"', json.dumps(machine)).encode(errors="surrogateescape"))
    speed = Speed.read("gpu")
    assert speed == Speed(machine=machine)
    speed.learn({MORE: 1.0}, "")
    speed.save()
    assert Speed.read("gpu").seconds(MORE) == 1.0


def test_where_nothing_can_be_kept(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    speed = Speed.read("gpu")
    speed.learn({MORE: 1.0}, "")
    speed.save()
    assert Speed.read("gpu") == Speed(machine=speed.machine)
    monkeypatch.setenv("GPUSIM_NO_CACHE", "1")
    assert cache_folder() is None
    speed.save()
    monkeypatch.delenv("GPUSIM_NO_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME")

    def homeless() -> Path:
        raise RuntimeError("no home")

    monkeypatch.setattr(Path, "home", homeless)
    speed.save()
    assert Speed.read("gpu") == Speed(machine=speed.machine)
    assert not cache.exists()


def test_writers_at_the_same_time_leave_a_whole_file(cache: Path) -> None:
    def write(k: int) -> None:
        speed = Speed.read(f"backend {k}")
        speed.learn({MORE: 1.0 + k}, "")
        speed.save()

    threads = [threading.Thread(target=write, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert json.loads(cache.read_text(encoding="utf-8"))["version"] == 3
    assert list(cache.parent.iterdir()) == [cache]


def test_a_plan_at_this_machine_s_speed(checkout: Path) -> None:
    stereo: Scene = load_scene(checkout / "examples" / "crane_stereo.toml")
    plan = make_plan(stereo)
    kinds = {work.kind: work for work in plan.works}
    # measured on two cores: 20 s in all, half of it the 42 pictures of the target
    assert 10.0 < plan.seconds - kinds["render"].compiling < 40.0
    assert 5.0 < kinds["target"].seconds < 20.0
    slow = Speed(machine="m")
    slow.learn({kinds["target"]: 3.0 * kinds["target"].seconds}, "")
    again = make_plan(stereo, speed=slow)
    assert again["render/right/calib-0007"].seconds == pytest.approx(
        3.0 * plan["render/right/calib-0007"].seconds
    )
    assert again["solve"].seconds == pytest.approx(plan["solve"].seconds)
    assert again.works == plan.works


def test_states_compile_once(checkout: Path) -> None:
    beam = load_scene(checkout / "examples" / "damaged_beam.toml")
    frames = [s for s in make_plan(beam).stages if "/render/" in s.name and s.frame == 0]
    assert [frame.compiling > 0.0 for frame in frames] == [True, False, False, False]


def test_auto_is_what_the_machine_has(cache: Path) -> None:
    del cache
    Speed.read("auto").save()
    ran = Speed.read("gpu")
    ran.learn({MORE: 1.0}, "a card")
    ran.save()
    assert Speed.read("auto").seconds(MORE) == 1.0
    Speed.read("numpy").save()
    assert Speed.read("auto").adapter == "a card"


def test_auto_without_an_adapter_is_what_numpy_takes(cache: Path) -> None:
    del cache
    Speed.read("auto").save()
    ran = Speed.read("numpy")
    ran.learn({MORE: 7.0}, "")
    ran.save()
    assert Speed.read("auto").seconds(MORE) == 7.0


def test_stages_of_no_time_at_all_are_learned_and_learned_again(cache: Path) -> None:
    del cache
    for seconds in (2e-5, 1e-12, 3e-5):
        speed = Speed.read("gpu")
        speed.learn({MORE: seconds, DRAW: 1.0}, "a card")
        speed.save()
    assert 1e-5 < Speed.read("gpu").known[MORE.signature] < 4e-5
