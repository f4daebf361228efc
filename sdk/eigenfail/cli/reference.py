"""The commands as a page: `python -m eigenfail.cli.reference docs/cli.md` writes it anew."""

import sys
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path
from typing import Any

import typer

from eigenfail.cli.lazy import DeferredCommand
from eigenfail.cli.main import COMMANDS

BEGIN, END = "<!-- commands -->\n", "<!-- /commands -->\n"
EVERYWHERE = frozenset({"--url", "--json", "--help"})
"""Options that the page describes once."""


def page(text: str) -> str:
    """The page with the commands as they are now."""
    head, _, rest = text.partition(BEGIN)
    tail = rest.partition(END)[2]
    return f"{head}{BEGIN}\n{commands()}{END}{tail}"


def commands() -> str:
    """All commands, in the order of `eigenfail --help`."""
    parts: list[str] = []
    for name in COMMANDS:
        command = DeferredCommand(name, "", f"eigenfail.cli.{name}").load()
        parts.extend(told(command, f"eigenfail {name}", None))
    return "".join(f"{part}\n" for part in parts)


def told(command: Any, path: str, above: Any) -> Iterator[str]:
    """A command, and those below it."""
    context = typer.Context(command, info_name=path, parent=above)
    yield f"{'###' if above else '##'} {path}\n"
    yield f"{cleandoc(command.help)}\n"
    below = getattr(command, "commands", {})
    if not below or command.invoke_without_command:
        yield from used(command, path, context)
    for name, inner in below.items():
        yield from told(inner, f"{path} {name}", context)


def used(command: Any, path: str, context: typer.Context) -> Iterator[str]:
    """How a command is called, and its parameters."""
    yield f"```text\n{path} {' '.join(words(command))}\n```\n"
    if rows := [row for each in command.params for row in described(each, context)]:
        yield "| | |\n|---|---|"
        yield "\n".join(rows) + "\n"


def words(command: Any) -> Iterator[str]:
    """What a command is called with."""
    for parameter in command.params:
        if parameter.param_type_name == "argument":
            yield parameter.display_name_raw
    yield "[OPTIONS]"


def described(parameter: Any, context: typer.Context) -> Iterator[str]:
    """The row of a parameter; none of those that every command has."""
    if not EVERYWHERE.isdisjoint(parameter.opts):
        return
    shown = ", ".join(parameter.opts)
    if parameter.param_type_name == "argument":
        shown = parameter.display_name_raw
    elif not parameter.is_flag:
        shown += f" {parameter.display_type_rich(ctx=context)}".replace(" range", "")
    yield f"| `{cell(shown)}` | {cell(parameter.help or '')}{default(parameter)} |"


def default(parameter: Any) -> str:
    """What holds where an option is not given, if that says anything."""
    value = parameter.default
    if parameter.required:
        return " Required."
    if value is None or isinstance(value, bool) or callable(value) or value == ():
        return ""
    return f" Default: `{getattr(value, 'value', value)}`."


def cell(text: str) -> str:
    """A text that may stand in a table."""
    return text.replace("|", "\\|")


def main() -> None:
    """Write the page that is named."""
    file = Path(sys.argv[1])
    file.write_text(page(file.read_text()))


if __name__ == "__main__":
    main()
