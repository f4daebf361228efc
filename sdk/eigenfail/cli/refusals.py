"""How errors are told: one line for people, a problem as JSON for programs, and an exit code.

The JSON is one line, the last one on standard error: progress may have been told there before.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

import typer

from eigenfail.cli.wrong_values import wrong_value
from eigenfail.errors import EigenfailError, InputError

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""What typer raises where a command line cannot be read."""

JSON = "--json"
HELP_ITSELF = "NoArgsIsHelpError"
CHOICE = re.compile(r"Value error, ('(?P<given>.*)' is not one of (?P<known>'.*'))\.?")


@contextmanager
def told(as_json: bool) -> Iterator[None]:
    """Errors of ours, and of whoever typed the command, are told and become exit codes."""
    try:
        yield
    except EigenfailError as error:
        refuse(error, as_json)
    except UsageError as error:
        if type(error).__name__ == HELP_ITSELF:
            raise
        refuse(wrong_usage(error), as_json)


def refuse(error: EigenfailError, as_json: bool) -> None:
    """Tell of an error, and exit with its code."""
    from eigenfail.values.access import redacted

    typer.echo(redacted(problem_line(error) if as_json else f"eigenfail: {error}"), err=True)
    raise typer.Exit(error.exit_code) from error


def problem_line(error: EigenfailError) -> str:
    """The error as the service tells it, on one line."""
    from eigenfail.wire.http import encode
    from eigenfail.wire.problems import problem_of

    return encode(problem_of(error)).decode()


def wrong_usage(error: Any) -> InputError:
    """A command line that cannot be read, as an error of ours."""
    usage = f"See: {error.ctx.command_path} --help" if error.ctx else ""
    if wrong := wrong_value(error, usage):
        return wrong
    message, hint = error.format_message(), ""
    if options := getattr(error, "possibilities", None):
        message, hint = f"{error.message}.", f"Did you mean '{min(options)}'?"
    elif choice := CHOICE.search(message):
        message = message.replace(choice[0], f"{choice[1]}.")
        known = re.findall(r"'([^']*)'", choice["known"])
        close = get_close_matches(choice["given"], known, n=1)
        hint = f"Did you mean '{close[0]}'?" if close else ""
    message = message if message.endswith((".", "?")) else f"{message}."
    return InputError("", message, f"{hint} {usage}".strip())
