"""Laws that turn goals into paths: pure functions of values."""
