"""What a robot's health and odometry say of a stop."""

from __future__ import annotations

import math

import msgspec
import pytest

from muro_zenoh.messages import Health, Odometry
from muro_zenoh.orders.receipt import RobotWatch, StopReceipt, StopStatus
from muro_zenoh.transport import Received

ORDERED = 1000.0


class Watched:
    """A watch, and what comes in at a time after the order [s]."""

    def __init__(self) -> None:
        self.watch = RobotWatch(ORDERED)

    def health(self, after: float, *, latched: bool, delay: float = 0.0) -> None:
        message = Health(role="agent", state="x", stop_latched=latched)
        self.watch.take_health(Received("r1", message, ORDERED + after, delay, 0.0))

    def odometry(
        self, after: float, x: float, v: float, omega: float = 0.0, *, epoch: int = 1, late: float = 0.0
    ) -> None:
        message = Odometry(x=x, y=0.0, theta=0.0, v=v, omega=omega, epoch=epoch)
        self.watch.take_odometry(Received("r1", message, ORDERED + after, late, 0.0))

    def receipt(self, after: float, *, alive: bool = True) -> StopReceipt:
        return self.watch.receipt(ORDERED + after, alive=alive)


def test_a_robot_that_has_latched_and_stands() -> None:
    robot = Watched()
    robot.odometry(0.02, 0.0, 0.2)
    robot.health(0.03, latched=True)
    robot.odometry(0.06, 0.008, 0.1)
    robot.odometry(0.10, 0.010, 0.0)
    robot.odometry(0.14, 0.010, 0.0)
    assert robot.receipt(0.5) == StopReceipt(
        StopStatus.STOPPED, pytest.approx(0.03), pytest.approx(0.10), pytest.approx(0.2 * 0.02 + 0.010), None
    )


@pytest.mark.parametrize(
    ("v", "omega", "status"),
    [
        (0.005, 0.02, StopStatus.STOPPED),
        (-0.006, 0.0, StopStatus.MOVING),
        (0.0, -0.03, StopStatus.MOVING),
        (math.nan, 0.0, StopStatus.MOVING),
    ],
)
def test_rest_is_what_encoders_at_rest_may_report(v: float, omega: float, status: StopStatus) -> None:
    robot = Watched()
    robot.health(0.0, latched=True)
    robot.watch.take_odometry(Received("r1", odometry(v, omega), ORDERED + 0.04, 0.0, 0.0))
    assert robot.receipt(0.05).status is status


def odometry(v: float, omega: float) -> Odometry:
    """A message with numbers that are not checked."""
    message = Odometry(x=0.0, y=0.0, theta=0.0, v=0.0, omega=omega)
    msgspec.structs.force_setattr(message, "v", v)
    return message


def test_one_that_nothing_was_heard_of_has_been_silent_since_the_order() -> None:
    robot = Watched()
    assert robot.receipt(1.2) == StopReceipt(StopStatus.UNCONFIRMED, None, None, None, pytest.approx(1.2))
    robot.health(0.3, latched=True)
    assert robot.receipt(1.2).status is StopStatus.NO_ODOMETRY
    assert robot.receipt(1.2).silent == pytest.approx(1.2)


def test_wheels_that_turn_again_do_not_stand() -> None:
    robot = Watched()
    robot.health(0.0, latched=True)
    robot.odometry(0.04, 0.0, 0.0)
    robot.odometry(0.08, 0.01, 0.3)
    assert robot.receipt(0.1).status is StopStatus.MOVING
    robot.odometry(0.12, 0.02, 0.0)
    assert robot.receipt(0.2).at_rest == pytest.approx(0.12)


def test_wheels_that_fall_silent_are_not_known_to_stand() -> None:
    robot = Watched()
    robot.health(0.0, latched=True)
    robot.odometry(0.04, 0.0, 0.0)
    assert robot.receipt(0.54).status is StopStatus.STOPPED
    assert robot.receipt(0.55).status is StopStatus.NO_ODOMETRY
    assert robot.receipt(0.55).silent == pytest.approx(0.51)


def test_odometry_that_comes_late_is_as_old_as_it_is() -> None:
    robot = Watched()
    robot.health(0.0, latched=True)
    robot.odometry(2.0, 0.0, 0.0, late=1.0)
    assert robot.receipt(2.0).status is StopStatus.NO_ODOMETRY


def test_a_robot_that_is_resumed_meanwhile_has_not_confirmed() -> None:
    robot = Watched()
    robot.odometry(0.0, 0.0, 0.0)
    robot.health(0.1, latched=True)
    robot.health(0.2, latched=False)
    receipt = robot.receipt(0.2)
    assert (receipt.status, receipt.latched) == (StopStatus.UNCONFIRMED, None)
    robot.health(0.3, latched=True)
    assert robot.receipt(0.3).latched == pytest.approx(0.3)


def test_another_base_begins_at_another_place() -> None:
    robot = Watched()
    robot.odometry(0.0, 0.0, 0.1)
    robot.odometry(0.04, 0.004, 0.1)
    robot.odometry(0.5, 7.0, 0.0, epoch=2)
    assert robot.receipt(0.5).travelled == pytest.approx(0.004)


def test_who_is_gone_is_not_alive_whatever_it_said() -> None:
    robot = Watched()
    assert robot.receipt(1.0, alive=False) == StopReceipt(StopStatus.NOT_ALIVE, None, None, None, 1.0)
    assert robot.watch.receipt(ORDERED + 1.0, alive=False, known=False).status is StopStatus.UNKNOWN
    robot.health(0.0, latched=True)
    robot.odometry(0.0, 0.0, 0.0)
    assert robot.receipt(0.2, alive=False) == StopReceipt(StopStatus.NOT_ALIVE, 0.0, 0.0, 0.0, pytest.approx(0.2))
