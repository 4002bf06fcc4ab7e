"""What a wheel is not built from: a tree without the page's libraries, and, when it is compiled, a checkout."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_STATIC = "basestation/dashboard/static"
_ANYWAY = "MURO_WITHOUT_PAGE"


class FitForAWheel(BuildHookInterface[Any]):
    """Looks at the tree before a wheel is built from it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before a wheel is built; one for an editable install has no files of ours.

        Args:
            version: of the build: ``standard`` or ``editable``.
            build_data: not used.

        Raises:
            FileNotFoundError: a library of the page is missing.
            RuntimeError: compiled modules would be put into a tree whose sources are edited.
        """
        if "mypyc" in self.build_config.hook_config:
            self._refuse_sources(version)
        if version != "editable":
            self._require_page()

    def _refuse_sources(self, version: str) -> None:
        """hatch-mypyc compiles to beside the sources, and Python prefers what is there to a source that has changed."""
        unpacked = Path(self.root, "PKG-INFO").is_file()
        if version == "editable" or not unpacked:
            raise RuntimeError(
                f"got {'an editable install' if unpacked else self.root}, expected an unpacked source distribution to "
                "compile: compiled modules beside a source would go on running when it is edited. Run `make compiled`, "
                "or unset HATCH_BUILD_HOOKS_ENABLE and HATCH_BUILD_HOOK_ENABLE_MYPYC"
            )

    def _require_page(self) -> None:
        """A wheel without the page's libraries would serve a page that is dead."""
        static = Path(self.root, _STATIC)
        loaded = re.findall(r'"(vendor/[^"]+)"', (static / "index.html").read_text(encoding="utf-8"))
        missing = [name for name in loaded if not (static / name).is_file()]
        if missing and not os.environ.get(_ANYWAY):
            raise FileNotFoundError(
                f"{_STATIC}: got no {', '.join(missing)}, expected what the page needs: run `make setup` first, which "
                f"puts it there. For a wheel that serves no page set {_ANYWAY}=1"
            )
