"""One asyncio process per robot: the control loop and the tasks round it, and the base that turns its wheels."""
