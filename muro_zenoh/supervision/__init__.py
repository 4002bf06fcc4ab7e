"""Runs a fleet as processes on this machine: children, restarts, processor time and memory."""
