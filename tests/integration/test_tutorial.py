"""``docs/tutorial.md``: the behaviours that it shows drive robots, and what it says a robot has is there."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import pytest

from agents.robot import Robot
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_fleet import memory_fleet, scenario

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
LESSON = PAGE.split("\n## 4. ")[1].split("\n## ")[0]
SHOWN = re.findall(r"^```python\n(.*?)^```$", LESSON, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("code", SHOWN, ids=[code.split("(")[0] for code in SHOWN])
def test_a_behaviour_that_is_shown_drives_a_robot(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lesson.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lesson", raising=False)
    [name] = re.findall(r"def (\w+)\(robot\)", code)

    async def main() -> None:
        async with memory_fleet(scenario(1, f"lesson:{name}")) as fleet:
            await fleet.until(lambda: bool(fleet.driving), 3, "it drives")
            await fleet.until(lambda: fleet.healths["r1"].state == name, 2, "it says what it does")

    run_virtually(main())


def test_what_a_robot_is_said_to_have_is_there() -> None:
    said = set(re.findall(r"robot\.(\w+)", LESSON))
    attributes = set(dir(Robot)) | set(re.findall(r"^ +(\w+): ", inspect.getdoc(Robot) or "", re.MULTILINE))
    assert said <= attributes
    assert {"state", "neighbours", "drive", "goal"} <= said
