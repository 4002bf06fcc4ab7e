"""Which faults can befall the processes of a run, and which processes each of them befalls."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from muro_zenoh.config import Scenario
from muro_zenoh.config.faults import OF_THE_ROOM, RUN_KINDS, CameraDropoutFault, Fault, LinkFault, Place
from muro_zenoh.errors import ConfigError

_TCP: Final = "the link is a TCP connection, which loses, duplicates and reorders nothing"
_CLOCK: Final = "all processes have the clock of this machine"
_IMPOSSIBLE: Final[Mapping[str, str]] = {
    "loss": _TCP,
    "duplicate": _TCP,
    "reorder": _TCP,
    "clock_offset": _CLOCK,
    "clock_step": _CLOCK,
}
_CHECK: Final = "`muro check` applies every kind of fault, to fleets in memory."


def camera_process(camera: str) -> str:
    """The name of the process of a simulated camera; no robot can have it.

    Args:
        camera: the camera's name.
    """
    return f"camera-{camera}"


def cameras_apart(scenario: Scenario) -> bool:
    """Whether the cameras need processes of their own, because a fault befalls one of them.

    Args:
        scenario: the scenario.
    """
    return any(
        fault.place in (Place.CAMERA, Place.CAMERAS) and fault.kind not in OF_THE_ROOM for fault in scenario.faults
    )


def befallen(fault: Fault, scenario: Scenario) -> tuple[str, ...]:
    """The names of the processes that a fault befalls; for one of a link, the processes whose links it befalls.

    Args:
        fault: the fault.
        scenario: the scenario.
    """
    cameras = tuple(map(camera_process, scenario.camera))
    if fault.place is Place.AGENT:
        return (fault.robot,)
    if fault.place is Place.CAMERA:
        return (camera_process(fault.target.partition("/")[2]),)
    if fault.place is Place.CAMERAS:
        return cameras
    if fault.place is Place.ROUTER and isinstance(fault, LinkFault):
        return (*scenario.robots, "basestation", "simulator", *(cameras if cameras_apart(scenario) else ()))
    return (str(fault.place),)


def relayed(scenario: Scenario) -> tuple[str, ...]:
    """The names of the processes that need a relay, because a fault befalls their link.

    Args:
        scenario: the scenario.
    """
    links = [befallen(fault, scenario) for fault in scenario.faults if isinstance(fault, LinkFault)]
    return tuple(dict.fromkeys(name for names in links for name in names))


def check_faults(scenario: Scenario, file: str, connect: str | None = None) -> None:
    """Refuse faults that cannot befall processes on this machine.

    Args:
        scenario: the scenario.
        file: its file, for errors.
        connect: endpoint of a running router; None when the run has its own.

    Raises:
        ConfigError: the first such fault, with the reason.
    """
    for number, fault in enumerate(scenario.faults):
        check_fault(fault, scenario, f"{file}: fault[{number}]", connect)


def check_fault(fault: Fault, scenario: Scenario, where: str, connect: str | None = None) -> None:
    """Refuse a fault that cannot befall a run on this machine.

    Args:
        fault: the fault.
        scenario: the scenario.
        where: where it is written, for errors.
        connect: endpoint of a running router; None when the run has its own.

    Raises:
        ConfigError: it cannot, with the reason.
    """
    if fault.kind not in RUN_KINDS:
        reason = _IMPOSSIBLE.get(fault.kind, "it can only be simulated")
        raise ConfigError(
            f"{where}.kind",
            got=f"{fault.kind!r}, which cannot befall processes: {reason}",
            expected=f"one of {', '.join(RUN_KINDS)} in `muro run`",
            hint=_CHECK,
        )
    if fault.kind in OF_THE_ROOM:
        _check_room(fault, scenario, where)
    elif fault.place in (Place.ROBOT, Place.BASE):
        raise ConfigError(
            f"{where}.target",
            got=f"{fault.target!r}, but one simulator runs the bases of all robots",
            expected=f"'{fault.robot}/agent' in `muro run`",
            hint=_CHECK,
        )
    elif connect is not None:
        _check_router(fault, where, connect)


def _check_room(fault: Fault, scenario: Scenario, where: str) -> None:
    """A robot is hidden from cameras by nobody, and a camera with a process of its own is not in the simulator."""
    if isinstance(fault, CameraDropoutFault) and fault.robot:
        raise ConfigError(f"{where}.target", got=repr(fault.target), expected="a camera in `muro run`", hint=_CHECK)
    if isinstance(fault, CameraDropoutFault) and cameras_apart(scenario):
        raise ConfigError(
            f"{where}.kind",
            got=f"{fault.kind!r} beside a fault of a camera's process",
            expected="only one of the two in a run",
            hint="Freeze the camera's process: it gives no pictures either.",
        )


def _check_router(fault: Fault, where: str, connect: str) -> None:
    if isinstance(fault, LinkFault):
        if re.fullmatch(r"tcp/[^/?#]+:\d+", connect) is None:
            raise ConfigError(
                "--connect",
                got=f"{connect}, which a fault of a link cannot be put between",
                expected="an endpoint tcp/HOST:PORT",
            )
    elif fault.place is Place.ROUTER:
        raise ConfigError(
            f"{where}.target",
            got=f"'router', which is not a process of this run: --connect {connect}",
            expected="a process that this run starts",
        )
