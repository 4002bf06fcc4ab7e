"""Who gives orders from this process."""

from __future__ import annotations

import getpass
import os
import socket
from typing import Final

VARIABLE: Final = "MURO_OPERATOR"
"""Environment variable with the operator's name, for accounts that several people share."""


def operator_name() -> str:
    """The operator's name: ``MURO_OPERATOR``, or the user and the machine, such as ``alice@laptop``."""
    given = os.environ.get(VARIABLE, "")
    if not given:
        try:
            given = f"{getpass.getuser()}@{socket.gethostname()}"
        except (OSError, KeyError):  # a container's user without a name
            given = f"{os.getuid()}@{socket.gethostname()}"
    return given[:128]
