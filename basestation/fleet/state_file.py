"""The file of the kept state: read once, then replaced by each change, off the loop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec

from basestation.fleet.kept_state import KeptState
from muro_zenoh.errors import ConfigError

_THREADS = 3
"""A change of circle or behaviour is written by one thread at a time, and so are leases; stops have the third one."""


class StateFile:
    """A file that holds a state, after a crash the old one or the new one, never a half.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._threads = ThreadPoolExecutor(_THREADS, thread_name_prefix="state file")
        self._lock = threading.Lock()
        self._requested = 0  # writes asked for ...
        self._replaced = 0  # ... and the newest of them that the file holds

    def read(self) -> KeptState | None:
        """The state in the file, or None when there is no file.

        Raises:
            ConfigError: the file is there and holds no such state. Starting from scratch instead could lift a stop.
        """
        if not self._path.exists():
            return None
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=KeptState)
        except (OSError, msgspec.MsgspecError) as error:
            raise ConfigError(
                str(self._path),
                got=f"a file that is no kept state: {error}",
                expected="the state that a base station of this version wrote",
                hint="Move it away to start from the scenario; a stop order in it is then forgotten.",
            ) from error

    def write(self, state: KeptState) -> asyncio.Future[None]:
        """Begin to write a state. Of two writes the one asked for later is what the file ends up with.

        Args:
            state: the state.

        Returns:
            Done when the file holds this state or one whose write was asked for later; a ConfigError when it cannot be
            written.
        """
        self._requested += 1
        return asyncio.get_running_loop().run_in_executor(self._threads, self._replace, self._requested, state)

    def write_now(self, state: KeptState) -> None:
        """Write a state before this returns.

        Args:
            state: the state.

        Raises:
            ConfigError: it cannot be written.
        """
        self._requested += 1
        self._replace(self._requested, state)

    def close(self) -> None:
        """End the threads, once what they write is written; it does not wait for that."""
        self._threads.shutdown(wait=False)

    def _replace(self, number: int, state: KeptState) -> None:
        scratch = self._path.with_name(f"{self._path.name}.{number}.new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with scratch.open("w") as file:
                json.dump(msgspec.to_builtins(state), file, indent=1)
                file.flush()
                os.fsync(file.fileno())
            with self._lock:
                if number < self._replaced:
                    scratch.unlink()
                else:
                    scratch.replace(self._path)
                    self._replaced = number
            # Not in the lock: a disk that hangs here must not keep the other thread waiting. A write that came too late
            # syncs as well, because the newer one that it left in place may not have done so yet.
            _sync_folder(self._path.parent)
        except OSError as error:
            with contextlib.suppress(OSError):
                scratch.unlink()
            raise ConfigError(
                str(self._path), got=error.strerror or str(error), expected="a file to keep the lab's state in"
            ) from error


def _sync_folder(folder: Path) -> None:
    """Only then the new name of a file outlives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
