"""The messages that a control loop sends, made from its values."""

from __future__ import annotations

import math
from typing import Any, Final

from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Intent
from muro_zenoh.channels import Channel
from muro_zenoh.errors import ParameterError
from muro_zenoh.estimation.pose_filter import PoseEstimate
from muro_zenoh.messages import Calibration, Cell, Estimate, Message, PlannedPath, SpeedReference

Outgoing = list[tuple[Channel[Any], Message]]
"""Messages to send, each under this robot's name."""

NO_PATH: Final[Outgoing] = [(channels.PATH, PlannedPath(x=0.0, y=0.0, theta=0.0, segments=()))]
NO_CELL: Final[Outgoing] = [(channels.CELL, Cell(corners=(), x=0.0, y=0.0))]
"""End what :func:`shown` has shown. Both are kept for late joiners, so a path that is over would be shown forever."""


def shown(intent: Intent) -> Outgoing:
    """What others see of an intent.

    Args:
        intent: the intent.

    Raises:
        ParameterError: one that cannot be driven or sent.
    """
    if intent.twist is not None and not all(map(math.isfinite, intent.twist)):
        raise ParameterError("twist", got=repr(intent.twist), expected="finite numbers [m/s, rad/s]")
    out: Outgoing = []
    if intent.speed is not None:
        out.append((channels.VELOCITY, SpeedReference(speed=intent.speed)))
    if intent.path is not None:
        x, y, theta = intent.path.start
        segments = tuple((segment.length, segment.curvature) for segment in intent.path.segments)
        path = PlannedPath(x=x, y=y, theta=theta, segments=segments, goal_theta=intent.path_has_heading)
        out.append((channels.PATH, path))
    if intent.cell is not None:
        out.append((channels.CELL, Cell(corners=intent.cell.corners, x=intent.cell.x, y=intent.cell.y)))
    return out


def estimate_message(now: float, estimate: PoseEstimate) -> Estimate:
    """An estimate as others see it.

    Args:
        now: its time [s].
        estimate: the estimate.
    """
    return Estimate(
        stamp=now,
        x=estimate.x,
        y=estimate.y,
        theta=estimate.theta,
        v=estimate.v,
        omega=estimate.omega,
        covariance=estimate.covariance9,
    )


def calibrations(estimate: PoseEstimate) -> Outgoing:
    """The factors that correct the drive scales, each with its standard deviation to first order.

    Args:
        estimate: the estimate.
    """
    rows = (
        (channels.CAL_V, estimate.s_v, estimate.sigma_v),
        (channels.CAL_OMEGA, estimate.s_omega, estimate.sigma_omega),
    )
    return [(channel, Calibration(value=1.0 / scale, sigma=sigma / scale**2)) for channel, scale, sigma in rows]
