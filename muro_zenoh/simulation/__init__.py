"""The plant, the lock-step rollout and the overhead camera's renderer."""
