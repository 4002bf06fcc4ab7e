"""The file of each key, for errors."""

from __future__ import annotations


class Origin:
    """The origin of the keys of a table: most are from one file, some from a fleet file or the command line.

    Args:
        file: the main file; empty for an order, whose keys speak for themselves.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._others: dict[str, tuple[str, str]] = {}

    def at(self, key: str) -> str:
        """File and full key, for an error.

        Args:
            key: the full key, such as ``robot.r1.radius``, optionally with an index as in ``goals.r1[2]``.
        """
        start = key
        while start:
            if start in self._others:
                before, there = self._others[start]
                return before + there + key[len(start) :]
            start = start[: max(start.rfind("."), start.rfind("["), 0)]
        return f"{self.file}: {key}" if self.file else key

    def note(self, key: str, before: str, there: str = "") -> None:
        """Record another origin for a key and all keys under it.

        Args:
            key: the full key, or the start of it, optionally with an index.
            before: the text before the key in an error, such as ``lab.toml:`` and a space.
            there: what the key is called there; empty when it is called the same.
        """
        under = (f"{key}.", f"{key}[")
        self._others = {known: other for known, other in self._others.items() if not known.startswith(under)}
        self._others[key] = before, there or key
