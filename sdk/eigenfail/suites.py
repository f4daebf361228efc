"""Suites: named sets of campaigns that are run, resumed and shown as one.

A suite's file has a base and either a sweep, a grid or a list of campaigns. Each member differs
from the base by values at paths in the specification, and may refer to other members by name.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from hashlib import sha256
from itertools import product
from math import isnan, prod
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.files import TableColumns, read_table, read_toml
from eigenfail.settings import convert, read_settings
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, Name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.variation import MOST_SAMPLES
from eigenfail.wire.http import make_plain

KeyPath = tuple[str, ...]
Changes = Mapping[KeyPath, Any]
LIKE_MODEL = "Name a TOML file with the fields of [disturbance]."
Table = dict[str, Any]

BASE = "base"


def list_leaves(table: Table, above: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Yield each value in a table and in its inner tables, with its path."""
    for name, value in table.items():
        path = (*above, name)
        if isinstance(value, dict) and value:
            yield from list_leaves(value, path)
        else:
            yield path, value


def read_path(table: Table, path: KeyPath) -> Any:
    """Return the value at a path; None if there is none."""
    here: Any = table
    for name in path:
        here = here.get(name) if isinstance(here, dict) else None
    return here


def set_path(table: Table, path: KeyPath, value: Any) -> Table:
    """Return a copy of the table with the value at the path."""
    name, *rest = path
    if not rest:
        return {**table, name: value}
    inner = table.get(name)
    return {**table, name: set_path(inner if isinstance(inner, dict) else {}, tuple(rest), value)}


def _apply_changes(table: Table, changes: Changes) -> Table:
    for path, value in changes.items():
        table = set_path(table, path, value)
    return table


def _name_member(changes: Changes, names: Mapping[KeyPath, str]) -> str:
    """Return a name such as "alpha=5000, planner=idm"."""
    return (
        ", ".join(f"{names[path]}={format_value(value)}" for path, value in changes.items()) or BASE
    )


def shorten_paths(paths: Iterable[KeyPath]) -> dict[KeyPath, str]:
    """Return a short name of each path: its last key if unique, otherwise the whole path."""
    different = list(dict.fromkeys(paths))
    ends = Counter(path[-1] for path in different)
    return {path: path[-1] if ends[path[-1]] == 1 else ".".join(path) for path in different}


def format_value(value: Any) -> str:
    """Return the shortest text that identifies the value."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        short = f"{value:g}"
        # Two values that round to the same text would give two members one name.
        return short if float(short) == value else repr(value)
    return msgspec.json.encode(value).decode()


LEAST_SEEDS = 2
MOST_MEMBERS = 1000

Axes = Mapping[KeyPath, list[Any]]


class SuiteFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contents of a suite's file.

    Attributes:
        name: name of the suite; by default the name of the file.
        base: fields of a campaign that all members share unless they vary them.
        sweep: lists of values, each varied alone around the base, which is a member itself.
        grid: lists of values; every combination is a member.
        campaigns: for each member, the fields that differ from the base, and optionally its name.
    """

    name: Name | None = None
    base: Table = {}
    sweep: Table = {}
    grid: Table = {}
    campaigns: list[Table] = []


class SuiteRequest(SuiteFile, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A suite that a service is to create, with the fields of a suite's file.

    Attributes:
        name: name of the suite.
    """

    name: Name


def describes_suite(table: Mapping[str, Any]) -> bool:
    """Return whether a TOML table is a suite: with base or members, without a method at the top."""
    return "method" not in table and not table.keys().isdisjoint({"base", *WAYS})


class _Variation(NamedTuple):
    """A member's name, and its differences from the base."""

    name: str
    changes: Changes


def _list_variations(suite: SuiteFile, where: str) -> list[_Variation]:
    """List the members in order; `where` is the file's name in errors.

    Raises:
        InvalidValue: not exactly one of sweep, grid and campaigns is given, an axis is empty, or
            there are too many members.
    """
    used = [way for way in WAYS if getattr(suite, way)]
    if len(used) != 1:
        raise InvalidValue(
            where,
            f"has {' and '.join(used) or 'nothing to run'}.",
            f"Give exactly one of {', '.join(WAYS)}, and in it at least one entry.",
        )
    return WAYS[used[0]](suite, where)


def expand_suite(suite: SuiteFile, where: str) -> list[tuple[str, Table]]:
    """Return name and fields of each member, in order, without checking the fields.

    Args:
        suite: contents of a suite's file.
        where: the file's name in errors.

    Raises:
        InvalidValue: not exactly one of sweep, grid and campaigns is given, an axis is empty, there
            are too many members, or the base has a name.
    """
    if "name" in suite.base:
        raise InvalidValue(
            f"{where}: base.name", "cannot be given.", "The suite names its campaigns."
        )
    return [
        (variation.name, _apply_changes(suite.base, variation.changes))
        for variation in _list_variations(suite, where)
    ]


def _expand_sweep(suite: SuiteFile, where: str) -> list[_Variation]:
    """Return the base, and one member for each value of each axis that differs from the base."""
    axes = _read_axes(suite.sweep, f"{where}: sweep")
    _refuse_too_many(1 + sum(map(len, axes.values())), where)
    around = (
        {path: value}
        for path, values in axes.items()
        for value in values
        # The base is a member already: its own value would be a second one of the same.
        if value != read_path(suite.base, path)
    )
    return _name_variations([{}, *around])


def _expand_grid(suite: SuiteFile, where: str) -> list[_Variation]:
    """Return every combination of the axes' values; the last axis varies first."""
    axes = _read_axes(suite.grid, f"{where}: grid")
    # Before the product is made: six axes of ten values are a million members.
    _refuse_too_many(prod(map(len, axes.values())), where)
    return _name_variations(
        [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    )


def _expand_list(suite: SuiteFile, where: str) -> list[_Variation]:
    """Return the listed campaigns; a campaign without a name is named after its changes."""
    _refuse_too_many(len(suite.campaigns), where)
    unnamed = [
        {name: value for name, value in campaign.items() if name != "name"}
        for campaign in suite.campaigns
    ]
    made = _name_variations([dict(list_leaves(campaign)) for campaign in unnamed])
    return [
        _Variation(str(campaign.get("name", variation.name)), variation.changes)
        for campaign, variation in zip(suite.campaigns, made, strict=True)
    ]


WAYS: dict[str, Callable[[SuiteFile, str], list[_Variation]]] = {
    "sweep": _expand_sweep,
    "grid": _expand_grid,
    "campaigns": _expand_list,
}


def _read_axes(table: Table, where: str) -> Axes:
    """Read the lists of values in a table, by path in a campaign.

    Raises:
        InvalidValue: a value is not a list, a list is empty, or the path is the campaign's name.
    """
    axes = dict(list_leaves(table))
    for path, values in axes.items():
        axis = f"{where}.{'.'.join(path)}"
        if not isinstance(values, list | tuple):
            raise InvalidValue(axis, "is not a list.", "Write the values to try as [1, 2, 3].")
        if not values:
            raise InvalidValue(axis, "has no values.", "Give values, or remove the axis.")
        if path == ("name",):
            raise InvalidValue(axis, "cannot vary.", "Names are made of what else varies.")
    return {path: list(values) for path, values in axes.items()}


def _name_variations(variations: list[Changes]) -> list[_Variation]:

    names = shorten_paths(path for changes in variations for path in changes)
    return [_Variation(_name_member(changes, names), changes) for changes in variations]


def _refuse_too_many(members: int, where: str) -> None:

    if members > MOST_MEMBERS:
        raise InvalidValue(
            where,
            f"has {members} members, more than {MOST_MEMBERS}.",
            "Remove values, or split it into several suites.",
        )


SETTINGS = frozenset({"campaign", "warm_start", "data_from"})
"""Settings of methods that hold the id of an earlier campaign or a list of ids; in a suite also
names of members."""

PLACES: tuple[KeyPath, ...] = ((), ("settings",))
"""Tables of a campaign's settings that have such settings: its own, and those of an ensemble."""

ANY_NUMBER = 1


def list_references(spec: CampaignSpec) -> tuple[str, ...]:
    """List the names of members in a campaign's settings, each once, in order."""
    values = (item for _, value in _holders(spec.settings) for item in list_items(value))
    return tuple(dict.fromkeys(name for name in values if isinstance(name, str)))


def resolve_references(spec: CampaignSpec, numbers: Callable[[str], int]) -> CampaignSpec:
    """Replace each name of a member by the id of its campaign."""
    settings = spec.settings
    for path, value in _holders(settings):
        settings = set_path(settings, path, _numbered(value, numbers))
    return msgspec.structs.replace(spec, settings=settings)


def replace_references(spec: CampaignSpec) -> CampaignSpec:
    """Replace all names of members by an arbitrary id, so that all settings can be checked."""
    return resolve_references(spec, lambda _name: ANY_NUMBER)


def order_members(specs: Mapping[str, CampaignSpec], where: str) -> tuple[str, ...]:
    """Order members such that each follows the members that it refers to.

    Args:
        specs: specification of each member, by name.
        where: name of the suite in errors.

    Raises:
        UnknownName: a member refers to one that does not exist.
        InvalidValue: members refer to each other in a circle.
    """
    needs = {name: list_references(spec) for name, spec in specs.items()}
    for name, needed in needs.items():
        for other in needed:
            if other not in specs:
                raise UnknownName(f"{where}: member '{name}'", other, specs)
    try:
        return tuple(TopologicalSorter(needs).static_order())
    except CycleError as error:
        circle = " → ".join(f"'{name}'" for name in reversed(error.args[1]))
        problem = f"has members that depend on each other: {circle}."
        raise InvalidValue(where, problem, "Remove one of these references.") from None


def _holders(settings: Table) -> Iterator[tuple[KeyPath, Any]]:

    for path, value in list_leaves(settings):
        # Not at any depth: a scenario may have a parameter with one of these names.
        if path[-1] in SETTINGS and path[:-1] in PLACES:
            yield path, value


def list_items(value: Any) -> list[Any]:
    """Return the items of a list; anything else is a list of one."""
    return value if isinstance(value, list) else [value]


def _numbered(value: Any, numbers: Callable[[str], int]) -> Any:
    if isinstance(value, list):
        return [_numbered(item, numbers) for item in value]
    return numbers(value) if isinstance(value, str) else value


LIKE = "Specify a TOML file with a suite, such as examples/suite.toml."


class SuiteMember(msgspec.Struct, frozen=True):
    """A campaign of a suite.

    Attributes:
        name: distinctive name, such as "alpha=5000".
        spec: its campaign, named "suite: member"; it refers to other members by name instead of id
            (see `list_references`).
    """

    name: str
    spec: CampaignSpec


class Suite(msgspec.Struct, frozen=True):
    """A named set of campaigns, all different and with different names."""

    name: str
    members: tuple[SuiteMember, ...]

    @property
    def episodes(self) -> int:
        """Total number of episodes of all members."""
        return sum(member.spec.episodes for member in self.members)

    @property
    def has_seeds(self) -> bool:
        """True if members have several seeds."""
        return len({member.spec.seed for member in self.members}) > 1

    @classmethod
    def repeat(cls, spec: CampaignSpec, seeds: int) -> Self:
        """Return the suite of a campaign with several seeds, its own first: s, s + 1, ….

        The suite has the campaign's name, and its members are called "seed=s". Episodes of
        different campaign seeds are independent, even if the seeds are neighbours.

        Args:
            spec: the campaign, with the first seed.
            seeds: number of seeds.

        Raises:
            InvalidValue: fewer than two seeds, more than 1000, a seed that is too large, or a name
                that becomes too long.
        """
        if not LEAST_SEEDS <= seeds <= MOST_MEMBERS:
            raise InvalidValue(
                "seeds",
                f"{seeds} is not between {LEAST_SEEDS} and {MOST_MEMBERS}.",
                "A spread takes at least two seeds; omit the option to run the campaign once.",
            )
        fields = msgspec.to_builtins(spec)
        del fields["name"]
        numbers = range(spec.seed, spec.seed + seeds)
        return cls(
            spec.name,
            tuple(
                _make_member(spec.name, f"seed={seed}", {**fields, "seed": seed}, spec.name)
                for seed in numbers
            ),
        )

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a suite from a TOML file; its default name is the file's name without its ending.

        Raises:
            UnknownName: a field does not exist, or a member refers to one that does not exist.
            InvalidValue: the file is unreadable or describes a campaign; a value is outside its
                bounds; an axis is empty; two members are equal; there are too many members; or
                members refer to each other in a circle.
        """
        file = Path(path)
        table = read_toml(file, LIKE)
        if "method" in table and not describes_suite(table):
            remedy = f"Run it with `eigenfail run {file}`."
            raise InvalidValue(file.name, "this is a campaign, not a suite.", remedy)
        base = table.get("base")
        if isinstance(base, dict):
            table = {**table, "base": include_samples(include_disturbance(base, file), file)}
        written = read_settings(SuiteFile, table, file.name)
        return cls._written(written, written.name or file.stem, file.name)

    @classmethod
    def of(cls, name: str, **tables: Any) -> Self:
        """Build a suite from the tables of a file.

        Args:
            name: name of the suite.
            tables: base, and one of sweep, grid and campaigns, as dicts and lists. Values of an
                axis may be any sequence, such as `np.arange(3)` or `range(3)`.

        Raises:
            UnknownName: as for `read`.
            InvalidValue: as for `read`.
        """
        plain = make_plain({**tables, "name": name})
        return cls._written(read_settings(SuiteFile, plain, name), name, name)

    @classmethod
    def _written(cls, written: SuiteFile, name: str, where: str) -> Self:

        members = [
            _make_member(name, member, fields, where)
            for member, fields in expand_suite(written, where)
        ]
        _refuse_duplicates(members, where)
        order_members({each.name: each.spec for each in members}, where)
        return cls(name, tuple(members))


PARAMETERS = "scenario_parameters"
SAMPLE, COLUMN = "empirical", "column"
"""Fields of a distribution that is read from a column of a CSV file."""


def read_disturbance(file: Path) -> DisturbanceModel:
    """Read a disturbance model from a TOML file that holds only the model or a whole campaign.

    Raises:
        UnknownName: models do not have a field of that name.
        InvalidValue: the TOML file is unreadable, or a value is outside its bounds.
    """
    table = read_toml(file, LIKE_MODEL)
    if "method" not in table:
        return _make_model(table, file.name)
    return _make_model(
        include_disturbance(table, file).get("disturbance", {}), f"{file.name}: disturbance"
    )


def include_disturbance(fields: Table, file: Path) -> Table:
    """Return a campaign's fields with the file name of a disturbance model replaced by the model.

    Args:
        fields: fields in the campaign's file; `disturbance` may be the path of another file,
            relative to the folder of the campaign's file.
        file: the campaign's file.

    Raises:
        UnknownName: models do not have a field of that name.
        InvalidValue: the model's file cannot be read, is a campaign, or holds a value outside its
            bounds.
    """
    named = fields.get("disturbance")
    if not isinstance(named, str):
        return fields
    other = file.parent / named
    table = read_toml(other, LIKE_MODEL)
    if "method" in table:
        raise InvalidValue(
            f"{file.name}: disturbance", f"'{named}' describes a campaign.", LIKE_MODEL
        )
    return {**fields, "disturbance": msgspec.to_builtins(_make_model(table, other.name))}


def include_samples(fields: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """Return a campaign's fields with the file names of samples replaced by the samples.

    Args:
        fields: fields in the campaign's file; a scenario parameter may be `{empirical = "gaps.csv",
            column = "gap_m"}`, with the path of a CSV file relative to the campaign's file.
        file: the campaign's file.

    Raises:
        UnknownName: the CSV file does not have this column.
        InvalidValue: no column is named, the file cannot be read, a cell is not a number, or there
            are more than `MOST_SAMPLES` samples.
    """
    given = fields.get(PARAMETERS)
    if not isinstance(given, dict):
        return dict(fields)
    read = {
        name: _read_sample(value, file, f"{file.name}: {PARAMETERS}.{name}")
        if isinstance(value, dict) and isinstance(value.get(SAMPLE), str)
        else value
        for name, value in given.items()
    }
    return {**fields, PARAMETERS: read}


def _read_sample(given: Mapping[str, Any], file: Path, field: str) -> dict[str, list[float]]:
    """Return the empirical distribution of a sample in a file."""
    path, column = file.parent / given[SAMPLE], given.get(COLUMN)
    if not isinstance(column, str) or len(given) > len((SAMPLE, COLUMN)):
        remedy = f'Write it as {{{SAMPLE} = "gaps.csv", {COLUMN} = "gap_m"}}.'
        raise InvalidValue(field, f"the column of '{given[SAMPLE]}' is not named.", remedy)
    like = "Name a CSV file with a header, or take a random part of its rows."
    place = f"{field}: {given[SAMPLE]}"
    table = read_table(path, TableColumns("", (column,), (), like, MOST_SAMPLES), place)
    values = table.numbers[column]
    for row, value in zip(table.rows, values, strict=True):
        if isnan(value):
            remedy = "Remove the row, or correct it."
            raise InvalidValue(f"{place}, row {row}: {column}", "is empty.", remedy)
    return {SAMPLE: values.tolist()}


def _make_model(table: Any, where: str) -> DisturbanceModel:
    if not isinstance(table, dict):
        raise InvalidValue(where, "is not a table.", "Write it as [disturbance].")
    return convert(table, DisturbanceModel, where)


def _make_member(suite: str, name: str, fields: Table, where: str) -> SuiteMember:

    place = f"{where}: member '{name}'"
    spec = convert({**fields, "name": f"{suite}: {name}"}, CampaignSpec, place)
    _refuse_lossy_json(spec, place)
    return SuiteMember(name, spec)


def _refuse_lossy_json(spec: CampaignSpec, where: str) -> None:
    # The service stores JSON, which has neither dates nor numbers that are not finite.
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


def _refuse_duplicates(members: list[SuiteMember], where: str) -> None:

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


DIFFERENT = "Remove one of them, or change it."


MemberCampaigns = dict[str, Campaign]
"""Campaigns of members by name; members without a campaign are missing."""


def make_member_key(spec: CampaignSpec) -> str:
    """Return the idempotency key of a member, made of its spec, which has both names."""
    return f"suite-{sha256(msgspec.json.encode(spec, order='sorted')).hexdigest()}"


def match_campaigns(suite: Suite, alike: Mapping[str, Sequence[Campaign]]) -> MemberCampaigns:
    """Match the members of a suite with campaigns of the service.

    Args:
        suite: the suite.
        alike: existing campaigns by the name of a member's campaign, newest first.

    Raises:
        UnknownName: a member refers to one that does not exist.
        InvalidValue: members refer to each other in a circle.
    """
    found: MemberCampaigns = {}
    for member in _order_suite(suite):
        if all(name in found for name in list_references(member.spec)):
            spec = _resolve_member(member, found)
            for campaign in alike.get(spec.name, ()):
                if campaign.spec.is_like(spec):
                    found.setdefault(member.name, campaign)
    return found


def list_ready_members(suite: Suite, found: MemberCampaigns) -> Iterator[tuple[str, CampaignSpec]]:
    """Yield names and specifications of members that can be created now.

    Such members do not have a campaign yet, and the campaigns that they refer to are done.

    Raises:
        UnknownName: a member refers to one that does not exist.
        InvalidValue: members refer to each other in a circle.
    """
    done = {name for name, one in found.items() if one.state is CampaignState.DONE}
    for member in _order_suite(suite):
        if member.name not in found and done.issuperset(list_references(member.spec)):
            yield member.name, _resolve_member(member, found)


def _order_suite(suite: Suite) -> Iterator[SuiteMember]:

    members = {member.name: member for member in suite.members}
    names = order_members({name: one.spec for name, one in members.items()}, suite.name)
    return (members[name] for name in names)


def _resolve_member(member: SuiteMember, found: MemberCampaigns) -> CampaignSpec:

    return resolve_references(member.spec, lambda name: found[name].id)
