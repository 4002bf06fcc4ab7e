"""The sections of a settings file, as frozen values. The unit behind an attribute is shown in errors, too."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta, Struct

from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.geometry import Circle, TagMount, View, straight_down_view
from muro_zenoh.messages import Name, Value

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Fraction = Annotated[float, Meta(ge=0, lt=1)]
Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Angle = Annotated[float, Meta(ge=-2 * math.pi, le=2 * math.pi)]
Point = Annotated[tuple[float, ...], Meta(min_length=2, max_length=2)]
GoalRow = Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]
Realm = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}(/[a-z][a-z0-9_]{0,31})*$")]
NetworkPoint = Annotated[str, Meta(pattern=r"^(tcp|udp|tls|quic|unixsock-stream|ws)/.+")]


class Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a settings file."""


class RobotSettings(Section, frozen=True, kw_only=True):
    """A robot: its tag, its body, what it can do. A TurtleBot 2 by default.

    Attributes:
        tag: id of its tag.
        tag_size: side of the tag's black square [m].
        tag_x: the tag's centre in the base frame (origin: the middle of the axle), forwards [m].
        tag_y: the same, to the left [m].
        tag_yaw: heading of the tag's +x (from its left edge to its right edge as printed) in the base frame [rad].
        radius: of the body [m].
        wheel_base: distance of the wheels [m].
        v_max: fastest it may drive [m/s].
        omega_max: fastest it may turn [rad/s].
        a_max: strongest acceleration [m/s^2].
        alpha_max: strongest angular acceleration [rad/s^2].
        brake: strongest braking [m/s^2].
        lag: time constant of the wheels' speed control [s]; laws are evaluated so far ahead.
        base: what turns its wheels.
    """

    tag: Annotated[int, Meta(ge=0)] | None = None
    tag_size: Positive = 0.16
    tag_x: Finite = 0.0
    tag_y: Finite = 0.0
    tag_yaw: Angle = 0.0
    radius: Positive = 0.177
    wheel_base: Positive = 0.23
    v_max: Positive = 0.5
    omega_max: Positive = 1.5
    a_max: Positive = 0.5
    alpha_max: Positive = 3.0
    brake: Positive = 1.0
    lag: Positive = 0.1
    base: Literal["simulated"] = "simulated"

    @property
    def wheels(self) -> WheelLimits:
        """What its wheels can do, as filter, laws and plant take it."""
        return WheelLimits(lag=self.lag, a_max=self.a_max, alpha_max=self.alpha_max, brake=self.brake)

    @property
    def mount(self) -> TagMount:
        """Its tag, as renderer and localization take it.

        Raises:
            ValueError: it carries none.
        """
        if self.tag is None:
            raise ValueError("this robot carries no tag")
        return TagMount(self.tag, self.tag_size, self.tag_x, self.tag_y, self.tag_yaw)


class Arena(Section, frozen=True, kw_only=True):
    """The floor that robots may use, a rectangle.

    Attributes:
        x_min: left border [m, world].
        x_max: right border [m, world].
        y_min: lower border [m, world].
        y_max: upper border [m, world].
    """

    x_min: Finite = -2.1
    x_max: Finite = 2.1
    y_min: Finite = -1.5
    y_max: Finite = 1.5

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``x_min, y_min, x_max, y_max`` [m]."""
        return self.x_min, self.y_min, self.x_max, self.y_max


_VIEW_MARGIN = 0.25
"""What a camera without points of its own sees beyond the arena [m]."""


class CameraSettings(Section, frozen=True, kw_only=True):
    """An overhead camera.

    Attributes:
        width: of its frames [px].
        height: of its frames [px].
        rate: frames per second [Hz].
        latency: least time from the capture of a frame to its arrival at the base station [s]; what a frame takes
            longer than the quickest one, the base station measures.
        family: of the tags it looks for, as OpenCV names it.
        pixels: four or more points of the image [px], ...
        metres: ... and where they are on the plane of the tags [m, world].
        sigma_pixels: noise of a tag's corners [px]; the covariance of the fixes follows from it.
        jpeg_quality: of the simulated camera's frames; 0 sends them raw and grey.
    """

    width: Annotated[int, Meta(gt=0, le=8192)] = 1280
    height: Annotated[int, Meta(gt=0, le=8192)] = 720
    rate: Annotated[float, Meta(gt=0, le=240)] = 20.0
    latency: NotNegative = 0.05
    family: str = "DICT_4X4_50"
    pixels: Annotated[tuple[Point, ...], Meta(min_length=4)] | None = None
    metres: Annotated[tuple[Point, ...], Meta(min_length=4)] | None = None
    sigma_pixels: Positive = 0.15
    jpeg_quality: Annotated[int, Meta(ge=0, le=100)] = 85

    def views(self, arena: Arena) -> tuple[View, ...]:
        """Which pixels show which places; without ``pixels`` a camera that looks straight down at the whole arena.

        Args:
            arena: the floor.
        """
        if self.pixels is not None and self.metres is not None:
            pairs = zip(self.pixels, self.metres, strict=True)
            return tuple(View(u, v, x, y) for (u, v), (x, y) in pairs)
        return straight_down_view(*arena.bounds, self.width, self.height, margin=_VIEW_MARGIN)


class CircleSettings(Section, frozen=True, kw_only=True):
    """The circle to follow.

    Attributes:
        x: of its centre [m, world].
        y: of its centre [m, world].
        radius: of it [m].
        clockwise: the direction of travel.
    """

    x: Finite = 0.0
    y: Finite = 0.0
    radius: Positive = 0.8
    clockwise: bool = False

    @property
    def circle(self) -> Circle:
        """As the laws take it."""
        return Circle(self.x, self.y, self.radius, self.clockwise)


class BusSettings(Section, frozen=True, kw_only=True):
    """How to reach the others.

    Attributes:
        realm: the first word of every key, so that labs can share a network.
        mode: Zenoh's: ``client`` of a router, ``peer`` (to connect to several endpoints), or ``router``.
        connect: endpoints to connect to.
        listen: endpoints to listen on.
        config: a Zenoh configuration file (JSON5) on which these settings are laid.
        lease: a link that was silent for so long is given up [s].
    """

    realm: Realm = "muro"
    mode: Literal["client", "peer", "router"] = "client"
    connect: tuple[NetworkPoint, ...] = ("tcp/127.0.0.1:7447",)
    listen: tuple[NetworkPoint, ...] = ()
    config: str = ""
    lease: Annotated[float, Meta(ge=0.2, le=60)] = 2.0


class BehaviourSettings(Section, frozen=True, kw_only=True):
    """What every robot does at first. All keys but ``name`` are the behaviour's parameters.

    Attributes:
        name: a built-in behaviour, or ``module:function``.
        parameters: the other keys of the section.
    """

    name: str = "hold"
    parameters: dict[str, Value] = {}


class Checks(Section, frozen=True, kw_only=True):
    """What a run must meet for exit code 0; a check that is not set is not made.

    Attributes:
        window: the errors are judged over the last so many seconds [s].
        settle_time: settled at most so long after the start [s].
        radius_error_p95: at most [m].
        spacing_error_p95: at most [rad].
        fix_rate: at least, for every robot [Hz].
        pose_age_p99: at most [s].
        collisions: at most.
        goals_missed: at most so many of the scenario's goals are not reached.
        goal_distance: from a goal, of who stands at it, at most [m].
        goal_heading: off the heading asked for at a goal, at most [rad].
        tracking_error_p95: distance from the planned path, at most [m].
        peak_speed_ratio: every robot's greatest speed on a straight over its ``v_min``, at least.
        command_ratio: the greatest speed commanded over the robot's limit, at most; 1 is within the limits.
        coverage_distance: from a robot to its own cell's centroid, at rest at the end, at most [m].
        coverage_gain: by what fraction going on with Lloyd's algorithm would lower the cost, at most.
        coverage_rise: by what fraction the cost rises from one round to the next, at most.
        density_error: total variation distance of the time spent round the circle from the importance, at most.
    """

    window: Positive = 15.0
    settle_time: Positive | None = None
    radius_error_p95: Positive | None = None
    spacing_error_p95: Positive | None = None
    fix_rate: Positive | None = None
    pose_age_p99: Positive | None = None
    collisions: Annotated[int, Meta(ge=0)] | None = None
    goals_missed: Annotated[int, Meta(ge=0)] | None = None
    goal_distance: Positive | None = None
    goal_heading: Positive | None = None
    tracking_error_p95: Positive | None = None
    peak_speed_ratio: Positive | None = None
    command_ratio: Positive | None = None
    coverage_distance: Positive | None = None
    coverage_gain: Positive | None = None
    coverage_rise: Positive | None = None
    density_error: Positive | None = None


class Simulation(Section, frozen=True, kw_only=True):
    """What the simulator hides from the robots.

    Attributes:
        drive_error: each robot's wheels do up to this fraction more or less than they say.
        slip: standard deviation of the distance really driven [m/sqrt(m)] and of the angle turned.
        image_noise: of the camera's grey values, standard deviation [0..255]. Not 0: pictures that are alike to the
            last bit are those of a camera that is stuck.
        image_blur: of the camera, standard deviation [px].
        camera_latency: from capture to sending [s].
    """

    drive_error: Annotated[float, Meta(ge=0, le=0.3)] = 0.2
    slip: Annotated[float, Meta(ge=0, le=0.5)] = 0.005
    image_noise: Annotated[float, Meta(ge=0.5, le=64)] = 3.0
    image_blur: Annotated[float, Meta(ge=0, le=5)] = 0.6
    camera_latency: NotNegative = 0.05


class Scenario(Section, frozen=True, kw_only=True):
    """Everything a run needs, resolved.

    Attributes:
        name: what it is called in reports.
        description: one line for the operator.
        duration: how long it runs [s].
        robot: the robots by name.
        arena: the floor.
        camera: the cameras by name.
        circle: the circle at the start.
        bus: how to reach the others.
        behaviour: what every robot does at the start.
        goals: rows ``[x, y]`` or ``[x, y, theta]`` [m, world; rad] of each robot, for the behaviours that go to goals.
        checks: what the run must meet.
        simulation: what the simulator hides.
    """

    name: str
    description: str = ""
    duration: Positive = 60.0
    robot: dict[Name, RobotSettings]
    arena: Arena = Arena()
    camera: dict[Name, CameraSettings] = {}
    circle: CircleSettings = CircleSettings()
    bus: BusSettings = BusSettings()
    behaviour: BehaviourSettings = BehaviourSettings()
    goals: dict[Name, tuple[GoalRow, ...]] = {}
    checks: Checks = Checks()
    simulation: Simulation = Simulation()

    def behaviour_of(self, name: str) -> BehaviourSettings:
        """What a robot does at first: the common behaviour, with its own goals among the parameters.

        Args:
            name: of the robot.
        """
        goals = self.goals.get(name)
        if not goals:
            return self.behaviour
        return BehaviourSettings(name=self.behaviour.name, parameters={**self.behaviour.parameters, "goals": goals})

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots' names, in the file's order."""
        return tuple(self.robot)
