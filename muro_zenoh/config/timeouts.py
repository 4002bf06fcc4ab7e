"""``[timeouts]``: how old what a robot drives by may be. Older, and the robot stands still, with the reason.

Each limit is applied by the process that would otherwise act on old information, and to the whole age: a pose's counts
from its capture, and what waited in a link, in a queue or in a frozen process counts too.
"""

from __future__ import annotations

from typing import Annotated

from muro_zenoh.config.schema import Section
from muro_zenoh.quantities import Quantity


class Timeouts(Section, frozen=True, kw_only=True):
    """The greatest ages. The channels' table has the defaults as its ``stale after``.

    Attributes:
        command: of the newest command, at the base: older, and its dead-man sets the wheels to zero [s]. An agent
            repeats its command three times in this time.
        pose: of the newest pose fix since its capture, at the agent [s]. A camera at 20 Hz delivers poses that are 70
            to 90 ms old, so the default bridges three lost frames. The base station calls a robot ``stale`` by it.
        snapshot: of the newest positions of all robots since they were sent, at the agent: for behaviours that need
            them, and for the separation filter [s].
    """

    command: Annotated[float, Quantity("s", at_least=0.1, at_most=1.0)] = 0.3
    pose: Annotated[float, Quantity("s", at_least=0.1, at_most=1.0)] = 0.25
    snapshot: Annotated[float, Quantity("s", at_least=0.1, at_most=2.0)] = 0.5


TIMEOUTS = Timeouts()
"""The defaults."""
