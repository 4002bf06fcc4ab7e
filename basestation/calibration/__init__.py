"""Finds out where a camera is, and how sure that is: in millimetres on the floor."""
