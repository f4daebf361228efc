"""`eigenfail worker`: one worker by hand, wherever the hub can be reached; and who works."""

import re
import runpy
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.bridges import ADDRESS_OPTION, EPISODE_OPTION, EPISODE_VARIABLE
from eigenfail.cli import worker_keys
from eigenfail.cli.options import AsJson, Bridge
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
KeyFile = Annotated[
    Path | None,
    typer.Option(
        envvar="EIGENFAIL_WORKER_KEY_FILE",
        help="Of its key, for a hub that asks for one; 'worker key create' makes it.",
    ),
]

MemoryLimit = Annotated[
    float | None,
    typer.Option(
        envvar="EIGENFAIL_MEMORY_LIMIT_MIB",
        help="What simulator and planner may take, with all that they start. [MiB]",
    ),
]

CpuLimit = Annotated[
    float | None,
    typer.Option(
        envvar="EIGENFAIL_CPU_LIMIT_S",
        help="Processor time that they may take for an episode, all together. [s]",
    ),
]


EpisodeLimit = Annotated[
    float | None,
    typer.Option(
        EPISODE_OPTION,
        envvar=EPISODE_VARIABLE,
        help="Wall time of an episode; one that takes longer is given up. 60 by default. [s]",
    ),
]


@app.callback(invoke_without_command=True)
def worker(
    context: typer.Context,
    connect: Connect = None,
    name: Name = None,
    key_file: KeyFile = None,
    memory_limit: MemoryLimit = None,
    cpu_limit: CpuLimit = None,
    episode_limit: EpisodeLimit = None,
    bridge: Bridge = None,
    as_json: AsJson = False,
) -> None:
    """Run one worker for a service that runs elsewhere, or list those that it has.

    Ctrl-C or SIGTERM hands over what is finished and ends it.
    """
    if context.invoked_subcommand is None:
        options = {
            "--name": name,
            "--key-file": key_file,
            "--memory-limit": memory_limit,
            "--cpu-limit": cpu_limit,
            EPISODE_OPTION: episode_limit,
            ADDRESS_OPTION: bridge,
        }
        run_worker(connect or "", options, as_json)


def run_worker(connect: str, options: Mapping[str, object], as_json: bool) -> None:
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
    told = {"hub": connect, "name": options["--name"]}
    typer.echo(to_json(told, indent=0) if as_json else words)
    given = {"--connect": connect, **options}
    sys.argv[1:] = [f"{option}={value}" for option, value in given.items() if value is not None]
    runpy.run_module(PROGRAM, run_name="__main__")


app.command("list")(list_workers)
app.add_typer(worker_keys.app, name="key")
