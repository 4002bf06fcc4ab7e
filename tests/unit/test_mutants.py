"""What `make mutants` is told: its modules, its tests and its explanations are there. It itself is not run here."""

from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path

import pytest

from tests.mutants import Mutant, constants, judge, neighbours, sides

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutmut"]
EXPLAINED = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text())["explained"]


@pytest.mark.parametrize("pattern", SETTINGS["only_mutate"])
def test_each_module_is_there(pattern: str) -> None:
    assert list(ROOT.glob(pattern))


@pytest.mark.parametrize("test", SETTINGS["pytest_add_cli_args_test_selection"])
def test_each_test_is_there(test: str) -> None:
    path, _, name = test.partition("::")
    text = (ROOT / path).read_text()
    assert not name or f"class {name}" in text


def test_each_explanation_is_of_a_line_that_is_there_and_has_its_reason() -> None:
    for entry in EXPLAINED:
        assert entry["line"] in (ROOT / entry["module"]).read_text(), "the line has changed: run make mutants"
        assert entry["reason"]
    keys = Counter((entry["module"], entry["line"], new) for entry in EXPLAINED for new in entry["becomes"])
    assert max(keys.values()) == 1


def test_a_survivor_without_an_explanation_fails_and_so_does_an_explanation_without_a_survivor() -> None:
    fits = [
        Mutant(entry["module"], "f", entry["line"], new, "survived") for entry in EXPLAINED for new in entry["becomes"]
    ]
    killed = Mutant("agents/base/base.py", "f", "", "", "killed")
    left = Mutant("agents/base/base.py", "Base.obey", "if a < b:", "if a <= b:", "survived")
    report, ok = judge({"base": [killed, *fits]}, complete=True)
    assert ok
    assert f"| base | {len(fits) + 1} | 1 | 0 | 0 | {len(fits)} | {len(fits)} |" in report
    report, ok = judge({"base": [*fits, left]}, complete=True)
    assert not ok
    assert "not explained: agents/base/base.py Base.obey\n    - if a < b:\n    + if a <= b:" in report
    assert not judge({"base": fits[1:]}, complete=True)[1]
    assert judge({"base": fits[1:]}, complete=False)[1]


def test_a_diff_is_shown_by_the_lines_that_change_without_their_comments() -> None:
    diff = "--- a\n+++ b\n@@ -1,2 +1,2 @@\n def f():\n-    return 1  # one\n+    return 2  # one\n"
    assert sides(diff) == ("return 1", "return 2")


def test_numeric_constants_are_made_smaller_and_larger() -> None:
    source = (
        "from x import Y\nA: Final = 0.5\nB = 2**3\nC = 100\nD = Y + 1\nE = 'text'\nF = True\n\ndef f():\n    G = 1\n"
    )
    assert [(name, value) for name, value, _ in constants(source)] == [("A", 0.5), ("B", 8), ("C", 100)]
    assert [neighbours(value) for value in (0.5, 8, 100)] == [(0.4, 0.625), (7, 9), (80, 125)]
