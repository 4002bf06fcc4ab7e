"""The table of all positions, who is alive, and the kept state."""
