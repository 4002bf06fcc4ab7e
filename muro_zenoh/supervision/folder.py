"""The folder of a run: its settings, its score sheet, and a log per process."""

from __future__ import annotations

import json
import time
from pathlib import Path

from muro_zenoh.config import Scenario, as_table
from muro_zenoh.errors import ConfigError
from muro_zenoh.scoring.rows import as_json
from muro_zenoh.scoring.sheet import ScoreSheet

REPORT = "report.json"
"""The file of the score sheet in the folder of a run."""

FAULTS = "faults.toml"
"""The file of what an operator broke in a run, as rows of its scenario."""

TOKENS = "page-tokens.json"
"""The file of the tokens of the page."""

_MAX_RUNS = 99


def make_run_folder(scenario: str, root: Path = Path("runs")) -> Path:
    """A new folder ``<root>/<time>-<scenario>``.

    Args:
        scenario: its name.
        root: the folder of all runs.

    Raises:
        ConfigError: it cannot be created.
    """
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{scenario}"
    for attempt in range(1, _MAX_RUNS + 1):
        folder = root / (stem if attempt == 1 else f"{stem}-{attempt}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise ConfigError(str(folder), got=error.strerror or str(error), expected="a folder to write to") from error
        return folder
    raise ConfigError(str(root / stem), got=f"{_MAX_RUNS} runs within a second", expected="fewer")


def write_scenario(scenario: Scenario, folder: Path) -> Path:
    """Write the resolved scenario that the processes of a run read.

    Args:
        scenario: the scenario.
        folder: of the run.

    Returns:
        The file.
    """
    path = folder / "scenario.json"
    path.write_text(json.dumps({"name": scenario.name, **as_table(scenario)}, indent=1) + "\n")
    return path


def write_event(text: str, folder: Path) -> None:
    """Append what `muro run` itself reports, with the time, to its log.

    Args:
        text: one event; it may have several lines.
        folder: of the run.
    """
    now = time.time()
    with (folder / "muro.log").open("a") as log:
        log.write(f"{time.strftime('%H:%M:%S', time.localtime(now))}.{int(1000 * now) % 1000:03d} {text}\n")


def write_report(sheet: ScoreSheet, path: Path) -> None:
    """Write a score sheet as JSON.

    Args:
        sheet: the score sheet.
        path: the file.
    """
    path.write_text(json.dumps(as_json(sheet), indent=1) + "\n")
