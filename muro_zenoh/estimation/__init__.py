"""Where a robot is and how its wheels lie: the pose filter with the two drive calibrations."""
