"""muro-zenoh: a fleet of ground robots run from Python over Eclipse Zenoh, without ROS."""

__version__ = "0.1.0"


def is_compiled() -> bool:
    """Whether any module runs compiled, as ``make compiled`` installs them, and not from its source."""
    from importlib.machinery import EXTENSION_SUFFIXES  # not with the package, which every agent imports
    from pathlib import Path

    home, packages = Path(__file__).parents[1], ("muro_zenoh", "agents", "basestation")
    files = (file for package in packages for file in (home / package).rglob("*.*"))
    return any(file.name.endswith(tuple(EXTENSION_SUFFIXES)) for file in files)
