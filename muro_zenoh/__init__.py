"""muro-zenoh: a fleet of ground robots run from Python over Eclipse Zenoh, without ROS."""

__version__ = "0.1.0"
