"""The layers of the house: who may import whom. The contracts stand in ``pyproject.toml``."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[2]


def test_the_layers_hold(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert code == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("muro_zenoh.transport", "zenoh"),
        ("muro_zenoh.messages", "numpy"),
        ("muro_zenoh.config", "numpy"),
        ("agents.base.run", "numpy"),
        ("agents.agent", "cv2"),
        ("agents.agent", "scipy"),
        ("agents.agent", "shapely"),
        ("agents.agent", "rich"),
        ("muro_zenoh.cli.main", "cv2"),
    ],
)
def test_a_process_does_not_pay_for_what_it_does_not_use(module: str, heavy: str) -> None:
    code = f"import sys, {module}; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-P", "-c", code], cwd=ROOT, check=False).returncode == 0


def test_there_is_no_if_simulation() -> None:
    offenders = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in ("muro_zenoh", "agents", "basestation")
        for path in (ROOT / folder).rglob("*.py")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"\bif\b.*\b(is_simulat|simulated?\s*(:|==|and|or)|SIMULATION)", line)
    ]
    assert not offenders
