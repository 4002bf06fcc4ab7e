"""Data collected from a run, and its score sheet."""
