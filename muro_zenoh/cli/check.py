"""``muro check``: many simulated fleets with faults, in virtual time, and the promises that each must keep."""

from __future__ import annotations

import os
import shlex
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.behaviours.entry_points import BEHAVIOURS
from muro_zenoh.cli.options import assignments, example
from muro_zenoh.errors import INTERRUPTED, ConfigError, MissingExtra

if TYPE_CHECKING:
    from muro_zenoh.checking.check import Report
    from muro_zenoh.checking.judgement import Breach
    from muro_zenoh.checking.record import Record
    from muro_zenoh.checking.trial import Result
    from muro_zenoh.config import Scenario

_NEWEST = -1
"""What ``--replay`` without a number means: the seed of ``--seed``."""


def _seed(context: click.Context, option: click.Parameter, text: str | None) -> int | None:
    """The seed of ``--replay``."""
    if not text:
        return None if text is None else _NEWEST
    if not text.isdecimal():
        raise click.BadParameter(f"got {text!r}, expected a seed: 0 or more")
    return int(text)


@click.command(
    epilog=example(
        "muro check random --trials 1000",
        "muro check mine.toml --quick",
        "muro check flock.py:flock --trials 200",
        "muro check random --replay 17",
        "muro check random --replay 17 --shrink --out breach",
    )
)
@click.argument("what")
@click.option(
    "--trials", type=click.IntRange(min=1), default=100, show_default=True, metavar="N", help="Number of trials."
)
@click.option("--jobs", type=click.IntRange(min=1), metavar="J", help="Number of processes.  [default: the cores]")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    metavar="S",
    help="Seed of the first trial; the others have the following ones.",
)
@click.option("--quick", is_flag=True, help="Short trials of few robots without faults: may this behaviour drive?")
@click.option(
    "--replay",
    callback=_seed,
    is_flag=False,
    flag_value="",
    metavar="[SEED]",
    help="Run the trial of one seed again (without SEED: of --seed), and tell what happened.",
)
@click.option("--first", is_flag=True, help="End with the first trial that breaks a promise.")
@click.option("--shrink", is_flag=True, help="Find the fewest faults and robots that still break the promise.")
@click.option("--robots", type=click.IntRange(min=1), metavar="N", help="Number of robots.  [default: the scenario's]")
@click.option(
    "--duration",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Virtual duration of a trial [s].  [default: 30, or 10 with --quick]",
)
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override a setting of the scenario; repeatable."
)
@click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Also write JSON."
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Folder for pictures of a breach.  [default: runs/<time>-check-<what>]",
)
def check(
    what: str,
    trials: int,
    jobs: int | None,
    seed: int,
    quick: bool,
    replay: int | None,
    first: bool,
    shrink: bool,
    robots: int | None,
    duration: float | None,
    settings: tuple[str, ...],
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Check WHAT in many simulated fleets: `random`, a built-in scenario, a TOML file, or FILE.py[:function].

    Each trial is a whole fleet (agents, bases, base station) in virtual time, with a start, faults and noise of its own
    seed, and two random faults, unless WHAT has faults, orders or starts itself. docs/checking.md has the promises.

    The exit code is 0 when every promise was kept, 1 when one was broken, 2 for invalid input, 130 when Ctrl-C (or
    SIGTERM) ended the check early and nothing was broken until then. What was done until then is reported.
    """
    from muro_zenoh.checking.check import Plan, quiet, run_check
    from muro_zenoh.checking.source import trials_of
    from muro_zenoh.supervision.preflight import check_own_packages

    check_own_packages()
    if json_file is not None and not os.access(json_file.parent, os.W_OK):
        raise ConfigError(
            "--json", got=f"{json_file}, whose folder cannot be written to", expected="a file that can be written"
        )
    trial = trials_of(what, robots=robots, duration=duration, quick=quick, overrides=assignments(settings, "--set"))
    again = " ".join(["muro check", what, *_options(quick, robots, duration, settings), "--replay"])
    chosen = seed if replay == _NEWEST else replay
    if chosen is not None:
        with quiet():
            raise SystemExit(_replay(what, trial(chosen), chosen, out, shrink, again))

    from muro_zenoh.checking.summary import write_json

    random = trial.scenario is None
    plan = Plan(trial, trials, seed, jobs or os.cpu_count() or 1, covers=random, all_count=not random, first=first)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with _screen(trials) as screen:
        report = run_check(plan, screen)
    if json_file is not None:
        write_json(report, json_file)
    _print(report, again, quick)
    if report.broken:
        worst = report.broken[0]
        with quiet():
            _replay(what, trial(worst.seed), worst.seed, out, shrink, again, brief=True)
    raise SystemExit(1 if report.broken else INTERRUPTED if report.interrupted else 0 if report.passed else 1)


def _options(quick: bool, robots: int | None, duration: float | None, settings: tuple[str, ...]) -> list[str]:
    """The options that a replay needs as well."""
    options = ["--quick"] if quick else []
    options += [f"--robots {robots}"] if robots is not None else []
    options += [f"--duration {duration:g}"] if duration is not None else []
    return options + [f"--set {setting}" for setting in settings]


def _print(report: Report, again: str, quick: bool) -> None:
    from muro_zenoh.checking.summary import coverage_text, quick_verdict, summary

    if quick:
        click.echo(quick_verdict(report, again))
        return
    if report.plan.covers:
        click.echo(coverage_text(report) + "\n")
    click.echo(summary(report, again))


def _replay(
    what: str, scenario: Scenario, seed: int, out: Path | None, shrink: bool, again: str, brief: bool = False
) -> int:
    """Run one trial again; pictures and the smallest trial go to a folder."""
    from muro_zenoh.checking.picture import story
    from muro_zenoh.checking.trial import run_trial

    record, result = run_trial(scenario, seed)
    if not brief:
        click.echo("\n".join(story(record, result.breaches)))
        click.echo(f"seed {seed}: {result.breaches[0] if result.breaches else 'no promise broken'}")
    if not result.breaches:
        return 0
    folder = _folder(what, out)
    _draw(record, result.breaches, folder / f"seed-{seed}")
    if shrink:
        _shrink(record, result, folder / f"seed-{seed}.toml")
    return 1


def _draw(record: Record, breaches: tuple[Breach, ...], stem: Path) -> None:
    from muro_zenoh.checking.animation import write_animation
    from muro_zenoh.checking.picture import draw_breach

    animation = stem.with_name(f"{stem.name}-animation.svg")
    write_animation(record, breaches, animation)
    click.echo(f"animation: {animation}")
    try:
        draw_breach(record, breaches[0], stem.with_suffix(".png"))
        click.echo(f"picture: {stem.with_suffix('.png')}")
    except MissingExtra as error:
        click.echo(f"no picture: {error}")


def _shrink(record: Record, result: Result, path: Path) -> None:
    from muro_zenoh.checking.minimal import breach_of, minimal, with_starts
    from muro_zenoh.config.writing import as_toml
    from muro_zenoh.wording import counted

    breach = result.breaches[0]
    click.echo("shrinking ...")
    least = minimal(with_starts(record), record.seed, breach, breach_of(breach.promise))
    scenario = least.scenario
    parts = f"{counted(len(scenario.faults), 'fault')}, {counted(len(scenario.robots), 'robot')}"
    text = (
        f"# {least.breach}: {parts}, {scenario.duration:g} s, after {counted(least.runs, 'run')}.\n"
        f"#\n#     {_search_path(scenario)}muro check {path} --replay {least.seed}\n{as_toml(scenario)}"
    )
    path.write_text(text, encoding="utf-8")
    click.echo(f"{text}\nscenario: {path}")


def _search_path(scenario: Scenario) -> str:
    """What a command needs before it so that a user's own behaviours are found, which are not beside the new file."""
    folders = os.environ.get(BEHAVIOURS, "")
    own = any(":" in scenario.behaviour_of(name).name for name in scenario.robots)
    return f"PYTHONPATH={shlex.quote(folders)} " if own and folders else ""


def _folder(what: str, out: Path | None) -> Path:
    from muro_zenoh.supervision.folder import make_run_folder

    if out is None:
        return make_run_folder(f"check-{Path(what.partition(':')[0]).stem}")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError("--out", got=f"{out} ({error.strerror})", expected="a folder that can be written") from None
    return out


def _screen(trials: int) -> Any:
    from muro_zenoh.cli.progress import CheckScreen

    return CheckScreen(trials)
