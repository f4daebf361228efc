"""The search: campaigns, episodes, failure modes and suites by id or by a part of their names.

Campaigns are found by their tags and by the version of their planner, too.
"""

import re
import shlex
from collections.abc import Iterator
from typing import Annotated
from urllib.parse import quote

import msgspec
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse
from msgspec.structs import replace

from eigenfail.errors import NotFound
from eigenfail.values.campaign import Campaign, CampaignFilter
from eigenfail.values.campaign_spec import LONGEST_NAME, Tag
from eigenfail_api.dashboard.rendering import CAMPAIGN_BADGES, Badge, page
from eigenfail_api.parameters import LARGEST, Stored
from eigenfail_services.store import Store

MOST_HITS = 20
"""Maximum number of hits of one kind on the page."""

Text = Annotated[
    str,
    Query(
        alias="q",
        max_length=LONGEST_NAME,
        description="A campaign's id, an episode such as 3/17, a part of a name, a planner's "
        "version, or a tag.",
    ),
]

_NUMBER = re.compile(r"#?([1-9]\d{0,18})")
_EPISODE = re.compile(r"([1-9]\d{0,18})/(\d{1,19})")


class Hit(msgspec.Struct, frozen=True):
    """A line of the answer.

    Attributes:
        note: what tells it from others of its name.
        state: state of a campaign; None for anything else.
    """

    name: str
    address: str
    note: str = ""
    state: Badge | None = None


class HitGroup(msgspec.Struct, frozen=True):
    """The hits of one kind.

    Attributes:
        is_cut: whether more match than the page lists.
        more: address of the list of all; empty where all of them are here, or have no list.
        command: command that lists more; empty where all of them are here, or have none.
    """

    title: str
    hits: tuple[Hit, ...]
    is_cut: bool = False
    more: str = ""
    command: str = ""


class SearchView(msgspec.Struct, frozen=True):
    """The content of the search page; without a text it has only the field."""

    text: str
    groups: tuple[HitGroup, ...] = ()


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/search")
def show_search(store: Stored, text: Text = "") -> HTMLResponse:
    """Serve the results that have an id, or a part of a name."""
    return page("search.html", make_search_view(store, " ".join(text.split())))


def make_search_view(store: Store, text: str) -> SearchView:
    """Return the results, the exact ids first; groups without a result are left out."""
    if not text:
        return SearchView(text)
    groups = (
        HitGroup("By id", (*_find_campaign(store, text), *_find_episode(store, text))),
        _search_campaigns(store, text),
        # Labels match as a whole word; what cannot be one needs no question.
        *(_search_labels(store, text) if _is_label(text) else ()),
        _cut_hits("Failure modes", _search_modes(store, text)),
        _cut_hits("Suites", _search_suites(store, text)),
    )
    return SearchView(text, tuple(group for group in groups if group.hits))


def _find_campaign(store: Store, text: str) -> tuple[Hit, ...]:
    found = _NUMBER.fullmatch(text)
    # A database refuses larger numbers with an error of its own.
    if found is None or int(found[1]) > LARGEST:
        return ()
    try:
        return (_make_campaign_hit(store.campaigns.get(int(found[1]))),)
    except NotFound:
        return ()


def _find_episode(store: Store, text: str) -> tuple[Hit, ...]:
    found = _EPISODE.fullmatch(text)
    if found is None or max(map(int, found.groups())) > LARGEST:
        return ()
    campaign, index = map(int, found.groups())
    # By row, not by episode: the scene is large, and only the outcome is shown.
    rows = store.episodes.page(campaign, 1, index - 1 if index else None).items
    if not rows or rows[0].index != index:
        return ()
    address = f"/campaigns/{campaign}/episodes/{index}"
    return (Hit(f"Episode {campaign}/{index}", address, rows[0].outcome.word),)


def _search_campaigns(store: Store, text: str) -> HitGroup:
    found = _list_campaigns(store, "Campaigns", CampaignFilter(search=text))
    return replace(found, more=f"/?search={quote(text)}" if found.is_cut else "")


def _is_label(text: str) -> bool:
    """Return whether a text may be a tag or the version of a planner, whose letters tags have."""
    try:
        msgspec.convert(text, Tag)
    except msgspec.ValidationError:
        return False
    return True


def _search_labels(store: Store, text: str) -> Iterator[HitGroup]:
    """Yield the campaigns of a version of a planner, and those with a tag: the whole word."""
    of_version = CampaignFilter(planner_version=text)
    for title, where, option in (
        (f"Campaigns of planner version {text}", of_version, "--planner-version"),
        (f"Campaigns with the tag {text}", CampaignFilter(tag=text), "--tag"),
    ):
        found = _list_campaigns(store, title, where)
        command = shlex.join(["eigenfail", "campaign", "list", f"{option}={text}", "--limit=1000"])
        yield replace(found, command=command if found.is_cut else "")


def _list_campaigns(store: Store, title: str, where: CampaignFilter) -> HitGroup:
    found = store.campaigns.page(MOST_HITS, where=where)
    return HitGroup(title, tuple(map(_make_campaign_hit, found.items)), found.next is not None)


def _cut_hits(title: str, hits: tuple[Hit, ...]) -> HitGroup:
    """Return the hits that the page lists, of which one more than these was searched for."""
    return HitGroup(title, hits[:MOST_HITS], len(hits) > MOST_HITS)


def _make_campaign_hit(campaign: Campaign) -> Hit:
    spec = campaign.spec
    note = f"campaign {campaign.id}, {spec.method} on {spec.planner} in {spec.scenario}"
    return Hit(spec.name, f"/campaigns/{campaign.id}", note, CAMPAIGN_BADGES[campaign.state_word])


def _search_modes(store: Store, text: str) -> tuple[Hit, ...]:
    return tuple(
        Hit(
            mode.name,
            f"/analyses/{mode.analysis}/modes/{mode.number}",
            f"mode {mode.number} of analysis {mode.analysis}",
        )
        for mode in store.analyses.search_modes(text, MOST_HITS + 1)
    )


def _search_suites(store: Store, text: str) -> tuple[Hit, ...]:
    names = store.campaigns.search_suites(text, MOST_HITS + 1)
    return tuple(Hit(name, f"/suites/{quote(name, safe='')}") for name in names)
