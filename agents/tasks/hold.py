"""Standing still."""

from __future__ import annotations

import asyncio

from agents.robot import Robot


async def hold(robot: Robot) -> None:
    """Stand still until another behaviour is ordered."""
    robot.hold("the behaviour is hold")
    await asyncio.Event().wait()
