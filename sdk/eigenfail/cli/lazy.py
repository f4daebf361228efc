"""Commands that are loaded when they are called, not when they are listed.

`eigenfail --help` and shell completion must answer at once; numpy and the HTTP client take longer.
"""

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand


class DeferredCommand(TyperCommand):
    """Stands in for the command, or the group of commands, that a module calls `app`."""

    def __init__(self, name: str, text: str, module: str) -> None:
        super().__init__(name, help=text)
        self.module = module

    def load(self) -> Any:
        """The command itself."""
        return typer.main.get_command(import_module(self.module).app)

    def make_context(self, *args: Any, **extra: Any) -> Any:
        """The context of the command itself: from here on it answers."""
        return self.load().make_context(*args, **extra)
