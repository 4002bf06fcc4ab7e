"""Every public argument of a law is documented: what it is, in which unit, in which frame; and links lead somewhere.

So is what makes poses of pictures.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import muro_zenoh

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
LAWS = ("control", "planning", "estimation", "safety", "simulation", "optics", "arcs", "geometry")
CAMERAS = ("basestation.calibration", "basestation.localization", "basestation.sources")


def _modules() -> list[str]:
    names = []
    for room in (*(f"{muro_zenoh.__name__}.{law}" for law in LAWS), *CAMERAS):
        module = importlib.import_module(room)
        names.append(module.__name__)
        if hasattr(module, "__path__"):
            names += [info.name for info in pkgutil.walk_packages(module.__path__, f"{module.__name__}.")]
    return names


def _public(module: Any) -> Iterator[tuple[str, Any]]:
    """Functions and classes that a module defines, and the classes' methods, with their full names."""
    for name, thing in vars(module).items():
        if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(thing):
            yield f"{module.__name__}.{name}", thing
            for method_name, method in vars(thing).items():
                function = method.__func__ if isinstance(method, classmethod | staticmethod) else method
                if not method_name.startswith("_") and inspect.isfunction(function):
                    yield f"{module.__name__}.{name}.{method_name}", function
        elif inspect.isfunction(thing):
            yield f"{module.__name__}.{name}", thing


def _arguments(thing: Any) -> list[str]:
    if inspect.isclass(thing):
        if dataclasses.is_dataclass(thing):
            return [field.name for field in dataclasses.fields(thing) if field.init and not field.name.startswith("_")]
        if hasattr(thing, "_fields"):
            return list(thing._fields)
        if issubclass(thing, Exception) or thing.__init__ is object.__init__ or getattr(thing, "_is_protocol", False):
            return []
        return _arguments(thing.__init__)
    names = list(inspect.signature(thing).parameters)
    return [name for name in names if name not in ("self", "cls") and not name.startswith("_")]


def _undocumented(thing: Any) -> list[str]:
    text = inspect.getdoc(thing) or ""
    if inspect.isclass(thing) and not dataclasses.is_dataclass(thing) and not hasattr(thing, "_fields"):
        text += "\n" + (inspect.getdoc(thing.__init__) or "")
    if inspect.isclass(thing):  # inherited fields are documented where they are declared
        text += "\n".join(["", *(inspect.getdoc(base) or "" for base in thing.__mro__[1:-1])])
    # An entry under Args or Attributes; or, in a small value, the field's name as ``x`` in the sentence.
    return [
        name
        for name in _arguments(thing)
        if not re.search(rf"^ +\*{{0,2}}{name}(, \w+)*:", text, re.MULTILINE)
        and not re.search(rf"^ +(\w+, )+{name}(, \w+)*:", text, re.MULTILINE)
        and not re.search(rf"``{name}``", text)
    ]


@pytest.mark.parametrize("module", _modules())
def test_every_public_argument_is_documented(module: str) -> None:
    missing = {
        name: undocumented
        for name, thing in _public(importlib.import_module(module))
        if (undocumented := _undocumented(thing))
    }
    assert not missing, "\n".join(f"{name}: say what these are: {', '.join(them)}" for name, them in missing.items())


@pytest.mark.parametrize("module", _modules())
def test_everything_public_has_a_docstring(module: str) -> None:
    loaded = importlib.import_module(module)
    bare = [name for name, thing in [(module, loaded), *_public(loaded)] if not inspect.getdoc(thing)]
    assert not bare


def test_an_undocumented_argument_is_found() -> None:
    def documented(speed: float, radius: float) -> None:
        """A law.

        Args:
            speed: how fast [m/s].
            radius: of the circle [m].
        """

    def forgotten(speed: float, radius: float) -> None:
        """A law.

        Args:
            speed: how fast [m/s], unlike the radius of the circle.
        """

    assert _undocumented(documented) == []
    assert _undocumented(forgotten) == ["radius"]


def _targets(page: str) -> list[str]:
    """The files that a page's links and pictures name, without the place in the file; none of the web."""
    prose = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)
    links = re.findall(
        r"\]\(\s*<?([^\s)>]+)|^\[[^\]]+\]:\s+(\S+)|(?:src|href|srcset)=\"([^\"]+)\"", prose, re.MULTILINE
    )
    found = (next(filter(None, groups)).partition("#")[0] for groups in links)
    return [target for target in found if target and not re.match(r"[a-z][a-z0-9+.-]*:", target)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_relative_link_leads_to_a_file(page: Path) -> None:
    gone = [target for target in _targets(page.read_text(encoding="utf-8")) if not (page.parent / target).exists()]
    assert not gone


def test_links_are_found() -> None:
    links = '[a](a.md#part) ![b](b.svg)\n[c]: c.md\n<img src="d.png">\n'
    page = links + "[web](https://x.org) [here](#part)\n```\n[e](e)\n```\n"
    assert _targets(page) == ["a.md", "b.svg", "c.md", "d.png"]
    assert sum(len(_targets(page.read_text(encoding="utf-8"))) for page in PAGES) > 40
