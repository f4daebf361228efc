"""From a suite's file to what varies: a sweep, a grid, or campaigns one by one."""

from collections.abc import Callable, Mapping
from itertools import product
from math import prod
from typing import Any, NamedTuple

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.suites.changes import Changes, Path, Table, label, leaves, short_names, value_at
from eigenfail.values.campaign import Name

MOST_MEMBERS = 1000

Axes = Mapping[Path, list[Any]]


class SuiteFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A suite as it is written.

    Attributes:
        name: of the suite; the file's unless given.
        base: fields of a campaign that all members share unless they vary them.
        sweep: lists of values; each varied alone around the base, which is a member itself.
        grid: lists of values; every combination of them.
        campaigns: what each differs in from the base, and possibly its name.
    """

    name: Name | None = None
    base: Table = {}
    sweep: Table = {}
    grid: Table = {}
    campaigns: list[Table] = []


class Variation(NamedTuple):
    """A member to be: its name, and how it differs from the base."""

    name: str
    changes: Changes


def variations(suite: SuiteFile, where: str) -> list[Variation]:
    """The members in order.

    Args:
        suite: what was written.
        where: the file's name, for errors.

    Raises:
        InvalidValue: not one of sweep, grid and campaigns, an axis without values, or too many
            members.
    """
    used = [way for way in WAYS if getattr(suite, way)]
    if len(used) != 1:
        raise InvalidValue(
            where,
            f"has {' and '.join(used) or 'nothing to run'}.",
            f"Give exactly one of {', '.join(WAYS)}, and in it at least one entry.",
        )
    return WAYS[used[0]](suite, where)


def swept(suite: SuiteFile, where: str) -> list[Variation]:
    """The base, and each value of each axis alone; a value that the base has is the base."""
    axes = read_axes(suite.sweep, f"{where}: sweep")
    refuse_too_many(1 + sum(map(len, axes.values())), where)
    around = (
        {path: value}
        for path, values in axes.items()
        for value in values
        if value != value_at(suite.base, path)
    )
    return named([{}, *around])


def crossed(suite: SuiteFile, where: str) -> list[Variation]:
    """Every combination of the axes' values, the last axis varied first."""
    axes = read_axes(suite.grid, f"{where}: grid")
    refuse_too_many(prod(map(len, axes.values())), where)
    return named([dict(zip(axes, values, strict=True)) for values in product(*axes.values())])


def listed(suite: SuiteFile, where: str) -> list[Variation]:
    """The campaigns that were written down one by one; those without a name get one."""
    refuse_too_many(len(suite.campaigns), where)
    unnamed = [
        {name: value for name, value in campaign.items() if name != "name"}
        for campaign in suite.campaigns
    ]
    made = named([dict(leaves(campaign)) for campaign in unnamed])
    return [
        Variation(str(campaign.get("name", variation.name)), variation.changes)
        for campaign, variation in zip(suite.campaigns, made, strict=True)
    ]


WAYS: dict[str, Callable[[SuiteFile, str], list[Variation]]] = {
    "sweep": swept,
    "grid": crossed,
    "campaigns": listed,
}


def read_axes(table: Table, where: str) -> Axes:
    """The lists of values in a table, each with its path in a campaign.

    Raises:
        InvalidValue: something else than a list, an empty one, or the campaigns' names.
    """
    axes = dict(leaves(table))
    for path, values in axes.items():
        axis = f"{where}.{'.'.join(path)}"
        if not isinstance(values, list):
            raise InvalidValue(axis, "is not a list.", "Write the values to try as [1, 2, 3].")
        if not values:
            raise InvalidValue(axis, "has no values.", "Give some, or take the axis out.")
        if path == ("name",):
            raise InvalidValue(axis, "cannot vary.", "Names are made of what else varies.")
    return axes


def named(variations: list[Changes]) -> list[Variation]:
    """Each with a name made of what varies."""
    names = short_names(path for changes in variations for path in changes)
    return [Variation(label(changes, names), changes) for changes in variations]


def refuse_too_many(members: int, where: str) -> None:
    """Raises InvalidValue if a suite would have more members than anybody meant."""
    if members > MOST_MEMBERS:
        raise InvalidValue(
            where,
            f"has {members} members, more than {MOST_MEMBERS}.",
            "Take values out, or split it into several suites.",
        )
