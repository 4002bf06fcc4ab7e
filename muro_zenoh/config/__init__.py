"""Settings: TOML files become frozen values, or a :class:`~muro_zenoh.errors.ConfigError` that names the key.

A fleet file describes a lab (``[all]``, ``[robot.r1]``, ``[arena]``, ``[[wall]]``, ``[camera.north]``, ``[bus]``,
``[clocks]``); a scenario describes a run (``[circle]``, ``[behaviour]``, ``[checks]``, ``[simulation]``, ``[[fault]]``)
and may name a fleet file with ``fleet = "lab.toml"``, or contain the fleet itself. ``[robot.r1]`` overrides ``[all]``,
which overrides the defaults.
"""

from muro_zenoh.config.behaviour import check_behaviour, check_settings, make_behaviour, parameters_as, read_parameters
from muro_zenoh.config.checks import Checks
from muro_zenoh.config.faults import Fault
from muro_zenoh.config.find import built_in_scenarios, find_scenario
from muro_zenoh.config.scenario import PROCESSES, as_table, load_scenario, parse_scenario
from muro_zenoh.config.schema import Section
from muro_zenoh.config.sections import (
    BehaviourSettings,
    BusSettings,
    CalibrationSettings,
    CameraSettings,
    ClockSettings,
    RobotSettings,
    Scenario,
    Simulation,
)
from muro_zenoh.config.timeouts import TIMEOUTS, Timeouts

__all__ = [
    "PROCESSES",
    "TIMEOUTS",
    "BehaviourSettings",
    "BusSettings",
    "CalibrationSettings",
    "CameraSettings",
    "Checks",
    "ClockSettings",
    "Fault",
    "RobotSettings",
    "Scenario",
    "Section",
    "Simulation",
    "Timeouts",
    "as_table",
    "built_in_scenarios",
    "check_behaviour",
    "check_settings",
    "find_scenario",
    "load_scenario",
    "make_behaviour",
    "parameters_as",
    "parse_scenario",
    "read_parameters",
]
