"""Which file a key came from, for errors."""

from __future__ import annotations


class Origin:
    """Where the keys of a table came from: most from one file, some from a fleet file or the command line.

    Args:
        file: what most came from.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._others: dict[str, str] = {}

    def at(self, key: str) -> str:
        """File and full key, as an error names them.

        Args:
            key: the full key, such as ``robot.r1.radius``, perhaps with an index as in ``goals.r1[2]``.
        """
        start = key.partition("[")[0]
        while start:
            if start in self._others:
                return self._others[start] + key
            start = start.rpartition(".")[0]
        return f"{self.file}: {key}"

    def note(self, key: str, before: str) -> None:
        """Remember that a key, and all under it, came from elsewhere.

        Args:
            key: the full key, or the start of it.
            before: what an error shows before the key, such as ``lab.toml:`` and a space.
        """
        self._others = {known: said for known, said in self._others.items() if not known.startswith(f"{key}.")}
        self._others[key] = before
