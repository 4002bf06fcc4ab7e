"""One asyncio process per robot: the tasks that steer it, and the base that turns its wheels."""
