"""Whether a robot may drive now, and the reasons when it may not."""

from __future__ import annotations

import math

from muro_zenoh.safety.stop import StopLatch


def reasons_to_hold(
    *,
    latch: StopLatch,
    pause: float,
    fix_age: float,
    fix_limit: float,
    snapshot_age: float,
    snapshot_limit: float,
    twist_age: float,
    twist_limit: float,
    hold: str,
) -> tuple[str, ...]:
    """All reasons for which a robot must not drive, most important first; empty when it may drive.

    Args:
        latch: the robot's stop latch.
        pause: how long the robot's process was frozen or blocked [s], until it has received the stop state again.
        fix_age: time since the capture of the newest accepted pose fix [s]; infinite before the first.
        fix_limit: maximum age of the fix [s].
        snapshot_age: time since the newest positions of all robots were sent [s]; infinite before the first, 0 for a
            robot that drives without them.
        snapshot_limit: maximum age of the positions [s].
        twist_age: time since the behaviour's newest intent [s]; infinite before the first.
        twist_limit: maximum age of the intent [s].
        hold: why the behaviour itself holds; empty when it does not.
    """
    reasons = []
    if latch.reason:
        reasons.append(latch.reason)
    elif pause:
        reasons.append(f"no stop state since a pause of {pause:.1f} s: waiting for the base station")
    # Written so that a NaN is a reason too.
    if not fix_age <= fix_limit:
        never = "no pose yet: waiting for a camera to see this robot"
        reasons.append(never if fix_age == math.inf else f"no pose for {fix_age:.1f} s")
    if not snapshot_age <= snapshot_limit:
        never = "no positions of all robots yet: waiting for the base station"
        reasons.append(never if snapshot_age == math.inf else f"no positions of all robots for {snapshot_age:.1f} s")
    if hold:
        reasons.append(hold)
    elif not twist_age <= twist_limit:
        reasons.append("no command from the behaviour")
    return tuple(reasons)
