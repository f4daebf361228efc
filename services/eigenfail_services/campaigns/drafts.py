"""Campaigns before they are launched: from fields, from lists, and from earlier campaigns."""

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import msgspec

from eigenfail.contracts import Reference
from eigenfail.errors import EigenfailError, InputError, InvalidValue, UnknownName
from eigenfail.methods import describe_method, traits_of
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import MAX_EPISODES, CampaignSpec
from eigenfail.wire.http import MAX_CAMPAIGNS_AT_ONCE, read_fields
from eigenfail_services.campaigns import validation
from eigenfail_services.campaigns.references import check_references, find_knowledge
from eigenfail_services.resolution import ResolvedCampaign
from eigenfail_services.store.store import Store

MOST_PROBLEMS = 100
EVALUATE = "evaluate"
"""The method that a campaign is continued with whose knowledge is used."""

STAND_INS: Mapping[str, Any] = {
    "name": "unnamed",
    "method": "monte_carlo",
    "episodes": MAX_EPISODES,
}
"""Replaces required values that are wrong while others are checked; no budget is too small."""

COMPANIONS = {
    "method": "settings",
    "scenario": "scenario_parameters",
    "planner": "planner_settings",
}
"""Fields whose values mean nothing without the plug-in that the other field names."""

WHOLE = (
    ("scenario_parameters", 2),
    ("disturbance.shape", 2),
    ("disturbance.channels", 2),
    ("disturbance.correlations", 2),
    ("requirements", 1),
    ("importance", 1),
)
"""Fields, with a depth below which a value is taken out whole, as a part of it is not valid."""

TABLES = ("settings", "scenario_parameters", "planner_settings", "disturbance", "stop")
"""Fields of a clone whose values are put over the earlier ones, name by name."""

BRACKETS = re.compile(r"\[[^\]]*\]")

Fields = Mapping[str, Any]


def validate_campaign(spec: CampaignSpec, store: Store) -> ResolvedCampaign:
    """Resolve a campaign that can be launched if the connected bridges meet its needs.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist; the known ones are listed.
        InvalidValue: an impossible value; or the settings name an earlier campaign, an analysis or
            an episode that does not exist or cannot be used.
    """
    campaign = validation.check_spec(spec)
    check_references(campaign, store)
    return campaign


def read_draft(given: Fields, store: Store) -> ResolvedCampaign:
    """Resolve a campaign, from its fields, as `validate_campaign` does.

    Raises:
        UnknownName: a field, plug-in, setting or parameter that does not exist.
        InvalidValue: a value of the wrong type, outside its bounds, or missing; or the campaign
            builds on something that does not exist.
    """
    return validate_campaign(read_fields(given, CampaignSpec), store)


def read_drafts(given: Sequence[Any], store: Store) -> list[ResolvedCampaign]:
    """Resolve the campaigns of a list, each from its fields.

    Raises:
        UnknownName: a campaign has a field, plug-in or setting that does not exist; the error names
            its place.
        InvalidValue: a campaign has an impossible value; or the list is empty or too long.
    """
    if not 1 <= len(given) <= MAX_CAMPAIGNS_AT_ONCE:
        problem = f"the list has {len(given)} campaigns, not 1 to {MAX_CAMPAIGNS_AT_ONCE}."
        remedy = "Send them in several requests." if given else "Name at least one."
        raise InvalidValue("", problem, remedy)
    return [_read_item(item, f"[{place}]", store) for place, item in enumerate(given)]


def _read_item(item: Any, where: str, store: Store) -> ResolvedCampaign:
    if not isinstance(item, dict):
        raise InvalidValue(where, "is not an object with the fields of a campaign.")
    with move_errors(where):
        return read_draft(item, store)


def check_draft_offers(campaigns: Iterable[ResolvedCampaign], store: Store) -> None:
    """Check that the connected bridges offer what the campaigns of a list need.

    Raises:
        UnknownName: as `check_offers` does; the error names the place of the campaign.
        InvalidValue: likewise.
    """
    list_offers = cache(store.roster.list_offers)
    for place, campaign in enumerate(campaigns):
        with move_errors(f"[{place}]"):
            validation.check_offers(campaign, list_offers)


@contextlib.contextmanager
def move_errors(where: str) -> Iterator[None]:
    """Raise the block's errors with `where` in front of their field."""
    try:
        yield
    except InputError as error:
        field = f"{where}.{error.field}" if error.field else where
        raise rename_field(error, field) from error


def rename_field(error: InputError, field: str) -> InputError:
    """Return the same error, of a field with another path."""
    problem = error.problem.removeprefix(f"{error.field}: ")
    if isinstance(error, UnknownName):
        return UnknownName(field, error.name, error.known, problem)
    return InvalidValue(field, problem, error.remedy)


def find_problems(given: Fields, store: Store) -> tuple[InputError, ...]:
    """Return everything that is wrong with a campaign.

    A campaign is refused for its first problem. So this function removes each offending value and
    reads the rest again, until it finds no further problem. Only a complete campaign is compared
    with the offers of bridges: a bridge need not offer the default of a removed value.
    """
    # Converters of structs stop at their first error, and plug-ins raise theirs one by one: that a
    # value is wrong shows only once those before it are out of the way.
    left, found = dict(given), list[InputError]()
    while len(found) < MOST_PROBLEMS:
        try:
            campaign = read_draft(left, store)
        except InputError as error:
            # A value that was taken out and is refused again cannot be told from its default.
            if error.field in {each.field for each in found if not isinstance(each, UnknownName)}:
                break
            found.append(error)
            reduced = _take_out_value(left, error)
            if reduced == left:
                break
            left = reduced
        else:
            return tuple(found) or _find_misfits(campaign, store)
    return tuple(found)


def _find_misfits(campaign: ResolvedCampaign, store: Store) -> tuple[InputError, ...]:
    try:
        validation.check_offers(campaign, store.roster.list_offers)
    except InputError as error:
        return (error,)
    return ()


def _take_out_value(given: dict[str, Any], error: InputError) -> dict[str, Any]:
    path = find_path(error)
    found = [name for name in path[:1] if name in given or name in STAND_INS]
    if not found:
        return _take_out(given, (error.name,)) if isinstance(error, UnknownName) else given
    (top,) = found
    if top in STAND_INS:
        given = {**given, top: STAND_INS[top]}
    elif isinstance(error, UnknownName) and isinstance(_value_at(given, path), dict):
        given = _take_out(given, (*path, error.name))
    else:
        given = _take_out(given, path)
    return given if top not in COMPANIONS else _take_out(given, (COMPANIONS[top],))


def find_path(error: InputError) -> tuple[str, ...]:
    """Return the names that lead to the value that an error is about."""
    plain = BRACKETS.sub("", error.field)
    names = tuple(name for name in plain.split(".") if name)
    for above, most in WHOLE:
        if plain.startswith(above):
            return names[:most]
    return names


def _value_at(given: Any, path: tuple[str, ...]) -> Any:
    for name in path:
        given = given.get(name) if isinstance(given, dict) else None
    return given


def _take_out(given: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    """Return the table without the value at a path, or at as much of the path as there is."""
    name, *rest = path
    inner = given.get(name)
    if rest and isinstance(inner, dict) and rest[0] in inner:
        return {**given, name: _take_out(inner, tuple(rest))}
    return {other: value for other, value in given.items() if other != name}


def clone(spec: CampaignSpec, changes: Fields) -> CampaignSpec:
    """Return a campaign like another, with some fields changed.

    New settings and parameters override the earlier ones. If the plug-in changes, the earlier ones
    mean nothing and are left out.

    Raises:
        UnknownName: a field that does not exist.
        InvalidValue: a value of the wrong type or outside its bounds.
    """
    return read_fields(change_fields(msgspec.to_builtins(spec), changes), CampaignSpec)


def change_fields(fields: Fields, changes: Fields) -> dict[str, Any]:
    """Return the fields with the changes in them."""
    kept = dict(fields)
    for name, companion in COMPANIONS.items():
        if name in changes and changes[name] != fields.get(name):
            kept.pop(companion, None)
            if name == "planner":
                # The version is one of the earlier planner.
                kept.pop("planner_version", None)
    for name, value in changes.items():
        over = name in TABLES and isinstance(value, dict) and isinstance(kept.get(name), dict)
        kept[name] = {**kept[name], **value} if over else value
    return kept


class Continuation(msgspec.Struct, frozen=True):
    """A way to build on an earlier campaign.

    Attributes:
        words: description of its effect.
        changes: changes of the campaign's fields, by path.
    """

    words: str
    changes: Fields


CONTINUATIONS = {
    Reference.OWN_LEARNER: "Start from the networks that it trained.",
    Reference.EPISODES: "Learn from its episodes first.",
}
"""Descriptions of what a new campaign of one method can take from an earlier one."""


def list_continuations(campaign: Campaign) -> Iterator[Continuation]:
    """Return how a new campaign can build on this one; none before it has ended."""
    if campaign.state not in FINAL_STATES:
        return
    with contextlib.suppress(EigenfailError):  # its method is not installed, or learns nothing
        known = describe_method(campaign.spec.method)
        for name in known.settings_type.__struct_fields__:
            kind = known.traits.references.get(name)
            if kind in CONTINUATIONS:
                yield Continuation(CONTINUATIONS[kind], {f"settings.{name}": campaign.id})
        find_knowledge(campaign, "")
        changes = {"method": EVALUATE, "settings.campaign": campaign.id}
        yield Continuation("Use what it learnt, and learn no further.", changes)


def describe_repetition(spec: CampaignSpec) -> str:
    """Describe how a longer campaign with the same seed repeats the earlier episodes."""
    if traits_of(spec.method).draws_from_prior:
        return (
            f"With the same seed its first {spec.episodes:,} episodes are those of the earlier one "
            "again; give another seed for fresh ones."
        )
    return (
        f"{spec.method} plans by its budget, so that with the same seed, too, the episodes may "
        "differ from the earlier ones."
    )
