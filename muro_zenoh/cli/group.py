"""A click group that reports errors in one line and imports commands only when they are used."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import click

from muro_zenoh.errors import INTERRUPTED, ConfigError, MuroError


class MuroGroup(click.Group):
    """A group whose commands report this project's errors in one line: exit code 2 for invalid settings, otherwise 1.

    Ctrl-C in a command that does not handle it is exit code 130, so that 1 never means that somebody was impatient.

    Args:
        lazy: its commands as ``module:attribute`` by name. A robot's process imports only the module of its own
            command.
        arguments: arguments for click.
    """

    def __init__(self, *arguments: Any, lazy: Mapping[str, str] | None = None, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._lazy = lazy or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*super().list_commands(ctx), *self._lazy})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in self._lazy and cmd_name not in self.commands:
            module, _, attribute = self._lazy[cmd_name].partition(":")
            self.add_command(getattr(importlib.import_module(module), attribute), cmd_name)
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MuroError as error:
            click.echo(f"{ctx.find_root().info_name}: {error}", err=True)
            ctx.exit(2 if isinstance(error, ConfigError) else 1)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            ctx.exit(INTERRUPTED)
