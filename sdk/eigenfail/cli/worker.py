"""`eigenfail worker`: run one worker wherever the hub can be reached; list workers."""

import re
import runpy
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from eigenfail.bridges import ADDRESS_OPTION, EPISODE_OPTION, EPISODE_VARIABLE
from eigenfail.cli.answers import prints_answer
from eigenfail.cli.main import DeferredCommand, load_server_app
from eigenfail.cli.options import AsJson, Bridge, Watched
from eigenfail.cli.render import TerminalView, to_json
from eigenfail.client import Client
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.presentation import tables
from eigenfail.presentation.figures import format_local_time
from eigenfail.presentation.workers import PACKAGE, WorkerActivity, combine_activity
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.operations import ACTIVE_S, DAY_S
from eigenfail.wire.keys import WORKER_KEY_VARIABLE

NO_WORKER = (
    "No worker is connected, and no results arrived in the last {} s. "
    "eigenfail doctor reports what is missing."
)

Within = Annotated[
    int,
    typer.Option(
        "--within-s", min=ACTIVE_S, max=DAY_S, help="Include workers with results in this time. [s]"
    ),
]


Seen = tuple[tuple[WorkerActivity, ...], tuple[Campaign, ...]]
"""Workers, and the campaigns that are running."""


@prints_answer()
def list_workers(
    client: Client, within_s: Within = 600, watched: Watched = False
) -> TerminalView[Seen]:
    """List connected workers and those with recent results; latest results first."""

    def look() -> Seen:
        # Campaigns first: once none runs any more, the workers' counts are the last ones.
        running = tuple(client.campaigns.list(CampaignState.RUNNING))
        at_work = client.workers(ACTIVE_S)
        present, recent = client.present_workers(), client.workers(within_s)
        return combine_activity(present, recent, at_work), running

    return TerminalView(
        look=look,
        campaigns=lambda seen: seen[1],
        to_data=lambda seen: seen[0],
        describe=lambda seen: _describe_activity(seen[0], within_s),
        watched=watched,
    )


def _describe_activity(
    workers: Sequence[WorkerActivity], within_s: int
) -> tuple[tables.Block, ...]:
    """One row for each worker, or that there is none."""
    if not workers:
        return (NO_WORKER.format(within_s),)
    table = tables.tabulate(
        "Workers",
        workers,
        tables.read_text("Worker", "worker"),
        tables.read_text("Host", lambda each: each.host or None),
        tables.read_text(PACKAGE, lambda each: each.version or None),
        tables.read_text("State", "state"),
        tables.read_number("Campaigns", lambda each: len(each.campaigns)),
        tables.read_number("Episodes", "episodes"),
        tables.read_number("Failures", "failures"),
        tables.read_number("Errored", "errored"),
        tables.read_text("Last result", lambda each: format_local_time(each.last_ms)),
    )
    return (table,)


ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[\w.-]+):[1-9]\d{0,4}")
PROGRAM = "eigenfail_workers"

KEY_HELP = "Create, rotate, list and revoke keys of workers."


class WorkerCommands(TyperGroup):
    """`eigenfail worker`, below which the server's package brings the keys of workers."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.add_command(DeferredCommand("key", KEY_HELP, partial(load_server_app, "worker-key")))


app = typer.Typer(cls=WorkerCommands, add_completion=False)

Connect = Annotated[
    str | None, typer.Option(help="Address of the hub, as 'eigenfail up' prints it.")
]
Name = Annotated[str | None, typer.Option(help="Name in lists and logs.")]
KeyFile = Annotated[
    Path | None,
    typer.Option(
        envvar=WORKER_KEY_VARIABLE,
        help="File of the worker's key, as 'worker key create' writes it.",
    ),
]

MemoryLimit = Annotated[
    float | None,
    typer.Option(
        envvar="EIGENFAIL_MEMORY_LIMIT_MIB",
        help="Memory limit of simulator and planner, including their child processes. [MiB]",
    ),
]

CpuLimit = Annotated[
    float | None,
    typer.Option(
        envvar="EIGENFAIL_CPU_LIMIT_S",
        help="Processor time limit of an episode, over all of its processes. [s]",
    ),
]

OutputLimit = Annotated[
    float | None,
    typer.Option(
        envvar="EIGENFAIL_OUTPUT_LIMIT_KIB",
        help="Maximum logged output per episode; further output is dropped. [KiB]",
    ),
]

EpisodeLimit = Annotated[
    float | None,
    typer.Option(
        EPISODE_OPTION,
        envvar=EPISODE_VARIABLE,
        help="Wall time limit of an episode (default 60). [s]",
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
    output_limit: OutputLimit = None,
    episode_limit: EpisodeLimit = None,
    bridge: Bridge = None,
    as_json: AsJson = False,
) -> None:
    """Run one worker for a service, or list the workers of a service.

    Ctrl-C or SIGTERM stops the worker after it has delivered finished episodes.
    """
    if context.invoked_subcommand is None:
        options = {
            "--name": name,
            "--key-file": key_file,
            "--memory-limit": memory_limit,
            "--cpu-limit": cpu_limit,
            "--output-limit": output_limit,
            EPISODE_OPTION: episode_limit,
            ADDRESS_OPTION: bridge,
        }
        _run_worker(connect or "", options, as_json)


def _run_worker(connect: str, options: Mapping[str, object], as_json: bool) -> None:
    """Be a worker until interrupted.

    Raises:
        InvalidValue: no address of a hub.
        ServiceError: the worker is not installed here.
    """
    if not ADDRESS.fullmatch(connect):
        problem = f"'{connect}' is not of the form tcp://host:port." if connect else "is not given."
        raise InvalidValue("--connect", problem, "`eigenfail up` prints the hub's address.")
    # Said here, since the import below would fail with the name of a module.
    if find_spec("zmq") is None:
        raise ServiceError(
            "The worker is not installed here.",
            "Run in a clone: pip install '.[worker]'",
        )
    words = f"A worker for the hub at {connect}; Ctrl-C ends it."
    started = {"hub": connect, "name": options["--name"]}
    typer.echo(to_json(started, indent=0) if as_json else words)
    given = {"--connect": connect, **options}
    # The worker reads the command line itself: `python -m eigenfail_workers` is the same program.
    sys.argv[1:] = [f"{option}={value}" for option, value in given.items() if value is not None]
    runpy.run_module(PROGRAM, run_name="__main__")


app.command("list")(list_workers)
