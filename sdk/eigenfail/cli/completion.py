"""What shells offer behind a word that is begun: ids of campaigns, names of plug-ins.

A shell waits for it: whatever is not at hand within a moment is not offered.
"""

import os
from typing import TYPE_CHECKING

import typer

from eigenfail.errors import EigenfailError

if TYPE_CHECKING:
    from eigenfail.client import Client

MOST = 30


def campaigns(context: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """The newest campaigns of the service that would be asked, with their names."""
    from eigenfail.cli.surroundings import address

    asked = context.params.get("url") or os.environ.get("EIGENFAIL_URL") or ""
    try:
        with connect(address(context, asked)) as client:
            found = client.campaigns.list().first(MOST) if client.health() else ()
    except (EigenfailError, OSError, ValueError):
        return []
    ids = [(str(campaign.id), campaign.spec.name) for campaign in found]
    return [(number, name) for number, name in ids if number.startswith(incomplete)]


def connect(url: str) -> "Client":
    """A client of the service at an address."""
    from eigenfail.client import Client

    return Client(url)


def planners(incomplete: str) -> list[str]:
    """The planners that are installed here."""
    return begun("eigenfail.planners", incomplete)


def scenarios(incomplete: str) -> list[str]:
    """The scenarios that are installed here."""
    return begun("eigenfail.scenarios", incomplete)


def methods(incomplete: str) -> list[str]:
    """The methods that are installed here."""
    return begun("eigenfail.methods", incomplete)


def begun(group: str, incomplete: str) -> list[str]:
    """The plug-ins of a group whose names begin so."""
    from eigenfail.plugins import names

    return [name for name in names(group) if name.startswith(incomplete)]
