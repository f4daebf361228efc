"""What commands need from outside; tests hand in their own."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass

import httpx2
import typer
from stamina.instrumentation import set_on_retry_hooks

from eigenfail.client import Client
from eigenfail.errors import InvalidValue


@dataclass(frozen=True)
class Surroundings:
    """How the command line reaches a service."""

    connect: Callable[[str], Client] = Client


def client_at(context: typer.Context, url: str) -> Client:
    """A client of the service at an address.

    Raises:
        InvalidValue: it is not an address.
    """
    # Otherwise every retry is logged on standard output, amidst the results.
    set_on_retry_hooks(())
    surroundings = context.find_object(Surroundings) or Surroundings()
    try:
        return surroundings.connect(url)
    except (httpx2.InvalidURL, ValueError) as error:
        raise InvalidValue("url", f"'{url}' is not an address: {error}.") from error


def this_command() -> str:
    """The command that was given, to be given again."""
    return shlex.join(["eigenfail", *sys.argv[1:]])
