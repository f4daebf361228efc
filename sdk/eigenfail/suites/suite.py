"""A suite and its members, and how one is read from a file."""

import os
from pathlib import Path
from typing import Any, Self

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.settings import convert, read_settings
from eigenfail.suites.changes import Table, changed
from eigenfail.suites.plans import MOST_MEMBERS, SuiteFile, variations
from eigenfail.suites.references import in_order
from eigenfail.toml_files import read_toml
from eigenfail.values import CampaignSpec
from eigenfail.wire.http import refuse_unknown_fields

__all__ = ["MOST_MEMBERS", "Member", "Suite"]

LIKE = "Name a TOML file with a suite, such as examples/suite.toml."


class Member(msgspec.Struct, frozen=True):
    """A campaign of a suite.

    Attributes:
        name: what sets it apart from the others, such as "alpha=5000".
        spec: its campaign, named "suite: member"; where it builds upon other members, with their
            names in place of numbers (see `suites.references`).
    """

    name: str
    spec: CampaignSpec


class Suite(msgspec.Struct, frozen=True):
    """A named set of campaigns; no two of them have one name, or are the same."""

    name: str
    members: tuple[Member, ...]

    @property
    def episodes(self) -> int:
        """The budget of all members together."""
        return sum(member.spec.episodes for member in self.members)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """The suite that a TOML file describes; its name is the file's unless it has one.

        Raises:
            UnknownName: a field that suites or campaigns do not have, or a member that builds upon
                one that there is not.
            InvalidValue: not a readable TOML file, a value outside its bounds, an axis without
                values, two members that are the same, too many, or some that wait for each other.
        """
        file = Path(path)
        written = read_settings(SuiteFile, read_toml(file, LIKE), file.name)
        return cls._written(written, written.name or file.stem, file.name)

    @classmethod
    def of(cls, name: str, **tables: Any) -> Self:
        """The suite that a file with these tables would describe.

        Args:
            name: of the suite.
            tables: base, and one of sweep, grid and campaigns, as dicts and lists.

        Raises:
            UnknownName: as for `read`.
            InvalidValue: as for `read`.
        """
        return cls._written(read_settings(SuiteFile, {**tables, "name": name}, name), name, name)

    @classmethod
    def _written(cls, written: SuiteFile, name: str, where: str) -> Self:
        """The suite of this name; errors say where it was written."""
        if "name" in written.base:
            raise InvalidValue(
                f"{where}: base.name", "cannot be given.", "The suite names its campaigns."
            )
        members = [
            member(name, variation.name, changed(written.base, variation.changes), where)
            for variation in variations(written, where)
        ]
        refuse_twins(members, where)
        in_order({each.name: each.spec for each in members}, where)
        return cls(name, tuple(members))


def member(suite: str, name: str, fields: Table, where: str) -> Member:
    """A member from the fields of its campaign.

    Raises:
        UnknownName: a field that campaigns do not have.
        InvalidValue: a value outside its bounds, or one that no JSON holds.
    """
    place = f"{where}: member '{name}'"
    refuse_unknown_fields(fields, CampaignSpec, place)
    spec = convert({**fields, "name": f"{suite}: {name}"}, CampaignSpec, place)
    refuse_what_json_changes(spec, place)
    return Member(name, spec)


def refuse_what_json_changes(spec: CampaignSpec, where: str) -> None:
    """Raises InvalidValue for dates, and for numbers that are not finite: no service keeps them."""
    try:
        sent = msgspec.json.decode(msgspec.json.encode(spec), type=CampaignSpec)
    except msgspec.MsgspecError:
        sent = None
    if sent != spec:
        raise InvalidValue(
            where,
            "holds a date, or a number that is not finite.",
            "Give plain finite numbers, text, lists and tables.",
        )


def refuse_twins(members: list[Member], where: str) -> None:
    """Raises InvalidValue if two members have one name, or are the same campaign."""
    names: set[str] = set()
    seen: dict[bytes, str] = {}
    for each in members:
        content = msgspec.json.encode(msgspec.structs.replace(each.spec, name="-"), order="sorted")
        if each.name in names:
            raise InvalidValue(where, f"has two members '{each.name}'.", DIFFERENT)
        if twin := seen.get(content):
            raise InvalidValue(where, f"'{twin}' and '{each.name}' are the same.", DIFFERENT)
        names.add(each.name)
        seen[content] = each.name


DIFFERENT = "Take one of them out, or let them differ."
