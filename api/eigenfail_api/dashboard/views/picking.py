"""Campaigns to pick from for a comparison, and those that are picked."""

from collections.abc import Callable, Sequence
from urllib.parse import urlencode

import msgspec

from eigenfail.values import Campaign, CampaignSpec
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES, Badge
from eigenfail_services.campaigns.comparison_groups import FEWEST, MOST

Ids = Sequence[int]


class Choice(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that can be picked."""

    id: int
    name: str
    about: str
    badge: Badge
    is_picked: bool


class Picker(msgspec.Struct, frozen=True, kw_only=True):
    """The list to pick from.

    Attributes:
        wanted: what names are to contain; empty for all.
        words: how many are picked, and how many can be.
    """

    choices: tuple[Choice, ...]
    wanted: str
    words: str


class Chosen(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that is compared.

    Attributes:
        first: address of the comparison in which the others are held against this one; empty if
            they are already.
        without: address of the comparison without it.
    """

    name: str
    about: str
    badge: Badge
    first: str
    without: str


def picker(shown: Sequence[Campaign], ids: Ids, wanted: str) -> Picker:
    """The list to pick from, those that are picked first, in the order that they have."""
    places = {each: place for place, each in enumerate(ids)}
    ordered = sorted(shown, key=lambda each: (places.get(each.id, len(ids)), -each.id))
    words = f"{len(ids)} picked; {FEWEST} to {MOST} can be compared."
    return Picker(choices=tuple(choice(each, ids) for each in ordered), wanted=wanted, words=words)


def choice(campaign: Campaign, ids: Ids) -> Choice:
    """One of them."""
    return Choice(
        id=campaign.id,
        name=campaign.spec.name,
        about=about(campaign.spec),
        badge=CAMPAIGN_BADGES[campaign.state],
        is_picked=campaign.id in ids,
    )


def all_chosen(campaigns: Sequence[Campaign], only: bool, wanted: str) -> tuple[Chosen, ...]:
    """Those that are compared, on a page with such settings and such a search."""
    ids = [each.id for each in campaigns]
    return tuple(chosen(each, ids, lambda some: address(some, only, wanted)) for each in campaigns)


def chosen(campaign: Campaign, ids: Ids, at: Callable[[Ids], str]) -> Chosen:
    """One of them, with how to have it first and how to leave it out."""
    others = [each for each in ids if each != campaign.id]
    return Chosen(
        name=named(campaign),
        about=about(campaign.spec),
        badge=CAMPAIGN_BADGES[campaign.state],
        first="" if campaign.id == ids[0] else at([campaign.id, *others]),
        without=at(others),
    )


def about(spec: CampaignSpec) -> str:
    """What tells campaigns of one name apart."""
    return f"{spec.method}, {spec.planner} in {spec.scenario}, seed {spec.seed}"


def named(campaign: Campaign) -> str:
    """As a column is headed."""
    return f"{campaign.id}: {campaign.spec.name}"


def address(campaigns: Ids, only: bool, wanted: str) -> str:
    """Of the page that compares them."""
    query: list[tuple[str, str | int]] = [("campaign", each) for each in campaigns]
    query += [("q", wanted)] if wanted else []
    return f"/comparison?{urlencode([*query, ('diff', str(only).lower())])}"
