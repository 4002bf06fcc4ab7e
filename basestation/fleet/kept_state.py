"""The kept state as a value, and what each order makes of it. No file, no clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from muro_zenoh.behaviours.circle import require_room
from muro_zenoh.behaviours.interface import Vehicle
from muro_zenoh.config import Scenario, check_settings
from muro_zenoh.errors import ConfigError, OrderRefused, ParameterError
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import MOST_NAMES, Health, Lease, Name, Resume, SetBehaviour, SetCircle, Value
from muro_zenoh.safety.stop import MAX_REVISION, may_be_of_count


class KeptBehaviour(Struct, frozen=True, forbid_unknown_fields=True):
    """A robot's behaviour.

    Attributes:
        behaviour: its name.
        parameters: its own.
        revision: of the kept state when it was ordered; 0 when the scenario says so. A robot whose behaviour has failed
            starts it again at another one, and not because something else has changed.
    """

    behaviour: str
    parameters: dict[str, Value] = {}
    revision: Annotated[int, Meta(ge=0)] = 0

    def is_like(self, other: KeptBehaviour) -> bool:
        """Whether two robots do the same, whenever that was ordered.

        Args:
            other: the other robot's.
        """
        return (self.behaviour, self.parameters) == (other.behaviour, other.parameters)


class KeptState(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that outlives the base station.

    Attributes:
        revision: rises with every change; the circle carries it, and each behaviour the one at which it was ordered.
        stop_revision: the revision of the newest change of the stop, which stop orders carry. It has one of its own,
            because a newer revision lifts a stop that robots received straight from an operator: a change of the circle
            must not.
        lifted_revision: the stop revision of the newest resume. What robots latched before it is lifted; what they
            latched since is not, whatever other stops were kept in between, and however often this process restarted.
        circle: the circle to follow.
        behaviour: of each robot.
        stop_all: everybody is stopped.
        stop_names: ... or these are.
        leases: who may order which robots.
    """

    revision: Annotated[int, Meta(ge=0)] = 1
    stop_revision: Annotated[int, Meta(ge=0)] = 1
    lifted_revision: Annotated[int, Meta(ge=0)] = 0
    circle: Circle
    behaviour: dict[Name, KeptBehaviour]
    stop_all: bool = False
    stop_names: tuple[Name, ...] = ()
    leases: tuple[Lease, ...] = ()

    @classmethod
    def initial(cls, scenario: Scenario) -> KeptState:
        """What holds when nothing was ever kept.

        Args:
            scenario: the settings.
        """
        behaviours = {name: _initial_behaviour(scenario, name) for name in scenario.robot}
        return cls(circle=scenario.circle, behaviour=behaviours)

    def fitted_to(self, scenario: Scenario) -> KeptState:
        """This state for another scenario than it was kept for: with its robots, a circle that fits its arena, and
        behaviours that they can do there.

        Args:
            scenario: the settings; a circle or behaviour that does not fit is replaced by theirs.

        Returns:
            This very state when it fits.
        """
        new = self
        if new._next_revision(0) > MAX_REVISION:
            # No robot would believe it. A new count is far behind whatever they have received, and so it is newer.
            new = msgspec.structs.replace(new, revision=1, stop_revision=1, lifted_revision=0)
        has_room = self.circle == scenario.circle or _has_room(self.circle, scenario)
        fitted = new._on(self.circle if has_room else scenario.circle, scenario)
        if fitted._refused(scenario):  # not even the scenario's own behaviours fit on this circle
            fitted = new._on(scenario.circle, scenario)
        if (fitted.circle, fitted.behaviour) == (self.circle, self.behaviour):
            return new
        return new._changed(circle=fitted.circle, behaviour=fitted.behaviour)

    # ---- orders

    def with_circle(self, order: SetCircle, scenario: Scenario) -> KeptState:
        """The state with another circle.

        Args:
            order: what is None stays as it is.
            scenario: the settings.

        Raises:
            OrderRefused: robots on the circle would leave the arena, or their behaviours do not fit on it.
        """
        asked = {
            field.name: value
            for field in dataclasses.fields(Circle)
            if (value := getattr(order, field.name)) is not None
        }
        try:
            circle = dataclasses.replace(self.circle, **asked)
            require_room(circle, _fleet(scenario, scenario.robots))
        except ParameterError as error:
            raise OrderRefused(str(error)) from None
        new = self._changed(circle=circle)
        new._require_feasible(scenario)
        return new

    def with_behaviour(self, order: SetBehaviour, scenario: Scenario) -> KeptState:
        """The state with another behaviour of the robots that the order names, or of all.

        Args:
            order: the order.
            scenario: the settings.

        Raises:
            OrderRefused: a robot that the settings do not have, no such behaviour, or one that they cannot do.
        """
        _check_names(order.names, scenario)
        kept = KeptBehaviour(order.behaviour, order.parameters, self._next_revision(0))
        new = self._changed(behaviour={**self.behaviour, **dict.fromkeys(order.names or scenario.robots, kept)})
        new._require_feasible(scenario)
        return new

    def with_stop(self, names: Iterable[str], *, everybody: bool, above: int = 0) -> KeptState:
        """The state with a stop added to those that hold.

        Args:
            names: the robots to stop.
            everybody: stop all robots.
            above: its revision is above this one, too, unless that is far ahead.
        """
        return self._stopping(self.stop_all or everybody, {*self.stop_names, *names}, above)

    def resumed(self, order: Resume, scenario: Scenario) -> KeptState:
        """The state with the stop of some robots lifted, or everybody's.

        Args:
            order: the order.
            scenario: the settings.

        Raises:
            OrderRefused: the stop has changed since the operator looked, or a robot that neither is stopped nor in the
                settings.
        """
        if order.revision < self.stop_revision and (self.stop_all or self.stop_names):
            raise OrderRefused(
                f"resume: got revision {order.revision}, expected {self.stop_revision}: "
                "an order came in between; look again, then resume"
            )
        # Any name can be stopped, so any that is can be resumed.
        _check_names([name for name in order.names if name not in self.stop_names], scenario)
        stopped = {*self.stop_names, *(scenario.robots if self.stop_all else ())}
        new = self._stopping(False, stopped - set(order.names) if order.names else (), order.revision)
        return msgspec.structs.replace(new, lifted_revision=new.stop_revision)

    def adopting(self, name: str, health: Health) -> KeptState:
        """The state with the stops that a robot received straight from an operator, or with a newer revision than this.

        The stops of other robots count as well: one of them may have restarted and forgotten its own.

        A newer revision is taken as it is: our next order is then newer than what the robots know. One is added only
        together with a stop that somebody does not hold yet, so two base stations whose states the robots hear in turn
        agree after a few of them, instead of overtaking each other for ever.

        Args:
            name: of the robot.
            health: what its agent reports.

        Returns:
            This very state when there is nothing new.
        """
        known = self.stop_revision
        latched = health.stop_revision if self._is_near(health.stop_revision) else known
        everybody = health.stop_latched and health.stop_all
        names = {*health.stop_names, *((name,) if health.stop_latched and not everybody else ())}
        is_new = not self.stop_all and (everybody or not names <= set(self.stop_names))
        # At revision 0 it has received no state since it started, so it cannot have missed a resume either.
        if is_new and (latched >= self.lifted_revision or latched == 0):
            return self.with_stop(names, everybody=everybody, above=latched)
        if latched <= known:
            return self
        if not health.stop_latched and (self.stop_all or name in self.stop_names):
            # It has to receive the stop, which is older than what it knows.
            return self.with_stop((), everybody=False, above=latched)
        return msgspec.structs.replace(self, stop_revision=latched)

    # ---- inside

    def _on(self, circle: Circle, scenario: Scenario) -> KeptState:
        """The state on a circle, with the scenario's behaviour for robots that have none or cannot do theirs there."""
        initial = KeptState.initial(scenario).behaviour
        new = msgspec.structs.replace(self, circle=circle, behaviour={**initial, **self.behaviour})
        unfit = {name: initial[name] for names, _ in new._refused(scenario) for name in names}
        return msgspec.structs.replace(new, behaviour={**new.behaviour, **unfit})

    def _require_feasible(self, scenario: Scenario) -> None:
        """Refuse behaviours that their robots cannot do together on this circle; users' own are not checked."""
        for _, error in self._refused(scenario):
            raise OrderRefused(str(error))

    def _refused(self, scenario: Scenario) -> list[tuple[list[str], ConfigError]]:
        """The robots that cannot do together on this circle what they all do, and why."""
        groups: list[tuple[KeptBehaviour, list[str]]] = []
        for name in scenario.robots:
            kept = self.behaviour[name]
            names = next((names for other, names in groups if other.is_like(kept)), None)
            if names is None:
                groups.append((kept, [name]))
            else:
                names.append(name)
        refused = []
        for kept, names in groups:
            try:
                check_settings(kept.behaviour, kept.parameters, "", _fleet(scenario, names), self.circle)
            except ConfigError as error:
                refused.append((names, error))
        return refused

    def _stopping(self, everybody: bool, names: Iterable[str], above: int) -> KeptState:
        revision, names = self._next_revision(above), set(names)
        if len(names) > MOST_NAMES:  # no order can say so many: then it is everybody
            everybody, names = True, set()
        return msgspec.structs.replace(
            self, revision=revision, stop_revision=revision, stop_all=everybody, stop_names=tuple(sorted(names))
        )

    def _changed(self, **fields: object) -> KeptState:
        return msgspec.structs.replace(self, revision=self._next_revision(0), **fields)

    def _next_revision(self, above: int) -> int:
        return max(self.revision, self.stop_revision, above if self._is_near(above) else 0) + 1

    def _is_near(self, revision: int) -> bool:
        """Whether somebody else's revision may be of this count; the robots take any of ours for newer than one that is
        far ahead of it."""
        return may_be_of_count(revision, max(self.revision, self.stop_revision))


def _fleet(scenario: Scenario, names: Iterable[str]) -> list[Vehicle]:
    return [scenario.vehicle(name) for name in names]


def _has_room(circle: Circle, scenario: Scenario) -> bool:
    try:
        require_room(circle, _fleet(scenario, scenario.robots))
    except ParameterError:
        return False
    return True


def _check_names(names: Sequence[str], scenario: Scenario) -> None:
    unknown = [name for name in names if name not in scenario.robot]
    if unknown:
        raise OrderRefused(f"robot {', '.join(unknown)}: expected names out of {', '.join(scenario.robots)}")


def _initial_behaviour(scenario: Scenario, name: str) -> KeptBehaviour:
    behaviour = scenario.behaviour_of(name)
    return KeptBehaviour(behaviour.name, behaviour.parameters)
