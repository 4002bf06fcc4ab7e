"""Laws that turn poses into twists and speeds: pure functions of values."""
