"""The error tree.

::

    MuroError                     anything this project raises on purpose; the CLI prints it without a traceback
    ├── WrongValueError           a value that cannot be used
    │   ├── ConfigError           settings that are wrong or impossible
    │   └── ParameterError        a parameter of a law or a behaviour that makes no sense, or does not fit the others
    ├── MessageError              bytes from the network that are not the message their key promises
    ├── TransportError            the bus could not do what it was asked
    │   ├── NotConnected          no router answered at the endpoints given
    │   └── NoReply               an order was sent and nobody answered in time
    ├── OrderRefused              an order that cannot be obeyed; its text is the reason in the reply
    ├── BehaviourError            a behaviour could not be loaded or is not one
    ├── PlanningError             a plan that cannot be made (a goal outside the arena, say)
    ├── MissingExtra              a package that comes with one of our extras is not installed
    └── SupervisionError          a child process could not be kept alive

Every message says what was got, what was expected, where, and what to do next.
"""


class MuroError(Exception):
    """Anything this project raises on purpose."""


class WrongValueError(MuroError):
    """A value that cannot be used.

    Args:
        what: which value.
        got: what it is.
        expected: what would be right.
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
    """Settings that are wrong or impossible; ``what`` is the file with the full path of the key, such as
    ``fleet.toml: robot.r1.radius``."""


class ParameterError(WrongValueError, ValueError):
    """A parameter of a law or a behaviour that makes no sense, or does not fit the others; ``what`` is its name."""


class MessageError(MuroError):
    """Bytes from the network that are not the message their key promises. Counted and dropped by the bus."""


class TransportError(MuroError):
    """The bus could not do what it was asked."""


class NotConnected(TransportError):  # noqa: N818 - reads as a state, and is one
    """No router answered at the endpoints given."""


class NoReply(TransportError):  # noqa: N818 - reads as an event, and is one
    """An order was sent and nobody answered in time."""


class OrderRefused(MuroError):  # noqa: N818 - reads as an event, and is one
    """An order that cannot be obeyed; its text is the reason in the reply."""


class BehaviourError(MuroError):
    """A behaviour could not be loaded or is not one."""


class PlanningError(MuroError):
    """A plan that cannot be made."""


class MissingExtra(MuroError):  # noqa: N818 - reads as a state, and is one
    """A package that comes with one of our extras is not installed.

    Args:
        extra: such as ``figures``.
        need: what needs it, such as ``drawing figures needs matplotlib``.
        package: the package that is missing.
    """

    def __init__(self, extra: str, need: str, package: str) -> None:
        self.extra = extra
        super().__init__(
            f"{need}, and {package} is not installed: pip install 'muro-zenoh[{extra}]' "
            f"(in a checkout: .venv/bin/pip install -e '.[{extra}]', or make setup)"
        )


class SupervisionError(MuroError):
    """A child process could not be kept alive."""
