"""What all commands on a database take, and how they ask its own tool."""

from typing import Annotated, TypeVar

import msgspec
import typer

from eigenfail.hosting.service import database_tool
from eigenfail.values.upkeep import Verification

Kind = TypeVar("Kind")

Database = Annotated[
    str | None,
    typer.Option(
        "--database",
        envvar="EIGENFAIL_DATABASE",
        help="SQLAlchemy URL, instead of the data folder's database.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
Replay = Annotated[
    int, typer.Option("--replay", min=0, help="Run so many stored episodes again, here.")
]
Repair = Annotated[
    bool,
    typer.Option(
        "--repair", help="First count anew what is miscounted, and remove jobs that are left over."
    ),
]


def said(kind: type[Kind], action: str, database: str, *options: str) -> Kind:
    """What the database's own tool answers."""
    return msgspec.json.decode(database_tool(action, database, *options), type=kind)


def verified(database: str, replay: int, repair: bool) -> Verification:
    """A database, held against what is promised of it; with `repair`, mended first."""
    options = [f"--replay={replay}", *["--repair"] * repair]
    return said(Verification, "verify", database, *options)
