"""The sections of a settings file, as frozen values. Units and limits are declared on the fields."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import BehaviourKind, Need, Vehicle
from muro_zenoh.config.checks import Checks
from muro_zenoh.config.faults import Fault
from muro_zenoh.config.order import OrderRow
from muro_zenoh.config.schema import Section
from muro_zenoh.config.timeouts import TIMEOUTS, Timeouts
from muro_zenoh.config.wall import Point, WallRow
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.geometry import Bounds, Circle, TagMount, View
from muro_zenoh.messages import Name, Value
from muro_zenoh.quantities import (
    Acceleration,
    Angle,
    AngularAcceleration,
    Coordinate,
    Count,
    Duration,
    Height,
    Length,
    Number,
    Period,
    Quantity,
    Speed,
    TurningRate,
)
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings
from muro_zenoh.walls import Wall

Pixel = Annotated[tuple[Annotated[float, Quantity("px")], ...], Meta(min_length=2, max_length=2)]
StartRow = Annotated[tuple[Number, ...], Meta(min_length=3, max_length=3)]
GoalRow = Annotated[tuple[Number, ...], Meta(min_length=2, max_length=3)]
Distortion = Annotated[tuple[Number, ...], Meta(min_length=5, max_length=5)]
Realm = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}(/[a-z][a-z0-9_]{0,31})*$")]
LocalPoint = Annotated[str, Meta(pattern=r"^(tcp/(127(\.\d{1,3}){3}|localhost|\[::1\]):\d{1,5}|unixsock-stream/.+)$")]
NetworkPoint = Annotated[str, Meta(pattern=r"^(tcp|udp|tls|quic|unixsock-stream|ws)/.+")]


ClockDifference = Annotated[float, Quantity("s", at_least=0.001, at_most=3600.0)]

_PIXELS = Quantity("px", above=0, at_most=8192, whole=True)


class RobotSettings(Section, frozen=True, kw_only=True):
    """A robot: its tag, its body, what it can do. A TurtleBot 2 by default.

    Attributes:
        tag: id of its tag.
        tag_size: side of the tag's black square [m].
        tag_x: the tag's centre in the base frame (origin: the middle of the axle), forwards [m].
        tag_y: the same, to the left [m].
        tag_yaw: heading of the tag's +x (from its left edge to its right edge as printed) in the base frame [rad].
        tag_z: the tag's height above the floor [m]. A camera given by points of one plane takes all tags to be in that.
        radius: of the body [m].
        wheel_base: distance between the wheels [m].
        v_max: maximum speed [m/s].
        omega_max: maximum turning rate [rad/s].
        a_max: maximum acceleration [m/s^2].
        alpha_max: maximum angular acceleration [rad/s^2].
        brake: maximum deceleration [m/s^2].
        lag: time constant of the wheels' speed control [s]; laws are evaluated for this time ahead.
        base: driver of its wheels: the name of a file in ``agents/base``.
        base_link: endpoint of its own machine where its base listens and its agent connects besides the router, so that
            a stop reaches the wheels without router and network. Robots whose bases run on one machine need different
            ones. Without it, and in `muro run`, whose bases are in the simulator, there is no such link.
    """

    tag: Count | None = None
    tag_size: Length = 0.16
    tag_x: Coordinate = 0.0
    tag_y: Coordinate = 0.0
    tag_yaw: Angle = 0.0
    tag_z: Height = 0.15
    radius: Length = 0.177
    wheel_base: Length = 0.23
    v_max: Speed = 0.5
    omega_max: TurningRate = 1.5
    a_max: Acceleration = 0.5
    alpha_max: AngularAcceleration = 3.0
    brake: Acceleration = 1.0
    lag: Period = 0.1
    base: Name = "simulated"
    base_link: LocalPoint | None = None

    @property
    def wheels(self) -> WheelLimits:
        """The lag and limits of its wheels, for filter, laws and plant."""
        return WheelLimits(lag=self.lag, a_max=self.a_max, alpha_max=self.alpha_max, brake=self.brake)

    @property
    def body(self) -> Body:
        """Its size and limits, for the separation filter."""
        return Body(self.radius, self.v_max, self.omega_max, self.a_max, self.alpha_max, self.brake, self.lag)

    @property
    def mount(self) -> TagMount:
        """Its tag, for renderer and localization.

        Raises:
            ValueError: it has none.
        """
        if self.tag is None:
            raise ValueError("this robot has no tag")
        return TagMount(self.tag, self.tag_size, self.tag_x, self.tag_y, self.tag_yaw, self.tag_z)


ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
"""The default arena."""

CIRCLE = Circle(0.0, 0.0, 0.8)
"""The default circle."""


class LensSettings(Section, frozen=True, kw_only=True):
    """The lens of a camera, as OpenCV describes one: the file that ``muro calibrate intrinsics`` writes.

    Attributes:
        width: of the pictures that it was calibrated with [px].
        height: of them [px].
        focal: focal lengths along u and v [px].
        centre: the principal point [px]; integers are pixel centres.
        distortion: k1, k2, p1, p2, k3.
        lens_covariance: nine rows of nine numbers, of focal, centre and distortion in this order, for what is
            calibrated with this lens; empty when it is not known.
    """

    width: Annotated[int, _PIXELS]
    height: Annotated[int, _PIXELS]
    focal: Annotated[tuple[Annotated[float, Quantity("px", above=0.0)], ...], Meta(min_length=2, max_length=2)]
    centre: Pixel
    distortion: Distortion = (0.0, 0.0, 0.0, 0.0, 0.0)
    lens_covariance: tuple[Annotated[tuple[Number, ...], Meta(min_length=9, max_length=9)], ...] = ()


class CalibrationSettings(LensSettings, frozen=True, kw_only=True):
    """A calibrated camera, as OpenCV describes one: a file of its own beside the fleet file, or a table in it.

    Attributes:
        position: of the camera [m, world].
        rotation: rotation vector from the world's to the camera's frame [rad].
        floor_tags: number, x, y and z [m, world] of the middle of each tag on the floor by which it was calibrated.
            While they lie there, they show whether it was moved.
    """

    position: Annotated[tuple[Coordinate, ...], Meta(min_length=3, max_length=3)]
    rotation: Annotated[tuple[Annotated[float, Quantity("rad")], ...], Meta(min_length=3, max_length=3)]
    floor_tags: tuple[Annotated[tuple[Number, ...], Meta(min_length=4, max_length=4)], ...] = ()

    @property
    def floor_places(self) -> dict[int, tuple[float, float, float]]:
        """Where each tag on the floor is, by its number [m, world]."""
        return {int(number): (x, y, z) for number, x, y, z in self.floor_tags}


HUNG = ("x", "y", "z", "heading", "tilt", "fov", "distortion")
"""The settings of a camera that hangs at a given place."""


class CameraSettings(Section, frozen=True, kw_only=True):
    """An overhead camera.

    Where it is comes from points (``pixels`` and ``metres``), from a calibration, or from ``x`` to ``distortion``: as a
    simulated camera hangs. Without any of them it hangs over the middle of the arena and sees all of it.

    Attributes:
        width: of its frames [px].
        height: of its frames [px].
        rate: frames per second [Hz].
        latency: minimum time from the capture of a frame to its arrival at the base station [s]; the base station
            measures the additional delay of each frame.
        family: family of the tags to detect, as OpenCV names it.
        detector: the library that detects them; ``apriltag`` is slower, finds more of small and blurred tags, and needs
            the extra of this name.
        pixels: four or more points of the image [px].
        metres: the positions of these points on the plane of the tags [m, world].
        calibration: its calibration: a table, or the name of a TOML file relative to the one that names it.
        x: of the camera [m, world]; by default the arena's middle.
        y: of the camera [m, world]; by default the arena's middle.
        z: of the camera above the floor [m].
        heading: of the picture's right edge, counter-clockwise from x [rad].
        tilt: from straight down towards the picture's upper edge [rad].
        fov: angle that the picture's width covers [rad]; by default as much as shows the whole arena.
        distortion: k1, k2, p1, p2, k3 of the lens.
        sigma_pixels: standard deviation of a tag's corners [px]; it determines the covariance of the fixes.
        jpeg_quality: of the simulated camera's frames; 0 for raw grey frames.
    """

    width: Annotated[int, _PIXELS] = 1280
    height: Annotated[int, _PIXELS] = 720
    rate: Annotated[float, Quantity("Hz", above=0.0, at_most=240.0)] = 20.0
    latency: Duration = 0.05
    family: str = "DICT_4X4_50"
    detector: Literal["opencv", "apriltag"] = "opencv"
    pixels: Annotated[tuple[Pixel, ...], Meta(min_length=4)] | None = None
    metres: Annotated[tuple[Point, ...], Meta(min_length=4)] | None = None
    calibration: CalibrationSettings | None = None
    x: Coordinate | None = None
    y: Coordinate | None = None
    z: Annotated[float, Quantity("m", above=0.0)] | None = None
    heading: Angle | None = None
    tilt: Annotated[float, Quantity("rad", at_least=-1.5, at_most=1.5)] | None = None
    fov: Annotated[float, Quantity("rad", at_least=0.01, at_most=3.0)] | None = None
    distortion: Distortion | None = None
    sigma_pixels: Annotated[float, Quantity("px", above=0.0)] = 0.1
    jpeg_quality: Annotated[int, Quantity(at_least=0, at_most=100, whole=True)] = 85

    @property
    def views(self) -> tuple[View, ...]:
        """Pairs of pixels and positions, where the camera is given by points."""
        pairs = zip(self.pixels or (), self.metres or (), strict=True)
        return tuple(View(u, v, x, y) for (u, v), (x, y) in pairs)


class BusSettings(Section, frozen=True, kw_only=True):
    """How to connect to the other processes.

    Attributes:
        realm: the first word of every key, so that labs can share a network.
        mode: Zenoh's: ``client`` of a router, ``peer`` (to connect to several endpoints), or ``router``.
        connect: endpoints to connect to.
        listen: endpoints to listen on.
        config: a Zenoh configuration file (JSON5), which these settings override.
        lease: a link without traffic for this time is closed [s].
    """

    realm: Realm = "muro"
    mode: Literal["client", "peer", "router"] = "client"
    connect: tuple[NetworkPoint, ...] = ("tcp/127.0.0.1:7447",)
    listen: tuple[NetworkPoint, ...] = ()
    config: str = ""
    lease: Annotated[float, Quantity("s", at_least=0.2, at_most=60.0)] = 2.0


class ClockSettings(Section, frozen=True, kw_only=True):
    """By how much a machine's clock may differ from the base station's before that is reported; no robot stops for it.

    Attributes:
        skew: the difference [s].
        step: a change of the difference within a second [s].
    """

    skew: ClockDifference = 0.02
    step: ClockDifference = 0.05


class BehaviourSettings(Section, frozen=True, kw_only=True):
    """The initial behaviour of every robot. All keys except ``name`` are the behaviour's parameters.

    Attributes:
        name: a built-in behaviour, or ``module:function``.
        parameters: the other keys of the section.
    """

    name: str = table.DEFAULT
    parameters: dict[str, Value] = field(default_factory=dict)


class Simulation(Section, frozen=True, kw_only=True):
    """Properties of the simulation that are hidden from the robots.

    Attributes:
        drive_error: each robot drives and turns up to this fraction more or less than its wheels report.
        slip: standard deviation of the distance actually driven [m/sqrt(m)] and of the angle turned.
        image_noise: standard deviation of the camera's grey values [0..255]. Not 0: identical pictures are taken for
            those of a stuck camera.
        image_blur: standard deviation of the camera's blur [px].
        image_shade: fraction of the light that is missing in the darkest place of a picture.
        exposure: of each frame [s]; what moves is blurred.
        camera_latency: from capture to sending, at least [s].
        camera_jitter: the latency is longer by up to this, at random [s].
        camera_loss: fraction of the frames that are lost.
        arm_every: mean time from one arm that reaches across a picture to the next [s]; 0 for never.
    """

    drive_error: Annotated[float, Quantity(at_least=0.0, at_most=0.3)] = 0.2
    slip: Annotated[float, Quantity("m/sqrt(m)", at_least=0.0, at_most=0.5)] = 0.005
    image_noise: Annotated[float, Quantity("grey levels", at_least=0.5, at_most=64.0)] = 3.0
    image_blur: Annotated[float, Quantity("px", at_least=0.0, at_most=5.0)] = 0.6
    image_shade: Annotated[float, Quantity(at_least=0.0, at_most=0.9)] = 0.3
    exposure: Annotated[float, Quantity("s", at_least=0.0, at_most=0.1)] = 0.005
    camera_latency: Duration = 0.05
    camera_jitter: Annotated[float, Quantity("s", at_least=0.0, at_most=1.0)] = 0.0
    camera_loss: Annotated[float, Quantity(at_least=0.0, at_most=1.0)] = 0.0
    arm_every: Duration = 0.0


class Scenario(Section, frozen=True, kw_only=True):
    """Everything a run needs, resolved.

    Attributes:
        name: its name in reports.
        description: one line for the operator.
        duration: duration of the run [s].
        robot: the robots by name.
        arena: the floor.
        wall: the walls on it, from ``[[wall]]``.
        camera: the cameras by name.
        circle: the initial circle.
        bus: how to connect to the other processes.
        clocks: which differences of clocks are reported.
        behaviour: the initial behaviour of every robot.
        goals: rows ``[x, y]`` or ``[x, y, theta]`` [m, world; rad] by robot, for behaviours that drive to goals.
        faults: what breaks during the run, from ``[[fault]]``.
        checks: the limits that the run must meet.
        simulation: the hidden properties of the simulation.
        starts: poses ``[x, y, theta]`` [m, world; rad] of the simulated robots by name; empty for random ones.
        orders: what an operator orders during a check, and when, from ``[[order]]``.
        timeouts: how old what a robot drives by may be.
        separation: how robots keep apart.
    """

    name: str
    description: str = ""
    duration: Period = 60.0
    robot: dict[Name, RobotSettings]
    arena: Bounds = ARENA
    wall: tuple[WallRow, ...] = ()
    camera: dict[Name, CameraSettings] = field(default_factory=dict)
    circle: Circle = CIRCLE
    bus: BusSettings = BusSettings()
    clocks: ClockSettings = ClockSettings()
    behaviour: BehaviourSettings = BehaviourSettings()
    goals: dict[Name, tuple[GoalRow, ...]] = field(default_factory=dict)
    faults: tuple[Fault, ...] = field(default=(), name="fault")
    checks: Checks = Checks()
    simulation: Simulation = Simulation()
    starts: dict[Name, StartRow] = field(default_factory=dict)
    orders: tuple[OrderRow, ...] = field(default=(), name="order")
    timeouts: Timeouts = TIMEOUTS
    separation: SeparationSettings = SeparationSettings()

    def behaviour_of(self, name: str, behaviour: BehaviourSettings | None = None) -> BehaviourSettings:
        """A robot's behaviour: the common one, with the robot's own goals among the parameters.

        Args:
            name: of the robot.
            behaviour: the common one; None for the initial one.
        """
        common = behaviour or self.behaviour
        goals = self.goals.get(name)
        if not goals or ":" in common.name:  # a user's own is loaded where it runs
            return common
        kind = table.find(common.name)
        if not isinstance(kind, BehaviourKind) or Need.GOALS not in kind.needs:
            return common
        return BehaviourSettings(name=common.name, parameters={**common.parameters, "goals": goals})

    def vehicle(self, name: str) -> Vehicle:
        """A robot as input of its behaviour.

        Args:
            name: of the robot.
        """
        robot = self.robot[name]
        apart = self.separation
        margins = (apart.margin, apart.wall_margin) if apart.enabled else (0.0, 0.0)
        return Vehicle(name, robot.radius, robot.v_max, robot.omega_max, robot.lag, self.arena, *margins, self.walls)

    def separation_of(self, name: str) -> Separation | None:
        """A robot's separation filter; None where it is off.

        Args:
            name: of the robot.
        """
        if not self.separation.enabled:
            return None
        bodies = {each: robot.body for each, robot in self.robot.items()}
        return Separation(name, bodies[name], bodies, self.arena, self.separation, self.walls)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls inside the arena."""
        return tuple(row.wall for row in self.wall)

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots' names, in the order of the file."""
        return tuple(self.robot)
