"""How the members of a suite differ from its base: values, each at its path in a campaign."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

Path = tuple[str, ...]
Changes = Mapping[Path, Any]
Table = dict[str, Any]

BASE = "base"


def leaves(table: Table, above: Path = ()) -> Iterator[tuple[Path, Any]]:
    """What stands in a table and in the tables inside it, each with its path."""
    for name, value in table.items():
        path = (*above, name)
        if isinstance(value, dict) and value:
            yield from leaves(value, path)
        else:
            yield path, value


def value_at(table: Table, path: Path) -> Any:
    """What stands at a path; None if nothing does."""
    here: Any = table
    for name in path:
        here = here.get(name) if isinstance(here, dict) else None
    return here


def put(table: Table, path: Path, value: Any) -> Table:
    """The table with the value at the path."""
    name, *rest = path
    if not rest:
        return {**table, name: value}
    inner = table.get(name)
    return {**table, name: put(inner if isinstance(inner, dict) else {}, tuple(rest), value)}


def changed(table: Table, changes: Changes) -> Table:
    """The table with every change in it."""
    for path, value in changes.items():
        table = put(table, path, value)
    return table


def label(changes: Changes, names: Mapping[Path, str]) -> str:
    """What a member is called: "alpha=5000, planner=idm"."""
    return ", ".join(f"{names[path]}={text(value)}" for path, value in changes.items()) or BASE


def short_names(paths: Iterable[Path]) -> dict[Path, str]:
    """Each path's last word, where no other path ends in it; otherwise all of the path."""
    different = list(dict.fromkeys(paths))
    ends = Counter(path[-1] for path in different)
    return {path: path[-1] if ends[path[-1]] == 1 else ".".join(path) for path in different}


def text(value: Any) -> str:
    """A value as people write it: the shortest form that tells it apart."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        short = f"{value:g}"
        return short if float(short) == value else repr(value)
    return msgspec.json.encode(value).decode()
