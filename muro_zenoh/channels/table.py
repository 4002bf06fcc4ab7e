"""The table: one row per channel, one per order; nothing else is needed to add either.

A test compares it with what a fleet actually writes and reads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from muro_zenoh import messages as m
from muro_zenoh.channels.kinds import Channel, Party, Priority, Role, Verb
from muro_zenoh.config import TIMEOUTS

CONTROL: Final = Party(Role.AGENT, "control")
VISION: Final = Party(Role.BASESTATION, "vision")
FLEET: Final = Party(Role.BASESTATION, "fleet")
KEPT: Final = Party(Role.BASESTATION, "kept")
OPERATOR: Final = Party(Role.OPERATOR)

CAMERA = Channel(
    word="camera",
    kind=m.Frame,
    writers=(Party(Role.CAMERA),),
    readers=(VISION, OPERATOR),
    delivery="newest",
    rate=20.0,
    pacing="or as the camera's settings say",
    stale_after=0.5,
    priority=Priority.BACKGROUND,
    named="camera",
    ros="(camera video)",
)
POSE = Channel(
    word="pose",
    kind=m.PoseFix,
    writers=(VISION,),
    readers=(CONTROL,),
    delivery="every",
    rate=20.0,
    pacing="each frame that shows the robot",
    stale_after=TIMEOUTS.pose,
    priority=Priority.HIGH,
    ros="amcl_pose",
)
ESTIMATE = Channel(
    word="estimate",
    kind=m.Estimate,
    writers=(CONTROL,),
    readers=(FLEET,),
    delivery="newest",
    rate=20.0,
    pacing="each fix; when one is 1.5 periods overdue, without it",
    stale_after=0.4,
    ros="afterKalman",
)
CAL_OMEGA = Channel(
    word="cal0",
    kind=m.Calibration,
    writers=(CONTROL,),
    readers=(OPERATOR,),
    delivery="kept",
    rate=1.0,
    ros="cal0",
    note="multiplies omega",
)
CAL_V = Channel(
    word="calD",
    kind=m.Calibration,
    writers=(CONTROL,),
    readers=(OPERATOR,),
    delivery="kept",
    rate=1.0,
    ros="calD",
    note="multiplies v",
)
ALL_POSITIONS = Channel(
    word="all_positions",
    kind=m.FleetSnapshot,
    writers=(FLEET,),
    readers=(CONTROL, OPERATOR),
    delivery="newest",
    rate=20.0,
    pacing="each fused frame, 5 Hz at least",
    stale_after=TIMEOUTS.snapshot,
    priority=Priority.HIGH,
    named="",
    ros="/all_positions",
)
VELOCITY = Channel(
    word="velocity",
    kind=m.SpeedReference,
    writers=(CONTROL, OPERATOR),
    readers=(CONTROL,),
    delivery="newest",
    rate=20.0,
    pacing="each estimate",
    stale_after=0.5,
    ros="velocity",
    note="from the robot's behaviour, or from a lab's own program in its place",
)
DRIVE = Channel(
    word="drive",
    kind=m.DriveWish,
    writers=(OPERATOR,),
    readers=(CONTROL,),
    delivery="newest",
    pacing="20 Hz while a hand is on the stick; then once, with zeros",
    stale_after=0.2,
    priority=Priority.HIGH,
    note="followed by robots whose behaviour is manual",
)
CMD_VEL = Channel(
    word="cmd_vel",
    kind=m.VelocityCommand,
    writers=(CONTROL,),
    readers=(Party(Role.BASE), OPERATOR),
    delivery="newest",
    rate=20.0,
    pacing="each estimate; repeated when there is none",
    stale_after=TIMEOUTS.command,
    priority=Priority.REAL_TIME,
    ros="mobile_base/commands/velocity",
    note="when the last one is stale, the base's dead-man zeroes the wheels",
)
PATH = Channel(
    word="path",
    kind=m.PlannedPath,
    writers=(CONTROL,),
    readers=(OPERATOR,),
    delivery="kept",
    note="the planned Dubins path",
)
CELL = Channel(
    word="cell",
    kind=m.Cell,
    writers=(CONTROL,),
    readers=(OPERATOR,),
    delivery="newest",
    rate=1.0,
    pacing="and on change",
    note="for drawing",
)
CIRCLE = Channel(
    word="circle",
    kind=m.Circle,
    writers=(KEPT,),
    readers=(CONTROL, OPERATOR),
    delivery="kept",
    rate=2.0,
    pacing="and on an order",
    named="",
    ros="/centroidPos",
)
BEHAVIOUR = Channel(
    word="behaviour",
    kind=m.Behaviour,
    writers=(KEPT,),
    readers=(Party(Role.AGENT, "behaviour"), OPERATOR),
    delivery="kept",
    rate=2.0,
    pacing="and on an order",
    ros="(launch file)",
)
ODOMETRY = Channel(
    word="odometry",
    kind=m.Odometry,
    writers=(Party(Role.BASE),),
    readers=(CONTROL, OPERATOR),
    delivery="every",
    rate=25.0,
    stale_after=0.15,
    ros="odom",
)
BASE = Channel(
    word="base",
    kind=m.BaseState,
    writers=(Party(Role.BASE),),
    readers=(Party(Role.BASESTATION, "bases"), OPERATOR),
    delivery="newest",
    rate=2.0,
    pacing="and on change",
    stale_after=1.5,
)
HEALTH = Channel(
    word="health",
    kind=m.Health,
    writers=(
        Party(Role.AGENT, "health"),
        Party(Role.BASESTATION, "health"),
        Party(Role.SIMULATOR, "health"),
        Party(Role.CAMERA, "health"),
    ),
    readers=(KEPT, OPERATOR),
    delivery="kept",
    rate=1.0,
    pacing="and on change",
    stale_after=3.0,
    named="process",
)
STOP = Channel(
    word="stop",
    kind=m.StopOrder,
    writers=(KEPT, OPERATOR),
    readers=(Party(Role.AGENT, "stop"), OPERATOR),
    delivery="kept",
    rate=2.0,
    pacing="and on an order",
    priority=Priority.REAL_TIME,
    named="",
    note="the whole state, never a difference; an operator's goes to the agents directly, too; its sender keeps none",
)
LEASE = Channel(
    word="lease",
    kind=m.LeaseState,
    writers=(KEPT,),
    readers=(CONTROL, OPERATOR),
    delivery="kept",
    rate=2.0,
    pacing="and on change",
    stale_after=3.0,
    named="",
    note="whose orders and velocities count; none for a robot that nobody holds",
)
TRUTH = Channel(
    word="truth",
    kind=m.Truth,
    writers=(Party(Role.SIMULATOR),),
    readers=(OPERATOR, Party(Role.CAMERA)),
    delivery="newest",
    rate=20.0,
    note="for score sheets, and for simulated cameras in processes of their own; no other task may read it",
)

FAULTS = Channel(
    word="faults",
    kind=m.FaultList,
    writers=(Party(Role.SUPERVISOR),),
    readers=(OPERATOR,),
    delivery="kept",
    named="",
    note="what a run breaks, as rows of its scenario",
)

SET_CIRCLE = Verb("set_circle", m.SetCircle)
SET_BEHAVIOUR = Verb("set_behaviour", m.SetBehaviour)
STOP_ORDER = Verb("stop", m.Stop, at_any_age=True)
RESUME = Verb("resume", m.Resume)
CLEAR = Verb("clear", m.Clear)
TAKE_LEASE = Verb("lease", m.TakeLease, at_any_age=True)  # it moves no robot, and lasts three seconds
TIME = Verb(
    "time", m.AskTime, asked_by=(Role.AGENT, Role.BASE, Role.SIMULATOR, Role.CAMERA, Role.OPERATOR), at_any_age=True
)
BASE_TIME = Verb("base_time", m.AskTime, named="robot", answered_by=Role.BASE, asked_by=(Role.AGENT,), at_any_age=True)
BREAK = Verb("break", m.Break, answered_by=Role.SUPERVISOR)
BEFALL = Verb("befall", m.Break, answered_by=Role.SIMULATOR, asked_by=(Role.SUPERVISOR,))
GOAL_ORDER = Verb("goal", m.Goal, named="robot", answered_by=Role.AGENT, ros="move_base_simple/goal")

CHANNELS: Final[tuple[Channel[Any], ...]] = tuple(row for row in [*globals().values()] if isinstance(row, Channel))
"""Every channel above, in its order."""

VERBS: Final[tuple[Verb[Any], ...]] = tuple(row for row in [*globals().values()] if isinstance(row, Verb))
"""Every order above, in its order."""

if not TYPE_CHECKING:  # mypy takes a computed list for an empty one, and without one exports every name
    __all__ = ["CHANNELS", "VERBS", *(name for name, row in globals().items() if isinstance(row, Channel | Verb))]
