"""muro-zenoh: a fleet of ground robots run from Python over Eclipse Zenoh, without ROS."""

from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec

__version__ = "0.1.0"


def is_compiled() -> bool:
    """Whether the laws run compiled, as ``make compiled`` installs them, and not from their source."""
    one = find_spec("muro_zenoh.arcs")  # all of them are compiled together
    return one is not None and str(one.origin).endswith(tuple(EXTENSION_SUFFIXES))
