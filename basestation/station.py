"""The base station: frames become poses and the fleet's table; the kept state goes out; orders are answered.

``python -P -m basestation.station SCENARIO --state FILE``
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import math
import sys
from pathlib import Path

from basestation.fleet.state_store import StateStore
from basestation.fleet.table import FleetTable, Motion
from basestation.localization.frames import decode_frame
from basestation.localization.homography import Homography
from basestation.localization.localizer import Localizer
from basestation.localization.markers import TagDetector
from muro_zenoh import channels
from muro_zenoh.config import CameraSettings, Scenario, load_scenario
from muro_zenoh.errors import ConfigError, MessageError, TransportError
from muro_zenoh.messages import Clear, FleetSnapshot, Frame, Health, Message, PoseFix, Reply, Resume
from muro_zenoh.runtime.process import ready, run_process
from muro_zenoh.transport import Bus, Received, open_bus

log = logging.getLogger(__name__)

_KEPT_PERIOD = 0.5
_SNAPSHOT_PERIOD = 0.2
_HEALTH_PERIOD = 1.0

_RUNNING = "running"
_RIVAL_GONE = 3.0
"""Another base station that was silent for so long is gone [s]."""

_ADOPTION = 0.15
"""After a start the robots' health is heard for so long before the stop state goes out [s]: a stop that an operator
gave while no base station ran must not be contradicted by the file ..."""

_LONGEST_ADOPTION = 1.5
"""... and for so long at most, until each agent that is alive has said its health [s]."""


class Station:
    """The base station's tasks.

    Args:
        bus: the bus.
        scenario: the settings.
        state: the file of the kept state; None keeps nothing.

    Raises:
        ConfigError: a camera's points fix no homography, or the file is not a kept state.
    """

    def __init__(self, bus: Bus, scenario: Scenario, state: Path | None) -> None:
        self._bus = bus
        self._scenario = scenario
        self._table = FleetTable()
        self._kept = StateStore(scenario, state)
        self._localizers = {name: _localizer(name, camera, scenario) for name, camera in scenario.camera.items()}
        self._poses = {name: bus.publisher(channels.POSE, name) for name in scenario.robot}
        self._snapshots = bus.publisher(channels.ALL_POSITIONS)
        self._estimates = bus.latest(channels.ESTIMATE, "*")
        self._healths = bus.every(channels.HEALTH, "*", depth=256)
        self._health = bus.publisher(channels.HEALTH, "basestation")
        self._circle = bus.publisher(channels.CIRCLE)
        self._stop = bus.publisher(channels.STOP)
        self._behaviours = {name: bus.publisher(channels.BEHAVIOUR, name) for name in scenario.robot}
        self._roster = bus.roster()
        self._snapshot_at = 0.0
        self._frames = 0
        self._bad_frames = 0
        self._pictures: dict[str, bytes] = {}
        self._heard: set[str] = set()
        self._rival_at = -math.inf
        self._adopted = False

    async def run(self) -> None:
        """Run every task; one that crashes takes the base station down, and the robots stand still."""
        answer = self._bus.answer
        answer(channels.SET_CIRCLE, lambda order: self._changed(self._kept.set_circle(order), order))
        answer(channels.SET_BEHAVIOUR, lambda order: self._changed(self._kept.set_behaviour(order), order))
        answer(channels.STOP_ORDER, lambda order: self._changed(self._kept.set_stop(order), order))
        answer(channels.RESUME, lambda order: self._changed(self._resume(order), order))
        answer(channels.CLEAR, self._clear)
        async with asyncio.TaskGroup() as tasks:
            for name, camera in self._scenario.camera.items():
                tasks.create_task(self._watch(name, camera), name=f"camera {name}")
            tasks.create_task(self._keep(), name="kept state")
            tasks.create_task(self._adopt(), name="adopt stops")
            tasks.create_task(self._snapshot_by_clock(), name="snapshot")
            tasks.create_task(self._report(), name="health")

    # ---- from pixels to poses

    async def _watch(self, name: str, camera: CameraSettings) -> None:
        frames = self._bus.latest(channels.CAMERA, name)
        localizer = self._localizers[name]
        bad = False
        async for frame in frames:
            if frame.age(self._bus.clock.now()) > (channels.CAMERA.stale_after or 0.0):
                continue  # a picture of the past is no place of the present
            try:
                self._locate(name, camera, localizer, frame)
            except MessageError as error:
                self._bad_frames += 1
                if not bad:
                    log.warning("camera %s: dropped a frame: %s (said once until a good one comes)", name, error)
                bad = True
            else:
                bad = False

    def _locate(self, name: str, camera: CameraSettings, localizer: Localizer, frame: Received[Frame]) -> None:
        m = frame.message
        self._frames += 1
        if m.data == self._pictures.get(name):
            # No sensor gives the same bytes twice. The stamps are new; the places in it are not.
            raise MessageError("got the same picture as before, expected a new one: is the camera stuck?")
        self._pictures[name] = m.data
        captured = frame.captured(camera.latency)
        for sighting in localizer.locate(decode_frame(m.format, m.width, m.height, m.data)):
            x, y, theta = sighting.pose
            self._poses[sighting.name].put(
                PoseFix(stamp=m.stamp, x=x, y=y, theta=theta, covariance=sighting.covariance, camera=name)
            )
            self._table.fix(sighting.name, sighting.pose, captured)
        self._publish_snapshot()

    # ---- the table

    def _publish_snapshot(self) -> None:
        for name, estimate in self._estimates.values().items():
            m = estimate.message
            self._table.estimate(name, Motion(m.pose, m.v, m.omega, estimate.arrival - estimate.delay))
        self._snapshot_at = self._bus.clock.now()
        self._snapshots.put(FleetSnapshot(stamp=self._snapshot_at, robots=self._table.snapshot(self._snapshot_at)))

    async def _snapshot_by_clock(self) -> None:
        while True:
            silent = self._bus.clock.now() - self._snapshot_at
            if silent >= _SNAPSHOT_PERIOD:
                self._publish_snapshot()
                silent = 0.0
            await asyncio.sleep(_SNAPSHOT_PERIOD - silent)

    def _clear(self, order: Clear) -> Reply:
        if not self._table.clear(order.name):
            return Reply(accepted=False, reason=f"robot {order.name} was never seen")
        self._estimates.forget(order.name)
        return Reply(accepted=True)

    # ---- the kept state

    async def _keep(self) -> None:
        await asyncio.sleep(_ADOPTION)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_LONGEST_ADOPTION - _ADOPTION):
                while not self._roster.of("agent") <= self._heard:  # noqa: ASYNC110 - a roster and a mailbox at once
                    await asyncio.sleep(0.02)
        self._adopted = True
        while True:
            self._publish_kept()
            await asyncio.sleep(_KEPT_PERIOD)

    def _resume(self, order: Resume) -> Reply:
        if not self._adopted:  # it would lift what an operator stopped meanwhile, unseen
            return Reply(
                accepted=False,
                reason="resume: the base station has just started, and is still hearing what the robots have latched; "
                "try again in 2 s",
            )
        return self._kept.resume(order)

    def _publish_kept(self) -> None:
        if not self._adopted:
            return
        self._stop.put(self._kept.stop)
        self._circle.put(self._kept.circle)
        for name, publisher in self._behaviours.items():
            publisher.put(self._kept.behaviour(name))

    def _changed(self, reply: Reply, order: Message) -> Reply:
        log.info("%s: %s", order, "accepted" if reply.accepted else f"refused: {reply.reason}")
        if reply.accepted:
            self._publish_kept()
        return reply

    async def _adopt(self) -> None:
        """Hear what the robots latched: an operator's stop that this process never heard is kept from now on."""
        async for received in self._healths:
            health = received.message
            if health.role == "basestation" and health.epoch != self._bus.epoch:
                self._meet(health)
            if health.role != "agent":
                continue
            try:
                adopted = self._kept.adopt(received.name, health)
            except ConfigError as error:
                log.error("the stop state of %s is not kept: %s", received.name, error)
                adopted = True
            self._heard.add(received.name)
            if adopted:
                log.warning("took over the stop state of %s: %s", received.name, self._kept.stop)
                self._publish_kept()

    def _meet(self, other: Health) -> None:
        """Another base station speaks. Two would tell the robots different things in turns: who comes later leaves.

        Raises:
            TransportError: this one has come later.
        """
        if not self._adopted and (other.state == _RUNNING or other.epoch < self._bus.epoch):
            raise TransportError(
                f"realm {self._bus.realm}: got another base station on this router, expected to be the only one. "
                "End the other one first, or give this lab a [bus] realm of its own"
            )
        self._rival_at = self._bus.clock.now()

    # ---- how it is

    async def _report(self) -> None:
        while True:
            alive = self._roster.of("agent")
            missing = [name for name in self._scenario.robots if name not in alive]
            reasons = [f"no agent of {name}" for name in missing]
            if self._bus.clock.now() - self._rival_at < _RIVAL_GONE:
                reasons.insert(0, "another base station is running: end one of them")
            for camera, localizer in self._localizers.items():
                reasons += _complaints(camera, localizer)
            state = _RUNNING if self._adopted else "starting"
            numbers = {"frames": float(self._frames), "bad_frames": float(self._bad_frames), **self._bus.numbers()}
            self._health.put(Health(role="basestation", state=state, reasons=tuple(reasons), numbers=numbers))
            await asyncio.sleep(_HEALTH_PERIOD)


def _complaints(camera: str, localizer: Localizer) -> list[str]:
    """What is wrong with the tags that a camera sees."""
    out = [f"camera {camera} sees tag {tag}, and no robot has it" for tag in sorted(localizer.unknown_tags)]
    out += [f"camera {camera} sees tag {tag} twice" for tag in sorted(localizer.duplicate_tags)]
    for tag, size in sorted(localizer.misfit_tags.items()):
        out.append(f"camera {camera} sees tag {tag} {size:.3f} m large: is its tag_size right?")
    return out


def _localizer(name: str, camera: CameraSettings, scenario: Scenario) -> Localizer:
    tags = {robot.tag: (key, robot.mount) for key, robot in scenario.robot.items() if robot.tag is not None}
    try:
        detector = TagDetector(camera.family)
    except ValueError as error:
        raise ConfigError(f"camera.{name}.family", got=repr(camera.family), expected=f"a family: {error}") from error
    return Localizer(
        name,
        Homography.fit(camera.views(scenario.arena), camera=name),
        detector,
        tags,
        size=(camera.width, camera.height),
        corner_noise=camera.sigma_pixels,
    )


async def run_basestation(scenario: Scenario, state: Path | None) -> None:
    """The base station process.

    Args:
        scenario: the settings.
        state: the file of the kept state; None keeps nothing.

    Raises:
        NotConnected: no router answered.
        ConfigError: a camera's points fix no homography, or the file is not a kept state.
    """
    async with open_bus(scenario.bus, channels.Role.BASESTATION) as bus:
        station = Station(bus, scenario, state)
        bus.announce(channels.Role.BASESTATION, "basestation")
        ready("basestation")
        await station.run()


def main(arguments: list[str]) -> int:
    """``SCENARIO --state FILE``: the exit code."""
    parser = argparse.ArgumentParser(prog="basestation.station", description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--state", type=Path)
    asked = parser.parse_args(arguments)
    return run_process(lambda: run_basestation(load_scenario(asked.scenario), asked.state), "basestation")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
