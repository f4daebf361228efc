"""Members of a suite that build upon others of it: who names whom, and in which order they run."""

from collections.abc import Callable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Any

import msgspec

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites.changes import Path, Table, leaves, put
from eigenfail.values import CampaignSpec

SETTINGS = frozenset({"campaign", "warm_start", "data_from"})
"""Of methods: they hold the number of an earlier campaign, or a list of numbers; in a suite, names
of its members too."""

PLACES: tuple[Path, ...] = ((), ("settings",))
"""Tables inside a campaign's settings in which they stand: its own, and an ensemble's members'."""

ANY_NUMBER = 1


def references(spec: CampaignSpec) -> tuple[str, ...]:
    """The names that a campaign's settings give in place of numbers, each once, in order."""
    values = (item for _, value in _holders(spec.settings) for item in _items(value))
    return tuple(dict.fromkeys(name for name in values if isinstance(name, str)))


def resolved(spec: CampaignSpec, numbers: Callable[[str], int]) -> CampaignSpec:
    """The campaign with the number of each name."""
    settings = spec.settings
    for path, value in _holders(settings):
        settings = put(settings, path, _numbered(value, numbers))
    return msgspec.structs.replace(spec, settings=settings)


def with_any_numbers(spec: CampaignSpec) -> CampaignSpec:
    """The campaign with numbers for all names, so that its other settings can be judged."""
    return resolved(spec, lambda _name: ANY_NUMBER)


def in_order(specs: Mapping[str, CampaignSpec], where: str) -> tuple[str, ...]:
    """The names of members, each behind those that it builds upon.

    Args:
        specs: of members, by name.
        where: their suite, for errors.

    Raises:
        UnknownName: one builds upon a member that there is not.
        InvalidValue: some wait for each other.
    """
    needs = {name: references(spec) for name, spec in specs.items()}
    for name, needed in needs.items():
        for other in needed:
            if other not in specs:
                raise UnknownName(f"{where}: member '{name}'", other, specs)
    try:
        return tuple(TopologicalSorter(needs).static_order())
    except CycleError as error:
        circle = " → ".join(f"'{name}'" for name in reversed(error.args[1]))
        problem = f"has members that wait for each other: {circle}."
        raise InvalidValue(where, problem, "Let one of them name none of the others.") from None


def _holders(settings: Table) -> Iterator[tuple[Path, Any]]:
    """Where campaigns are named, and what stands there."""
    for path, value in leaves(settings):
        if path[-1] in SETTINGS and path[:-1] in PLACES:
            yield path, value


def _items(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _numbered(value: Any, numbers: Callable[[str], int]) -> Any:
    if isinstance(value, list):
        return [_numbered(item, numbers) for item in value]
    return numbers(value) if isinstance(value, str) else value
