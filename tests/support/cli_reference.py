"""The command reference as a page: `python tests/support/cli_reference.py docs/cli.md` writes it.

Names of commands after the file limit the reference to them: the page of a plug-in has its own.
"""

import sys
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import Any

import typer

from eigenfail.cli.main import COMMANDS, DeferredCommand, app

BEGIN, END = "<!-- commands -->\n", "<!-- /commands -->\n"
EVERYWHERE = frozenset({"--url", "--json", "--help", "--data", "--database"})
"""Options that the page describes once."""


def write_commands(text: str, names: Sequence[str] = tuple(COMMANDS)) -> str:
    """Return a page with the reference of some commands, by default of all of the core."""
    head, _, rest = text.partition(BEGIN)
    tail = rest.partition(END)[2]
    return f"{head}{BEGIN}\n{describe_commands(names)}{END}{tail}"


def describe_commands(names: Sequence[str] = tuple(COMMANDS)) -> str:
    """Return the reference of some commands, in their order."""
    parts: list[str] = []
    known: Any = typer.main.get_command(app)
    for name in names:
        parts.extend(_describe_command(known.commands[name], f"eigenfail {name}", None))
    return "".join(f"{part}\n" for part in parts)


def _describe_command(command: Any, path: str, above: Any) -> Iterator[str]:
    """A command, and those below it."""
    if isinstance(command, DeferredCommand):
        command = command.load()
    context = typer.Context(command, info_name=path, parent=above)
    yield f"{'###' if above else '##'} {path}\n"
    yield f"{cleandoc(command.help)}\n"
    below = getattr(command, "commands", {})
    if not below or command.invoke_without_command:
        yield from _describe_usage(command, path, context)
    for name, inner in below.items():
        yield from _describe_command(inner, f"{path} {name}", context)


def _describe_usage(command: Any, path: str, context: typer.Context) -> Iterator[str]:
    """How a command is called, and its parameters."""
    yield f"```text\n{path} {' '.join(_list_words(command))}\n```\n"
    if rows := [row for each in command.params for row in _describe_parameter(each, context)]:
        yield "| | |\n|---|---|"
        yield "\n".join(rows) + "\n"


def _list_words(command: Any) -> Iterator[str]:
    """What a command is called with."""
    for parameter in command.params:
        if parameter.param_type_name == "argument":
            yield parameter.display_name_raw
    yield "[OPTIONS]"


def _describe_parameter(parameter: Any, context: typer.Context) -> Iterator[str]:
    """The row of a parameter; none of those that the page describes once."""
    if not EVERYWHERE.isdisjoint(parameter.opts):
        return
    shown = ", ".join(parameter.opts)
    if parameter.param_type_name == "argument":
        shown = parameter.display_name_raw
    elif not parameter.is_flag:
        shown += f" {parameter.display_type_rich(ctx=context)}".replace(" range", "")
    text = _escape_cell(parameter.help or "") + _describe_default(parameter)
    yield f"| `{_escape_cell(shown)}` | {text} |"


def _describe_default(parameter: Any) -> str:
    """What holds where an option is not given, if that says anything."""
    value = parameter.default
    if parameter.required:
        return " Required."
    if value is None or isinstance(value, bool) or callable(value) or value in ((), [], ""):
        return ""
    return f" Default: `{getattr(value, 'value', value)}`."


def _escape_cell(text: str) -> str:
    """A text that may stand in a table."""
    return text.replace("|", "\\|")


def main() -> None:
    """Write the page that is named."""
    file = Path(sys.argv[1])
    file.write_text(write_commands(file.read_text(), sys.argv[2:] or tuple(COMMANDS)))


if __name__ == "__main__":
    main()
