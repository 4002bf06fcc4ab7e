"""Robots that keep apart: each decides alone, from the snapshot that all receive and from its own state."""

from muro_zenoh.safety.separation.body import Body, Row, SharedSnapshot
from muro_zenoh.safety.separation.filter import Separated, Separation
from muro_zenoh.safety.separation.settings import SeparationSettings

__all__ = ["Body", "Row", "Separated", "Separation", "SeparationSettings", "SharedSnapshot"]
