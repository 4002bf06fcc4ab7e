"""A wheel without the page's libraries would serve a page that is dead: it is not built by mistake."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_STATIC = "basestation/dashboard/static"
_ANYWAY = "MURO_WITHOUT_PAGE"


class PageLibraries(BuildHookInterface[Any]):
    """Looks whether the libraries are there that `make setup` puts into place."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before a wheel is built; one for an editable install has no files of ours.

        Args:
            version: of the build: ``standard`` or ``editable``.
            build_data: not used.

        Raises:
            FileNotFoundError: a library is missing.
        """
        static = Path(self.root, _STATIC)
        loaded = re.findall(r'"(vendor/[^"]+)"', (static / "index.html").read_text(encoding="utf-8"))
        missing = [name for name in loaded if not (static / name).is_file()]
        if missing and version != "editable" and not os.environ.get(_ANYWAY):
            raise FileNotFoundError(
                f"{_STATIC}: got no {', '.join(missing)}, expected what the page needs: run `make setup` first, which "
                f"puts it there. For a wheel that serves no page set {_ANYWAY}=1"
            )
