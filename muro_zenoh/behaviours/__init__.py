"""The behaviours that a robot can run: one file each, and named only there."""
