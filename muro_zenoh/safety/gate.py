"""Whether a robot may drive now, and if not, why."""

from __future__ import annotations

from muro_zenoh.safety.stop import StopLatch


def reasons_to_stand(
    *, latch: StopLatch, fix_age: float, fix_limit: float, twist_age: float, twist_limit: float, hold: str
) -> tuple[str, ...]:
    """Every reason for which a robot must stand still, most important first; none means it may drive.

    Args:
        latch: what it knows of the stop order.
        fix_age: time since the capture of the newest pose fix used [s]; infinite when there was none.
        fix_limit: above it the estimate is not fresh [s].
        twist_age: time since the behaviour last said what it wants [s]; infinite when it never did.
        twist_limit: above it that is not fresh [s].
        hold: why the behaviour itself wants to stand; empty when it does not.
    """
    reasons = []
    if latch.reason:
        reasons.append(latch.reason)
    # Written so that NaN stands still too.
    if not fix_age <= fix_limit:
        reasons.append("no pose yet" if fix_age == float("inf") else f"no pose for {fix_age:.1f} s")
    if hold:
        reasons.append(hold)
    elif not twist_age <= twist_limit:
        reasons.append("the behaviour is silent")
    return tuple(reasons)
