"""One asyncio process per robot: the control loop and the tasks around it, and the base that drives its wheels."""
