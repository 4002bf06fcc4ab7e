"""The error tree.

::

    MuroError                     anything this project raises on purpose; the CLI prints it without a traceback
    ├── WrongValueError           an invalid value
    │   ├── ConfigError           invalid settings
    │   └── ParameterError        an invalid parameter of a law or a behaviour, alone or with the others
    ├── MessageError              bytes from the network that are not the message expected on their key
    ├── CameraError               a camera or a recording gives no pictures
    ├── CalibrationError          pictures or measurements that make no good calibration
    ├── TransportError            an operation of the bus failed
    │   ├── NotConnected          no router answered at the given endpoints
    │   └── NoReply               no answer to an order within the timeout
    ├── OrderRefused              an order was refused; its text is the reason in the reply
    ├── BehaviourError            a behaviour could not be loaded or is not one
    ├── PlanningError             no plan is possible, for example to a goal outside the arena
    ├── MissingExtra              a package of one of our extras is not installed
    └── SupervisionError          a child process could not be kept alive

Every message has what was got, what was expected, where, and what to do next.
"""

from typing import Final

INTERRUPTED: Final = 130
"""Exit code of a command that Ctrl-C ended."""


class MuroError(Exception):
    """Anything this project raises on purpose."""


class WrongValueError(MuroError):
    """An invalid value.

    Args:
        what: the name of the value.
        got: the value found.
        expected: the valid values.
        hint: what to do next, where that is not obvious.
    """

    def __init__(self, what: str, *, got: str, expected: str, hint: str = "") -> None:
        self.what = what
        self.got = got
        self.expected = expected
        self.hint = hint
        text = f"{what}: got {got}, expected {expected}"
        super().__init__(f"{text}. {hint}" if hint else text)


class ConfigError(WrongValueError):
    """Invalid settings; ``what`` is the file with the full path of the key, such as ``fleet.toml: robot.r1.radius``."""


class ParameterError(WrongValueError, ValueError):
    """An invalid parameter of a law or a behaviour, alone or in combination with the others; ``what`` is its name."""


class MessageError(MuroError):
    """Bytes from the network that are not the message expected on their key. The bus counts and drops them."""


class CameraError(MuroError):
    """A camera or a recording gives no pictures."""


class CalibrationError(MuroError):
    """Pictures or measurements that make no good calibration; its text has which of them, and what to do."""


class TransportError(MuroError):
    """An operation of the bus failed."""


class NotConnected(TransportError):  # noqa: N818 - reads as a state, and is one
    """No router answered at the given endpoints."""


class NoReply(TransportError):  # noqa: N818 - reads as an event, and is one
    """No answer to an order or a question within the timeout."""


class OrderRefused(MuroError):  # noqa: N818 - reads as an event, and is one
    """An order was refused; its text is the reason in the reply."""


class BehaviourError(MuroError):
    """A behaviour could not be loaded or is not one."""


class PlanningError(MuroError):
    """No plan is possible."""


class MissingExtra(MuroError):  # noqa: N818 - reads as a state, and is one
    """A package of one of our extras is not installed.

    Args:
        extra: such as ``figures``.
        need: what needs it, such as ``drawing figures needs matplotlib``.
        package: the missing package.
    """

    def __init__(self, extra: str, need: str, package: str) -> None:
        self.extra = extra
        super().__init__(
            f"{need}, and {package} is not installed: pip install 'muro-zenoh[{extra}]' "
            f"(in a checkout: .venv/bin/pip install -e '.[{extra}]', or make setup)"
        )


class SupervisionError(MuroError):
    """A child process could not be kept alive."""
