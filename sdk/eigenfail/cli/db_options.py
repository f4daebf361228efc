"""What all commands on a database take, and how they ask its own tool."""

from typing import Annotated, TypeVar

import msgspec
import typer

from eigenfail.hosting.service import database_tool

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


def said(kind: type[Kind], action: str, database: str, *options: str) -> Kind:
    """What the database's own tool answers."""
    return msgspec.json.decode(database_tool(action, database, *options), type=kind)
