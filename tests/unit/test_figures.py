"""The figures: all of them are drawn, the same each time, from the table and the laws that the fleet runs on."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from muro_zenoh.channels import CHANNELS, VERBS
from muro_zenoh.cli.main import main
from muro_zenoh.control.circle import CIRCLE_LAWS
from muro_zenoh.control.pursuit import PURSUIT_LAWS
from muro_zenoh.errors import ConfigError, MissingExtra, MuroError
from muro_zenoh.figures.catalogue import FIGURES, draw
from muro_zenoh.figures.simulation import Effort
from muro_zenoh.figures.topics import flows

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "laws.md"
QUICK = Effort(starts=4, trials=2, share=0.02)


def one(out: Path, name: str, file_format: str = "png") -> bytes:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    [(drawn, path)] = draw(out, [name], file_format, QUICK)
    assert drawn == name
    assert path == out / f"{name}.{file_format}"
    return path.read_bytes()


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name: str, tmp_path: Path) -> None:
    picture = cv2.imdecode(np.frombuffer(one(tmp_path, name), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    height, width = picture.shape
    assert 550 < width < 1500  # 200 dots an inch; a journal's column to its page
    assert 0.25 * width < height < 1.5 * width
    assert 0.01 < (picture < 200).mean() < 0.5, "nothing but white, or hardly any"
    # from edge to edge, not in a corner
    rows, columns = np.nonzero(picture < 200)
    assert rows.max() - rows.min() > 0.8 * height
    assert columns.max() - columns.min() > 0.8 * width


@pytest.mark.parametrize("name", ["seed000_fig4", "seed000_fig8"])
def test_figures_are_reproducible(name: str, tmp_path: Path) -> None:
    assert one(tmp_path / "a", name, "svg") == one(tmp_path / "b", name, "svg")


def test_an_unknown_figure_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'fig9'.*seed000_fig1.*coverage_cells"):
        next(draw(tmp_path, ["fig9"]))


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'gif'.*svg or png"):
        next(draw(tmp_path, file_format="gif"))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    (tmp_path / "file").write_text("")
    with pytest.raises(MuroError, match=r"file/deeper.*--out"):
        next(draw(tmp_path / "file" / "deeper"))


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "seed001_wheel_speeds.png").mkdir()
    with pytest.raises(MuroError, match=r"seed001_wheel_speeds\.png.*--out"):
        one(tmp_path, "seed001_wheel_speeds")


def test_without_matplotlib_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtra, match=r"pip install 'muro-zenoh\[figures\]'"):
        next(draw(tmp_path))


def test_the_command_lists_what_it_has_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    result = CliRunner().invoke(main, ["figures", "--out", str(tmp_path), "--only", "seed001_wheel_speeds"])
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f"[1/1] {tmp_path / 'seed001_wheel_speeds.svg'}")
    assert (tmp_path / "seed001_wheel_speeds.svg").read_bytes().startswith(b"<?xml")


def test_the_command_lists_the_figures() -> None:
    result = CliRunner().invoke(main, ["figures", "--list"])
    assert [line.split()[0] for line in result.output.splitlines()] == list(FIGURES)


def test_the_command_reports_a_wrong_name_in_one_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["figures", "--out", str(tmp_path), "--only", "fig9"])
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_the_flow_shows_every_channel() -> None:
    keys = {row.key.partition("/")[0] for row in flows()}
    orders = {verb.word if verb.named else str(verb.answered_by) for verb in VERBS}
    assert keys == {channel.word for channel in CHANNELS} | orders


@pytest.mark.parametrize("law", [*CIRCLE_LAWS, *PURSUIT_LAWS])
def test_the_page_of_laws_names_every_law(law: str) -> None:
    assert f"`{law}`" in PAGE.read_text(encoding="utf-8")


def test_the_page_of_laws_shows_every_figure() -> None:
    shown = re.findall(r"\]\(figures/([^)]+)\.(?:svg|png)\)", PAGE.read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(FIGURES)
    for name in shown:
        files = list((PAGE.parent / "figures").glob(f"{name}.*"))
        assert len(files) == 1, name
        assert files[0].stat().st_size < 300_000, name
