"""Suites: their campaigns, created at once, and their tables with figures over seeds."""

from functools import cache
from math import prod
from typing import Any

import msgspec
from msgspec.structs import asdict

from eigenfail import suites
from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.values.campaign import Campaign, CampaignFilter
from eigenfail.values.suite import SEPARATOR, suite_of
from eigenfail_services.campaigns import validation
from eigenfail_services.campaigns.drafts import move_errors, rename_field, validate_campaign
from eigenfail_services.store.campaign_creation import NewCampaign, request_one
from eigenfail_services.store.store import Store

LARGEST_SUITE = 20_000_000
"""Size of the JSON of all members of a suite that a request describes. [bytes]"""


def read_suite(given: suites.SuiteRequest) -> suites.Suite:
    """Return the suite that a request describes.

    Raises:
        UnknownName: a field does not exist, or a member refers to one that does not exist.
        InvalidValue: a value is outside its bounds, an axis is empty, or two members are equal;
            members are too many, too large, or refer to each other in a circle; or a suite cannot
            have the name.
    """
    refuse_large_suite(given)
    try:
        suite = suites.Suite.of(**asdict(given))
    except InputError as error:
        raise _rename_suite_error(error, given.name) from error
    for member in suite.members:
        if suite_of(member.spec.name) != suite.name:
            problem = f"A campaign '{member.spec.name}' would belong to another suite, or to none."
            raise InvalidValue("name", problem, "Choose another name, without a colon.")
    return suite


def refuse_large_suite(given: suites.SuiteFile) -> None:
    """Make sure that the members of a suite are not too large together, before they are made.

    Raises:
        InvalidValue: they are.
    """
    size = _bound_size(given)
    if size > LARGEST_SUITE:
        problem = (
            f"The members of the suite take about {size / 1e6:,.0f} MB, more than"
            f" {LARGEST_SUITE / 1e6:,.0f} MB."
        )
        raise InvalidValue("", problem, "Vary fewer values, or create several suites.")


def _bound_size(given: suites.SuiteFile) -> int:
    """Return the size of the JSON of all members: each has the base, and a value of each axis.

    If there are more members than a suite can have, only the allowed number counts. [bytes]
    """
    axes = [suites.list_items(each) for _, each in suites.list_leaves(given.grid)]
    ways = (
        prod(map(len, axes)) if axes else 0,
        sum(len(suites.list_items(each)) for _, each in suites.list_leaves(given.sweep)),
        len(given.campaigns),
    )
    members = min(max(ways) + 1, suites.MOST_MEMBERS)
    repeated = sum(members * _measure_size(each) // max(len(each), 1) for each in axes)
    alone = _measure_size(given.sweep) + _measure_size(given.campaigns)
    return members * _measure_size(given.base) + repeated + alone


def _measure_size(value: Any) -> int:
    return len(msgspec.json.encode(value))


def _rename_suite_error(error: InputError, suite: str) -> InputError:
    """Return an error of a suite's file as an error of a request, which has fields but no file.

    Args:
        error: the error, whose field begins with the name of the file.
        suite: name of the file in the error.
    """
    field = error.field.removeprefix(suite).removeprefix(SEPARATOR)
    if field or isinstance(error, UnknownName):
        return rename_field(error, field)
    problem = error.problem.removeprefix(f"{error.field}: ")
    return InvalidValue("", f"The suite {problem}", error.remedy)


class CheckedSuite(msgspec.Struct, frozen=True):
    """The campaigns that a request for a suite would create, and its problems.

    Attributes:
        missing: campaigns that can be created now, with their idempotency keys.
        problems: first problem of each member that is refused, by its name.
    """

    missing: list[NewCampaign]
    problems: dict[str, InputError]


def check_suite(store: Store, suite: suites.Suite) -> CheckedSuite:
    """Return the campaigns of a suite that do not exist yet, checked, without creating any.

    Members that build on unfinished members are checked, but cannot be created now.
    """
    alike: dict[str, list[Campaign]] = {}
    for campaign in store.campaigns.iterate(CampaignFilter(suite=suite.name)):
        alike.setdefault(campaign.spec.name, []).append(campaign)
    found = suites.match_campaigns(suite, alike)
    ready = dict(suites.list_ready_members(suite, found))
    # Problems of all members are found first: a suite is created whole, or not at all.
    checked, list_offers = CheckedSuite([], {}), cache(store.roster.list_offers)
    for name, spec in ready.items():
        try:
            resolved = validate_campaign(spec, store)
            validation.check_offers(resolved, list_offers)
            key = suites.make_member_key(spec)
            checked.missing.append(request_one(resolved, key))
        except InputError as error:
            checked.problems[name] = error
    for member in suite.members:
        if member.name not in found and member.name not in ready:
            try:
                validation.check_spec(suites.replace_references(member.spec))
            except InputError as error:
                checked.problems[member.name] = error
    return checked


def create_suite(store: Store, suite: suites.Suite, made_by: int | None = None) -> None:
    """Queue the campaigns of a suite that do not exist yet: all of them, or none.

    A member exists already if any user has created a campaign with its name and content. Members
    that build on unfinished members are checked but not created: the same call creates them later.

    Args:
        store: store of the campaigns.
        suite: the suite.
        made_by: id of the API key of the request, whose quotas apply.

    Raises:
        UnknownName: a plug-in, setting or parameter of a member that does not exist.
        InvalidValue: an impossible value of a member.
        QuotaExceeded: the API key does not allow all of them.
    """
    checked = check_suite(store, suite)
    for name, error in checked.problems.items():
        with move_errors(f"member '{name}'"):
            raise error
    # The check held no lock. If another request has created a member meanwhile, its key finds that
    # campaign.
    store.campaigns.create_all(checked.missing, made_by)
