"""A flock: align with the neighbours, keep a distance, stay near the middle. `muro run examples/flock.toml`"""

import math

from muro_zenoh.geometry import wrap_to_pi


def flock(robot):
    """Called at each estimate of a robot; returns what it is to drive: v [m/s], omega [rad/s]."""
    me = robot.state
    x, y = math.cos(me.theta) - 1.5 * me.x, math.sin(me.theta) - 1.5 * me.y
    for other in robot.neighbours:
        dx, dy = other.x - me.x, other.y - me.y
        away = 0.2 / max(dx * dx + dy * dy, 0.01)
        x += 0.5 * math.cos(other.theta) - away * dx
        y += 0.5 * math.sin(other.theta) - away * dy
    turn = wrap_to_pi(math.atan2(y, x) - me.theta)
    return 0.15 * max(math.cos(turn), 0.0), 1.5 * turn
