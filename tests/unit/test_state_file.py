"""The file of the kept state: what is on the disk when an order is answered, and what a wrong file is."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from pathlib import Path

import msgspec
import pytest

from basestation.fleet.kept_state import KeptState
from basestation.fleet.state_file import StateFile
from basestation.fleet.state_store import StateStore
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Resume, SetBehaviour, SetCircle, Stop
from tests.support.kept_state import files_in, fresh, scenario, stopped
from tests.support.waiting import seconds


def opened_in(folder: Path, descriptor: int) -> Path | None:
    """What a descriptor is open on; None outside the folder, where a thread of an earlier test may still be writing."""
    path = Path(f"/proc/self/fd/{descriptor}").resolve()
    return path if path.is_relative_to(folder) else None


async def test_all_of_it_outlives_the_process(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "state.json"
    kept = fresh(path)
    await kept.set_circle(SetCircle(x=0.2, y=-0.1, radius=0.6, clockwise=True))
    await kept.set_behaviour(
        SetBehaviour(behaviour="mylab.swarm:flock", parameters={"gain": 1, "goals": ((0.5, 1.0),)}, names=("r2",))
    )
    await kept.add_stop(Stop(names=("r3",)))
    again = fresh(path)
    assert again.state == kept.state
    assert again.behaviour("r2").parameters == {"gain": 1, "goals": ((0.5, 1.0),)}
    assert stopped(again) == (False, ("r3",))
    assert again.stop.revision == kept.stop.revision


async def test_without_a_file_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    await fresh(None).add_stop(Stop())
    assert files_in(tmp_path) == []


async def test_a_robot_that_the_file_does_not_know_begins_as_the_scenario_says(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path, robots=2)
    await kept.set_behaviour(SetBehaviour(behaviour="hold"))
    await kept.add_stop(Stop(names=("r1",)))
    stop = kept.stop
    again = fresh(path, robots=3)
    assert [again.behaviour(name).behaviour for name in ("r1", "r2", "r3")] == ["hold", "hold", "pursuit"]
    assert again.stop == stop  # a newer robot lifts nobody's stop
    assert fresh(path, robots=3).state == again.state


async def test_a_state_that_was_fitted_to_another_scenario_is_written_at_once(tmp_path: Path) -> None:
    """Else a robot would begin anew at each start, at a revision that it has seen."""
    path = tmp_path / "state.json"
    await fresh(path, robots=2).add_stop(Stop(names=("r2",)))
    fitted = fresh(path, robots=3).state
    assert msgspec.json.decode(path.read_bytes(), type=KeptState) == fitted
    assert "r3" in fitted.behaviour


async def test_a_kept_circle_that_is_not_used_is_named_in_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "state.json"
    await fresh(path).set_circle(SetCircle(radius=1.2))
    fresh(path)
    assert caplog.messages == []
    StateStore(parse_scenario({"robots": 3, "arena": {"y_min": -1.1, "y_max": 1.1}}, "lab.toml", name="lab"), path)
    (said,) = caplog.messages
    assert "radius=1.2" in said
    assert "radius=0.8" in said


WALL = {"start": [0.0, 1.2], "end": [0.0, 1.5]}


async def test_a_kept_behaviour_that_the_scenario_forbids_is_not_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.set_behaviour(SetBehaviour(behaviour="coverage", names=("r1", "r3")))
    await kept.set_behaviour(SetBehaviour(behaviour="mylab.swarm:flock", names=("r2",)))
    assert [fresh(path).behaviour(name).behaviour for name in ("r1", "r3")] == ["coverage", "coverage"]
    assert caplog.messages == []
    walled = parse_scenario({"robots": 3, "wall": [WALL]}, "lab.toml", name="lab")
    again = StateStore(walled, path)
    doing = [again.behaviour(name).behaviour for name in ("r1", "r2", "r3")]
    assert doing == [walled.behaviour.name, "mylab.swarm:flock", walled.behaviour.name]
    assert caplog.messages == [
        f"the kept behaviour coverage of {name} does not fit into this scenario: "
        f"using the scenario's {walled.behaviour.name}"
        for name in ("r1", "r3")
    ]
    assert again.state.revision == kept.revision + 1
    assert StateStore(walled, path).state == again.state


async def test_a_kept_circle_on_which_the_scenario_s_robots_cannot_be_is_not_used(tmp_path: Path) -> None:
    """There is room for it, but not for so many robots on it."""
    path = tmp_path / "state.json"
    await fresh(path, robots=2).set_circle(SetCircle(radius=0.3))
    assert fresh(path, robots=2).circle.radius == 0.3
    again = fresh(path, robots=8)
    assert again.circle.radius == scenario(8).circle.radius
    assert {again.behaviour(name).behaviour for name in again.robots} == {"pursuit"}


async def test_a_disk_that_hangs_keeps_three_threads_and_not_the_end_of_the_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setattr(os, "fsync", lambda fd: released.wait(seconds(30)))
    file = StateFile(tmp_path / "state.json")
    state = fresh().state
    before = set(threading.enumerate())  # those of an earlier test may still be ending
    try:
        writing = [file.write(state) for _ in range(6)]
        assert sum(thread.name.startswith("state file") for thread in set(threading.enumerate()) - before) == 3
        file.close()  # does not wait
        assert not any(write.done() for write in writing)
    finally:
        released.set()
    await asyncio.gather(*writing)


async def test_the_folders_above_the_file_are_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "state.json"
    await fresh(path).add_stop(Stop())
    assert files_in(path.parent) == ["state.json"]
    await fresh(path).add_stop(Stop(names=("r1",)))


async def test_a_place_where_no_file_can_be_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a file")
    with pytest.raises(ConfigError, match=r"state\.json: got (File exists|Not a directory)"):
        await fresh(tmp_path / "a" / "state.json").add_stop(Stop())


async def test_a_change_is_on_the_disk_before_it_is_answered(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop())
    assert json.loads(path.read_text())["stop_all"] is True
    assert json.loads(path.read_text())["revision"] == kept.revision
    assert files_in(tmp_path) == ["state.json"]


async def test_all_of_it_is_in_the_file_when_that_is_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a buffer still holds is lost with the power."""
    synced: list[bytes] = []

    def sync(fd: int) -> None:
        path = opened_in(tmp_path, fd)
        if path is not None and path.is_file():
            synced.append(path.read_bytes())

    monkeypatch.setattr(os, "fsync", sync)
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop(names=("r2",)))
    assert [msgspec.json.decode(data, type=KeptState) for data in synced] == [kept.state]
    assert path.read_bytes() == synced[0]


async def test_the_files_new_name_is_synced_before_a_stop_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    steps: list[str] = []
    replace = Path.replace

    def sync(fd: int) -> None:
        path = opened_in(tmp_path, fd)
        if path is not None:
            steps.append(f"sync {path.name}")

    def rename(file: Path, target: Path) -> Path:
        if target == path:
            steps.append(f"rename {file.name} to {target.name}")
        return replace(file, target)

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(Path, "replace", rename)
    await kept.add_stop(Stop())
    new, folder = "state.json.1.new", tmp_path.name
    assert steps == [f"sync {new}", f"rename {new} to state.json", f"sync {folder}"]


async def test_a_folder_that_hangs_keeps_no_other_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")
    hangs, released = threading.Event(), threading.Event()

    def sync(fd: int) -> None:
        if opened_in(tmp_path, fd) == tmp_path and not hangs.is_set():
            hangs.set()
            released.wait(seconds(30))

    monkeypatch.setattr(os, "fsync", sync)
    first = asyncio.ensure_future(kept.add_stop(Stop(names=("r1",))))
    try:
        assert await asyncio.to_thread(hangs.wait, seconds(10))
        await asyncio.wait_for(kept.add_stop(Stop(names=("r2",))), seconds(10))
        assert not first.done()
    finally:
        released.set()
    await first


async def test_a_half_written_file_is_never_the_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.set_circle(SetCircle(radius=0.6))
    before = path.read_bytes()

    def crash(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(ConfigError, match=r"state\.json: got No space left on device"):
        await kept.set_circle(SetCircle(radius=0.7))
    assert path.read_bytes() == before
    assert kept.circle.radius == 0.6  # what was refused does not hold
    monkeypatch.undo()
    assert fresh(path).circle.radius == 0.6


async def test_a_stop_holds_even_where_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError):
        await kept.add_stop(Stop(names=("r1",)))
    assert stopped(kept) == (False, ("r1",))
    with pytest.raises(ConfigError):
        await kept.add_stop(Stop())
    assert stopped(kept) == (True, ("r1",))
    with pytest.raises(ConfigError):
        await kept.resume(Resume(revision=kept.stop.revision))
    assert stopped(kept) == (True, ("r1",))


async def test_a_resume_that_cannot_be_kept_lifts_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")
    await kept.add_stop(Stop())
    before = kept.state

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError):
        await kept.resume(Resume(revision=kept.stop.revision, names=("r1",)))
    assert kept.state == before


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe", b"[]", b'{"revision": 1}', b'{"revision": "one"}', b"null"],
    ids=["empty", "half", "no text", "a list", "incomplete", "wrong type", "null"],
)
async def test_a_file_that_is_no_state_is_refused_and_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "state.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        fresh(path)
    assert str(path) in str(caught.value)
    assert "a stop order in it is then forgotten" in str(caught.value)
    assert path.read_bytes() == content


async def test_a_state_with_a_wrong_value_or_key_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    await fresh(path).add_stop(Stop())
    good = json.loads(path.read_text())
    for change in (
        {"circle": {**good["circle"], "radius": 0.0}},
        {"circle": {**good["circle"], "x": None}},
        {"circle": {"x": 0.0, "y": 0.0}},
        {"revision": -1},
        {"stop_all": "yes"},
        {"stop_names": ["R 1"]},
        {"speed": 1.0},
    ):
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(ConfigError, match="no kept state"):
            fresh(path)


async def test_a_file_of_the_layout_before_the_circle_was_one_value_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    await fresh(path).add_stop(Stop())
    old = json.loads(path.read_text())
    old["x"], old["y"], old["radius"], old["clockwise"] = old.pop("circle").values()
    path.write_text(json.dumps(old))
    with pytest.raises(ConfigError, match=r"state\.json: got a file that is no kept state: .*`x`") as caught:
        fresh(path)
    assert "Move it away to start from the scenario" in str(caught.value)
