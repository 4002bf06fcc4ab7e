"""Settings of the whole suite."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

# A busy machine is no failure: how long an example takes says more of its neighbours than of the law.
settings.register_profile("muro", deadline=None, derandomize=False)
# In CI a failure must come of the change that is tested: the examples are the same each time. Elsewhere they are new.
settings.register_profile("muro-ci", deadline=None, derandomize=True)


def without_literals() -> None:
    """Let Hypothesis draw no examples from the literals of the modules that are loaded: another line would change those
    of all tests, and so would the order of the tests. It has no setting for that.

    Raises:
        AttributeError: Hypothesis has other names for them than the one in constraints.txt.
    """
    from hypothesis.internal.conjecture import providers

    none = providers._local_constants
    assert callable(providers._get_local_constants)
    providers._get_local_constants = lambda: none


# Runs and base stations of tests that are not about the page serve none; a test of it says where.
os.environ.setdefault("MURO_WEB", "off")
if os.environ.get("CI", "").lower() == "true":
    settings.load_profile("muro-ci")
    without_literals()
else:
    settings.load_profile("muro")


@pytest.fixture(autouse=True)
def logs_as_they_were() -> Iterator[None]:
    """Restore the loggers after each test: import-linter, for example, disables all existing loggers."""
    root = logging.getLogger()
    level = root.level
    yield
    root.setLevel(level)
    for logger in root.manager.loggerDict.values():
        if isinstance(logger, logging.Logger):
            logger.disabled = False


@pytest.fixture(autouse=True)
def environment_as_it_was() -> Iterator[None]:
    """Restore the environment after each test: finding a scenario's file names its folder to later processes."""
    before = dict(os.environ)
    yield
    if os.environ != before:
        os.environ.clear()
        os.environ.update(before)
