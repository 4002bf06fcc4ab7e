"""Fixes and odometry in, the estimate out."""

from __future__ import annotations

import asyncio
import logging
import math

from muro_zenoh import channels
from muro_zenoh.config import RobotSettings
from muro_zenoh.estimation.pose_filter import PoseEstimate, PoseFilter
from muro_zenoh.geometry import Twist2
from muro_zenoh.messages import Calibration, Estimate, PoseFix
from muro_zenoh.transport import Bus, Received

log = logging.getLogger(__name__)

_TICK = 0.04
"""When no fix came for so long, the estimate is moved on and sent without one [s]."""

_CALIBRATION_PERIOD = 1.0


class Localize:
    """Where this robot is and how its wheels lie. The one task that runs the pose filter.

    Args:
        bus: the bus.
        name: the robot's name.
        robot: its settings.

    Attributes:
        newest: the newest estimate, for now; None before the first fix.
        fixes: fixes used since the start.
        pose_ages: from capture to the estimate that used it, of each fix since it was last emptied [s].
        arrival: when the fix behind the newest estimate came [s]; NaN when it was made by the clock.
    """

    def __init__(self, bus: Bus, name: str, robot: RobotSettings) -> None:
        self.newest: PoseEstimate | None = None
        self.fixes = 0
        self.pose_ages: list[float] = []
        self.arrival = math.nan
        self._clock = bus.clock
        self._filter = PoseFilter(limits=robot.wheels)
        self._fixes = bus.every(channels.POSE, name)
        self._odometry = bus.every(channels.ODOMETRY, name)
        self._estimate = bus.publisher(channels.ESTIMATE, name)
        self._cal_omega = bus.publisher(channels.CAL_OMEGA, name)
        self._cal_v = bus.publisher(channels.CAL_V, name)
        self._calibrated = 0.0

    def fix_age(self, now: float) -> float:
        """Time since the capture of the newest fix used [s]; infinite before the first."""
        return now - self.newest.t_fix if self.newest is not None else math.inf

    def sent(self, now: float, command: Twist2) -> None:
        """Take note of a command really sent: the filter's input when the odometry is silent."""
        self._filter.command(now, command.v, command.omega)

    async def run(self) -> None:
        """Estimate at each fix, and by the clock when none comes."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                async with asyncio.timeout_at(loop.time() + _TICK):
                    fix = await self._fixes.next()
            except TimeoutError:
                self.arrival = math.nan
            else:
                self._take(fix)
                self.arrival = fix.arrival
            self._send()

    def _take(self, fix: Received[PoseFix]) -> None:
        self._take_odometry()
        m = fix.message
        captured = fix.captured() - m.age
        result = self._filter.fix(captured, m.x, m.y, m.theta, m.covariance)
        if result.accepted:
            self.fixes += 1
            self.pose_ages.append(self._clock.now() - captured)
        if result.restarted:
            log.warning("the fixes have left the track: starting anew at (%.2f, %.2f)", m.x, m.y)

    def _take_odometry(self) -> None:
        for odometry in self._odometry.drain():
            m = odometry.message
            self._filter.twist(odometry.captured(), m.v, m.omega)

    def _send(self) -> None:
        self._take_odometry()
        now = self._clock.now()
        estimate = self._filter.at(now)
        self.newest = estimate
        if estimate is None:
            return
        self._estimate.put(
            Estimate(
                stamp=now,
                x=estimate.x,
                y=estimate.y,
                theta=estimate.theta,
                v=estimate.v,
                omega=estimate.omega,
                covariance=estimate.covariance9,
            )
        )
        if now - self._calibrated >= _CALIBRATION_PERIOD:
            self._calibrated = now
            self._cal_v.put(_calibration(estimate.s_v, estimate.sigma_v))
            self._cal_omega.put(_calibration(estimate.s_omega, estimate.sigma_omega))


def _calibration(scale: float, sigma: float) -> Calibration:
    """The factor that undoes a drive scale; its standard deviation to first order."""
    return Calibration(value=1.0 / scale, sigma=sigma / scale**2)
