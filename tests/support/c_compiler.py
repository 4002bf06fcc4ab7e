"""`python tests/support/c_compiler.py`: says what a compiled build lacks on this machine, and ends with 1 when it does.

For the Makefile, for `.ci/run` and for the tests; it needs nothing but Python.
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path


def lack() -> str:
    """What is missing, in words; empty when there is all."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    if shutil.which(compiler) is None:
        return f"no C compiler {compiler}, which make compiled needs; on Debian: apt-get install build-essential"
    header = Path(sysconfig.get_path("include"), "Python.h")
    if not header.exists():
        return f"no {header}, which make compiled needs; on Debian: apt-get install python3-dev"
    return ""


if __name__ == "__main__":
    sys.exit(lack() or 0)
