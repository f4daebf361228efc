"""`eigenfail worker`: one worker by hand, wherever the hub can be reached; and who works."""

import re
import runpy
import sys
from importlib.util import find_spec
from typing import Annotated

import typer

from eigenfail.cli.options import AsJson
from eigenfail.cli.output import to_json
from eigenfail.cli.worker_lists import list_workers
from eigenfail.errors import InvalidValue, ServiceError

ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[\w.-]+):[1-9]\d{0,4}")
PROGRAM = "eigenfail_workers"

app = typer.Typer(add_completion=False)

Connect = Annotated[
    str | None, typer.Option(help="Address of the hub, as 'eigenfail up' prints it.")
]
Name = Annotated[str | None, typer.Option(help="Name in lists and logs.")]


@app.callback(invoke_without_command=True)
def worker(
    context: typer.Context, connect: Connect = None, name: Name = None, as_json: AsJson = False
) -> None:
    """Run one worker for a service that runs elsewhere, or list those that it has.

    Ctrl-C or SIGTERM hands over what is finished and ends it.
    """
    if context.invoked_subcommand is None:
        run_worker(connect or "", name, as_json)


def run_worker(connect: str, name: str | None, as_json: bool) -> None:
    """Be a worker until interrupted.

    Raises:
        InvalidValue: no address of a hub.
        ServiceError: the worker is not installed here.
    """
    if not ADDRESS.fullmatch(connect):
        problem = f"'{connect}' is not of the form tcp://host:port." if connect else "is not given."
        raise InvalidValue("--connect", problem, "`eigenfail up` prints the hub's address.")
    if find_spec("zmq") is None:
        raise ServiceError(
            "The worker is not installed here.", "Run: pip install 'eigenfail[worker]'"
        )
    words = f"A worker for the hub at {connect}; Ctrl-C ends it."
    typer.echo(to_json({"hub": connect, "name": name}, indent=0) if as_json else words)
    sys.argv[1:] = ["--connect", connect, *([] if name is None else ["--name", name])]
    runpy.run_module(PROGRAM, run_name="__main__")


app.command("list")(list_workers)
