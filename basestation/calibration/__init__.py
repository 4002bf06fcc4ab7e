"""Calibrates cameras: from pictures of boards, floor tags and a drive to lens and place, and a bound on their error."""
