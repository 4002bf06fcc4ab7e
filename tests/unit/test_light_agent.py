"""What an agent imports: it starts on a small laptop."""

import subprocess
import sys

import pytest

HEAVY = ("numpy", "cv2", "shapely", "matplotlib", "scipy", "rich")


@pytest.mark.parametrize("behaviour", ["circle", "pursuit", "hold"])
def test_an_agent_on_a_circle_imports_nothing_heavy(behaviour: str) -> None:
    modules = f"import sys, muro_zenoh.cli.main, agents.agent, muro_zenoh.behaviours.{behaviour}"
    code = f"{modules}; print(*[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
