"""Commands that ask a service or a database, and print the answer."""

import inspect
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import wraps
from typing import Any, Protocol

import typer

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.client import Client
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.progress import announce


class Printable(Protocol):
    """The output of a command, and its exit code."""

    @property
    def exit_code(self) -> int:
        """The exit code of the command."""

    def print(self, as_json: bool) -> None:
        """Print the result as JSON, or as a table."""


def open_client(context: typer.Context, url: Url = DEFAULT_URL) -> Client:
    """Return a client of the service at an address."""
    return connect_to(context, url)


def prints_answer(
    activity: str = "", opened_by: Callable[..., AbstractContextManager[Any]] = open_client
) -> Callable[[Callable[..., Printable]], Callable[..., None]]:
    """Return a decorator that makes a command of a function from what is asked to its answer.

    The options of `opened_by`, such as --url, and --json follow the function's own parameters. So
    each command declares only what is its own.

    Args:
        activity: what standard error says where the answer takes more than a moment.
        opened_by: opens what is asked, by default a client of a service: the first argument of
            the function. The names of its parameters and the function's must differ.
    """

    def decorate(function: Callable[..., Printable]) -> Callable[..., None]:
        _, *own = inspect.signature(function).parameters.values()
        opening = inspect.signature(opened_by).parameters
        json = inspect.Parameter("as_json", inspect.Parameter.KEYWORD_ONLY, default=False)
        parameters = (*own, *opening.values(), json.replace(annotation=AsJson))

        @wraps(function)
        def command(*, as_json: bool, **given: Any) -> None:
            opened = opened_by(**{name: given.pop(name) for name in opening})
            with opened as source:
                with announce(activity) if activity else nullcontext():
                    answer = function(source, **given)
                # A view that is watched asks the service again while it is printed.
                answer.print(as_json)
            # At the end, so that the client is closed and the answer is out.
            if answer.exit_code:
                raise typer.Exit(answer.exit_code)

        # Typer reads options from the signature. By keyword, a default may precede an argument.
        by_keyword = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in parameters]
        command.__signature__ = inspect.Signature(by_keyword)  # type: ignore[attr-defined]
        return command

    return decorate
