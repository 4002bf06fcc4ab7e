"""The file of each key, for errors."""

from __future__ import annotations


class Origin:
    """The origin of the keys of a table: most are from one file, some from a fleet file or the command line.

    Args:
        file: the main file; empty for an order, whose keys speak for themselves.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._others: dict[str, str] = {}

    def at(self, key: str) -> str:
        """File and full key, for an error.

        Args:
            key: the full key, such as ``robot.r1.radius``, optionally with an index as in ``goals.r1[2]``.
        """
        start = key.partition("[")[0]
        while start:
            if start in self._others:
                return self._others[start] + key
            start = start.rpartition(".")[0]
        return f"{self.file}: {key}" if self.file else key

    def note(self, key: str, before: str) -> None:
        """Record another origin for a key and all keys under it.

        Args:
            key: the full key, or the start of it.
            before: the text before the key in an error, such as ``lab.toml:`` and a space.
        """
        self._others = {known: text for known, text in self._others.items() if not known.startswith(f"{key}.")}
        self._others[key] = before
