"""The kept state of the lab: circle, behaviours and stop, persisted in a file.

Every change goes through here, raises the revision, and is on the disk before it is answered.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Behaviour, Health, Name, Reply, Resume, SetBehaviour, SetCircle, Stop, StopOrder, Value
from muro_zenoh.messages import Circle as CircleMessage
from muro_zenoh.safety.stop import MOST_REVISION

log = logging.getLogger(__name__)


class KeptBehaviour(Struct, frozen=True, forbid_unknown_fields=True):
    """A robot's behaviour and its parameters."""

    behaviour: str
    parameters: dict[str, Value] = {}


class KeptState(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that outlives the base station.

    Attributes:
        revision: rises with every change; the circle and the behaviours carry it.
        stop_revision: the revision of the newest change of the stop, which stop orders carry. It has one of its own,
            because a newer revision lifts a stop that robots heard straight from an operator: a change of the circle
            must not.
        x: of the circle's centre [m, world].
        y: of the circle's centre [m, world].
        radius: of the circle [m].
        clockwise: the direction of travel.
        behaviour: of each robot.
        stop_all: everybody is stopped.
        stop_names: ... or these are.
    """

    revision: Annotated[int, Meta(ge=0)] = 1
    stop_revision: Annotated[int, Meta(ge=0)] = 1
    x: float
    y: float
    radius: Annotated[float, Meta(gt=0)]
    clockwise: bool
    behaviour: dict[Name, KeptBehaviour]
    stop_all: bool = False
    stop_names: tuple[Name, ...] = ()


class StateStore:
    """The kept state and its file.

    Args:
        scenario: what holds when there is no file yet, and the limits of every order.
        path: the file; None keeps nothing beyond this process.

    Raises:
        ConfigError: the file is there and is not such a state (starting from scratch instead could lift a stop), or
            it cannot be written, as may also be said of every later change.

    Attributes:
        state: the state.
    """

    def __init__(self, scenario: Scenario, path: Path | None) -> None:
        self._scenario = scenario
        self._path = path
        self.state = _load(path) if path is not None and path.exists() else _initial(scenario)
        self._lifted = self.state.stop_revision  # what was latched before the newest resume is lifted; the rest is not
        kept, fresh = self.circle.circle, scenario.circle
        if kept.radius > self._room_for(kept) and kept != fresh:
            log.warning("the kept circle %s does not fit into this arena: taking the scenario's %s", kept, fresh)
            self._change(x=fresh.x, y=fresh.y, radius=fresh.radius, clockwise=fresh.clockwise)
        missing = {name: _behaviour(scenario, name) for name in scenario.robot if name not in self.state.behaviour}
        if missing:
            self._change(behaviour={**self.state.behaviour, **missing})

    # ---- what goes out

    @property
    def circle(self) -> CircleMessage:
        """The circle, to be published."""
        s = self.state
        return CircleMessage(x=s.x, y=s.y, radius=s.radius, clockwise=s.clockwise, revision=s.revision)

    @property
    def stop(self) -> StopOrder:
        """The stop order, to be published."""
        return StopOrder(all=self.state.stop_all, names=self.state.stop_names, revision=self.state.stop_revision)

    def behaviour(self, name: str) -> Behaviour:
        """A robot's behaviour, to be published."""
        kept = self.state.behaviour[name]
        return Behaviour(behaviour=kept.behaviour, parameters=kept.parameters, revision=self.state.revision)

    # ---- orders

    def set_circle(self, order: SetCircle) -> Reply:
        """Change the circle; refused when robots on it would leave the arena."""
        s = self.state
        new = Circle(
            s.x if order.x is None else order.x,
            s.y if order.y is None else order.y,
            s.radius if order.radius is None else order.radius,
            s.clockwise if order.clockwise is None else order.clockwise,
        )
        room = self._room_for(new)
        if new.radius > room:
            return self._refuse(
                f"circle: got {new.radius:g} m round ({new.x:g}, {new.y:g}), expected at most {max(room, 0.0):g} m "
                "there, so that the robots stay inside the arena"
            )
        self._change(x=new.x, y=new.y, radius=new.radius, clockwise=new.clockwise)
        return self._accept()

    def set_behaviour(self, order: SetBehaviour) -> Reply:
        """Change the behaviour of some robots, or of all."""
        unknown = self._unknown(order.names)
        if unknown:
            return self._refuse(unknown)
        kept = KeptBehaviour(order.behaviour, order.parameters)
        names = order.names or self._scenario.robots
        self._change(behaviour={**self.state.behaviour, **dict.fromkeys(names, kept)})
        return self._accept()

    def set_stop(self, order: Stop) -> Reply:
        """Stop some robots, or everybody. Never refused for a robot that is not in the fleet file."""
        names = tuple(sorted({*self.state.stop_names, *order.names}))
        self._add_stop(0, self.state.stop_all or not order.names, names)
        return self._accept()

    def resume(self, order: Resume) -> Reply:
        """Lift the stop of some robots, or everybody's; refused when it has changed since the operator looked."""
        if order.revision < self.state.stop_revision and (self.state.stop_all or self.state.stop_names):
            return self._refuse(
                f"resume: got revision {order.revision}, expected {self.state.stop_revision}: "
                "an order came in between; look again, then resume"
            )
        unknown = self._unknown(order.names)
        if unknown:
            return self._refuse(unknown)
        stopped = set(self.state.stop_names)
        if self.state.stop_all:
            stopped.update(self._scenario.robots)
        rest = tuple(sorted(stopped - set(order.names))) if order.names else ()
        self._keep(self._with_stop(order.revision, False, rest))
        self._lifted = self.state.stop_revision
        return self._accept()

    def adopt(self, name: str, health: Health) -> bool:
        """Take over a stop that a robot heard straight from an operator, and any newer revision; whether there was one.

        Args:
            name: of the robot.
            health: what its agent says.
        """
        s = self.state
        heard = health.stop_revision if health.stop_revision <= MOST_REVISION else s.stop_revision
        # Latched since the newest resume: other stops that were kept since have not lifted it.
        if health.stop_latched and heard >= self._lifted:
            already = s.stop_all or (not health.stop_all and name in s.stop_names)
            if already and heard <= s.stop_revision:
                return False
            names = s.stop_names if health.stop_all else tuple(sorted({*s.stop_names, name}))
            self._add_stop(heard, s.stop_all or health.stop_all, names)
            return True
        if heard > s.stop_revision:
            self._add_stop(heard, s.stop_all, s.stop_names)
            return True
        return False

    # ---- inside

    def _room_for(self, circle: Circle) -> float:
        """The largest radius [m] round a circle's centre on which every robot stays inside the arena."""
        room = self._scenario.arena.clearance(circle.x, circle.y)
        return room - max(robot.radius for robot in self._scenario.robot.values())

    def _add_stop(self, at_least: int, everybody: bool, names: tuple[str, ...]) -> None:
        self.state = self._with_stop(at_least, everybody, names)  # a stop holds even where the disk is full
        self._keep(self.state)

    def _with_stop(self, at_least: int, everybody: bool, names: tuple[str, ...]) -> KeptState:
        revision = self._next_revision(at_least)
        return msgspec.structs.replace(
            self.state, revision=revision, stop_revision=revision, stop_all=everybody, stop_names=names
        )

    def _change(self, **fields: object) -> None:
        self._keep(msgspec.structs.replace(self.state, revision=self._next_revision(), **fields))

    def _next_revision(self, at_least: int = 0) -> int:
        known = at_least if at_least <= MOST_REVISION else 0
        return max(self.state.revision, self.state.stop_revision, known) + 1

    def _keep(self, new: KeptState) -> None:
        if self._path is not None:
            _save(self._path, new)
        self.state = new

    def _unknown(self, names: Sequence[str]) -> str:
        known = self._scenario.robots
        strangers = [name for name in names if name not in known]
        return f"robot {', '.join(strangers)}: expected names out of {', '.join(known)}" if strangers else ""

    def _accept(self) -> Reply:
        return Reply(accepted=True, revision=self.state.revision)

    def _refuse(self, reason: str) -> Reply:
        return Reply(accepted=False, reason=reason, revision=self.state.revision)


def _behaviour(scenario: Scenario, name: str) -> KeptBehaviour:
    behaviour = scenario.behaviour_of(name)
    return KeptBehaviour(behaviour.name, behaviour.parameters)


def _initial(scenario: Scenario) -> KeptState:
    c = scenario.circle
    behaviours = {name: _behaviour(scenario, name) for name in scenario.robot}
    return KeptState(x=c.x, y=c.y, radius=c.radius, clockwise=c.clockwise, behaviour=behaviours)


def _load(path: Path) -> KeptState:
    try:
        return msgspec.json.decode(path.read_bytes(), type=KeptState)
    except (OSError, msgspec.MsgspecError) as error:
        raise ConfigError(
            str(path),
            got=f"a file that is no kept state: {error}",
            expected="the state that a base station wrote",
            hint="Move it away to start from the scenario; a stop order in it is then forgotten.",
        ) from error


def _save(path: Path, state: KeptState) -> None:
    """Replace the file at once: after a crash it holds the old state or the new one, never a half."""
    scratch = path.with_suffix(path.suffix + ".new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch.open("w") as file:
            json.dump(msgspec.to_builtins(state), file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        scratch.replace(path)
    except OSError as error:
        raise ConfigError(
            str(path), got=error.strerror or str(error), expected="a file to keep the lab's state in"
        ) from error
