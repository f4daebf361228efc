"""`eigenfail up`: the whole service on this machine, until Ctrl-C."""

import os
import time
from contextlib import suppress
from typing import Annotated

import typer

from eigenfail.bridges import ADDRESS_VARIABLE, check_address
from eigenfail.cli.options import AsJson, Bridge, Data, Workers
from eigenfail.cli.render import to_json
from eigenfail.functions import allow
from eigenfail.hosting.folder import DEFAULT_DATA, PORT, DataFolder
from eigenfail.hosting.processes import interruptible
from eigenfail.hosting.service import (
    Launcher,
    LocalService,
    Plan,
    local_service,
    make_span,
    refuse_scaling,
)

LOOK_EVERY_S = 0.2

app = typer.Typer(add_completion=False)

Port = Annotated[
    int, typer.Option(min=0, max=65535, help="Port of dashboard and API; 0: any free one.")
]
HubPort = Annotated[int, typer.Option(min=0, max=65535, help="Port for workers; 0: any free one.")]
Least = Annotated[
    int | None,
    typer.Option(
        "--min-workers", min=0, help="Minimum number of workers, kept without work too (default 0)."
    ),
]
Most = Annotated[
    int | None,
    typer.Option("--max-workers", min=0, help="Scale workers with the work, up to this number."),
]
Idle = Annotated[
    float | None,
    typer.Option("--idle-s", help="Time after which idle workers are stopped (default 60). [s]"),
]
Verbose = Annotated[bool, typer.Option("--verbose", help="Also print the logs of the processes.")]
Functions = Annotated[
    str | None,
    typer.Option(help="Comma-separated modules whose functions campaigns may name (default none)."),
]
Launch = Annotated[Launcher, typer.Option(help="What starts the workers.")]


@app.command()
def up(
    data: Data = DEFAULT_DATA,
    port: Port = PORT,
    workers: Workers = 0,
    min_workers: Least = None,
    max_workers: Most = None,
    idle_s: Idle = None,
    launcher: Launch = Launcher.RAY,
    hub_port: HubPort = 0,
    bridge: Bridge = None,
    functions: Functions = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Start the service on this machine, on an embedded database.

    Prints its address when it is ready, and runs until Ctrl-C or SIGTERM; then all of its processes
    are stopped. Logs are files in the data folder.
    """
    if bridge:
        os.environ[ADDRESS_VARIABLE] = check_address(bridge)
    # Before the services start, which inherit it: an operator names modules, never a request.
    if functions:
        allow(functions)
    if launcher is Launcher.NONE:
        refuse_scaling(min_workers, max_workers, idle_s)
    span = make_span(workers or None, min_workers, max_workers, idle_s)
    plan = Plan(data, port, workers, launcher, hub_port, span)
    with interruptible(), suppress(KeyboardInterrupt), local_service(plan) as service:
        typer.echo(
            to_json(service.address, indent=0) if as_json else _describe_service(service, plan)
        )
        try:
            _watch(service, verbose)
        except KeyboardInterrupt:  # ending all processes takes a moment
            typer.echo("Stopping. Running campaigns continue at the next start.", err=True)
            raise


def _describe_service(service: LocalService, plan: Plan) -> str:
    """Where it is, and what to do with it."""
    key = " --key-file FILE" if DataFolder(plan.data).hub_keys.exists() else ""
    return (
        f"eigenfail is up at {service.address.url} (data in {plan.data}; Ctrl-C stops it).\n"
        f"More workers: eigenfail worker --connect {service.address.hub}{key}"
    )


def _watch(service: LocalService, verbose: bool) -> None:
    """Stay until interrupted; raises ServiceError if a process ends by itself."""
    while True:
        service.check()
        if verbose:
            for part in service.parts:
                typer.echo("".join(f"{part.name}: {line}\n" for line in part.news()), nl=False)
        time.sleep(LOOK_EVERY_S)
