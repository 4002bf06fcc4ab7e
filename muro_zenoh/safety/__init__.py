"""What keeps a robot from driving when it should not: limits, staleness, the stop latch."""
