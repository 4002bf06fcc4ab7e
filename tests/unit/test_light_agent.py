"""What an agent imports: it starts on a small laptop."""

import subprocess
import sys

import pytest

HEAVY = ("numpy", "cv2", "shapely", "matplotlib", "scipy", "click", "rich")


@pytest.mark.parametrize("task", ["path_following", "pursuit", "hold"])
def test_an_agent_on_a_circle_imports_nothing_heavy(task: str) -> None:
    code = f"import sys, agents.agent, agents.tasks.{task}; print(*[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
