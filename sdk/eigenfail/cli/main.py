"""`eigenfail`: every command.

0 done, 1 failures found (with --gate), 2 wrong usage, 3 service trouble, 130 interrupted.
"""

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from eigenfail import __version__
from eigenfail.cli.lazy import DeferredCommand
from eigenfail.cli.refusals import JSON, told
from eigenfail.uncaught import print_uncaught, tell_uncaught

COMMANDS = {
    "up": "Start the service on this machine, on an embedded database.",
    "run": "Run the campaign that a TOML file describes, and print its results.",
    "campaign": "Create, follow and steer campaigns.",
    "suite": "Run many campaigns as one: a sweep, a grid, or a list of them.",
    "episode": "Look at episodes, and run them again.",
    "analyze": "Group the failures of a campaign into failure modes.",
    "margin": "Find by bisection how much noise a planner bears before it fails.",
    "compare": "Compare two campaigns, or several seeds of each.",
    "gate": "Judge a new version of a planner by the failures of an earlier one.",
    "report": "Write a report on campaigns: one HTML file that needs nothing else, and its data.",
    "reproduce": "Run the paper's experiments, and print its tables with our numbers beside them.",
    "worker": "Run one worker for a service that runs elsewhere, or list those that it has.",
    "key": "Make, list, limit and revoke keys; read who changed what.",
    "db": "Create, upgrade, check, back up, restore and thin out a database.",
    "doctor": "Say what is installed, what answers and what is missing.",
}


class Commands(TyperGroup):
    """The commands; an error raised on purpose is one sentence and an exit code."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        for name, text in COMMANDS.items():
            self.add_command(DeferredCommand(name, text, f"eigenfail.cli.{name}"))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read what stands before the command."""
        ctx.meta[JSON] = JSON in args
        with told(ctx.meta[JSON]):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        with told(ctx.meta[JSON]):
            return super().invoke(ctx)


EPILOG = (
    "To begin: eigenfail doctor, eigenfail up and, in another terminal, eigenfail run FILE.toml. "
    "Every command takes --json. Exit codes: 0 done, 1 failures found or something differs, "
    "2 wrong usage, 3 service trouble, 130 interrupted."
)

app = typer.Typer(cls=Commands, no_args_is_help=True, pretty_exceptions_enable=False, epilog=EPILOG)


def show_version(wanted: bool) -> None:
    """Print the version, if it was asked for, and end."""
    if wanted:
        typer.echo(f"eigenfail {__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=show_version, is_eager=True, help="Print the version.")
]


@app.callback()
def eigenfail(version: Version = False) -> None:
    """Find the rare failures of a driving stack, group them into modes, prove and price them."""


def main() -> None:
    """The command line."""
    tell_uncaught()
    try:
        app()
    except Exception as error:  # noqa: BLE001 - typer sets a hook of its own, which hides nothing
        print_uncaught(error)
        sys.exit(1)
