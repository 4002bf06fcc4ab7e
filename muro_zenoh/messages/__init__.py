"""Every message on the bus, and the codec.

On the wire a message is a MessagePack map, readable from any language. Every message has ``stamp`` (seconds since
1970), ``seq`` and ``epoch`` (random per process start; ``seq`` is compared within one epoch only). SI units, radians
in (-pi, pi], right-handed world frame (REP 103).
"""

from muro_zenoh.messages.base import (
    Covariance,
    Message,
    Name,
    Value,
)
from muro_zenoh.messages.codec import (
    MAX_PAYLOAD,
    VERSION,
    check_encoding,
    check_size,
    decode,
    decoder,
    encode,
    encoding_of,
)
from muro_zenoh.messages.lease import Lease, LeaseState, TakeLease
from muro_zenoh.messages.orders import (
    AskTime,
    Behaviour,
    Circle,
    Clear,
    Goal,
    Health,
    Reply,
    Resume,
    SetBehaviour,
    SetCircle,
    Stop,
    StopOrder,
)
from muro_zenoh.messages.telemetry import (
    BaseState,
    Calibration,
    Cell,
    Estimate,
    FleetSnapshot,
    Frame,
    Odometry,
    PlannedPath,
    PoseFix,
    RobotState,
    RobotStatus,
    SpeedReference,
    Truth,
    VelocityCommand,
)

__all__ = [
    "MAX_PAYLOAD",
    "VERSION",
    "AskTime",
    "BaseState",
    "Behaviour",
    "Calibration",
    "Cell",
    "Circle",
    "Clear",
    "Covariance",
    "Estimate",
    "FleetSnapshot",
    "Frame",
    "Goal",
    "Health",
    "Lease",
    "LeaseState",
    "Message",
    "Name",
    "Odometry",
    "PlannedPath",
    "PoseFix",
    "Reply",
    "Resume",
    "RobotState",
    "RobotStatus",
    "SetBehaviour",
    "SetCircle",
    "SpeedReference",
    "Stop",
    "StopOrder",
    "TakeLease",
    "Truth",
    "Value",
    "VelocityCommand",
    "check_encoding",
    "check_size",
    "decode",
    "decoder",
    "encode",
    "encoding_of",
]
