"""What commands need from outside; tests hand in their own."""

import os
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import httpx2
import typer

from eigenfail.cli.options import DEFAULT_DATA, DEFAULT_URL
from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DataFolder


@dataclass(frozen=True)
class Surroundings:
    """How the command line reaches a service."""

    connect: Callable[[str], Client] = Client


def client_at(context: typer.Context, url: str) -> Client:
    """A client of the service at an address.

    Raises:
        InvalidValue: it is not an address.
    """
    url = address(context, url)
    surroundings = context.find_object(Surroundings) or Surroundings()
    try:
        return surroundings.connect(url)
    except (httpx2.InvalidURL, ValueError) as error:
        raise InvalidValue("url", f"'{url}' is not an address: {error}.") from error


def address(context: typer.Context, url: str) -> str:
    """The address that was asked for, or else that of the service that runs on the data folder.

    So `eigenfail up --port 0` is found by commands that are called from the same place.
    """
    if url not in {"", DEFAULT_URL} or not is_default(context, "url"):
        return url
    running = DataFolder(context.params.get("data") or usual_folder()).address()
    return running.url if running else DEFAULT_URL


def is_default(context: typer.Context, option: str) -> bool:
    """Whether nobody gave an option, neither as a word nor in the environment."""
    source = context.get_parameter_source(option)
    return source is None or source.name == "DEFAULT"


def usual_folder() -> Path:
    """The data folder of commands that are not told of one."""
    return Path(os.environ.get("EIGENFAIL_DATA") or DEFAULT_DATA)


def this_command() -> str:
    """The command that was given, to be given again."""
    return shlex.join(["eigenfail", *sys.argv[1:]])
