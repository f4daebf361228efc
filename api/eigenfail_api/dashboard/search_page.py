"""The search: campaigns, episodes, failure modes and suites by id or by a part of their names.

Campaigns are found by their tags and by the version of their planner, too.
"""

import re
from collections.abc import Iterator
from typing import Annotated, Any
from urllib.parse import quote, urlencode

import msgspec
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.errors import NotFound
from eigenfail.values.campaign import Campaign, CampaignFilter
from eigenfail.values.campaign_spec import LONGEST_NAME, Tag
from eigenfail_api.dashboard.rendering import CAMPAIGN_BADGES, Badge, page
from eigenfail_api.parameters import LARGEST, Stored
from eigenfail_services.store.store import Store

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

_ID = re.compile(r"#?([1-9]\d{0,18})(?:/(\d{1,19}))?")


class Hit(msgspec.Struct, frozen=True):
    """A line of the search results.

    Attributes:
        note: text that distinguishes it from others with the same name.
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
        more: address of the full list; empty if such a list does not exist.
    """

    title: str
    hits: tuple[Hit, ...]
    is_cut: bool = False
    more: str = ""


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/search")
def show_search(store: Stored, text: Text = "") -> HTMLResponse:
    """Serve the results that have an id, or a part of a name."""
    text = " ".join(text.split())
    groups = [group for group in _search(store, text) if group.hits] if text else []
    return page("search.html", {"text": text, "groups": groups})


def _search(store: Store, text: str) -> Iterator[HitGroup]:
    """Yield the results of each kind, exact ids first."""
    yield HitGroup("By id", tuple(_find_by_id(store, text)))
    wanted: dict[str, dict[str, Any]] = {"Campaigns": {"search": text}}
    # Labels match as a whole word; what cannot be one needs no question.
    if _is_label(text):
        wanted[f"Campaigns of planner version {text}"] = {"planner_version": text}
        wanted[f"Campaigns with the tag {text}"] = {"tag": text}
    for title, where in wanted.items():
        found = store.campaigns.page(MOST_HITS, where=CampaignFilter(**where))
        hits = tuple(map(_make_campaign_hit, found.items))
        yield HitGroup(
            title, hits, found.next is not None, f"/?{urlencode(where | {'archived': 'true'})}"
        )
    # One more is searched for than the page lists: it says whether there are more.
    modes = [
        Hit(
            mode.name,
            f"/analyses/{mode.analysis}/modes/{mode.number}",
            f"mode {mode.number} of analysis {mode.analysis}",
        )
        for mode in store.analyses.search_modes(text, MOST_HITS + 1)
    ]
    suites = [
        Hit(name, f"/suites/{quote(name, safe='')}")
        for name in store.campaigns.search_suites(text, MOST_HITS + 1)
    ]
    for title, listed in (("Failure modes", modes), ("Suites", suites)):
        yield HitGroup(title, tuple(listed[:MOST_HITS]), len(listed) > MOST_HITS)


def _find_by_id(store: Store, text: str) -> Iterator[Hit]:
    """Yield the campaign with an id, or the episode with an id and an index, if there is one."""
    match = _ID.fullmatch(text)
    numbers = [int(digits) for digits in match.groups() if digits] if match else []
    # A database refuses larger numbers with an error of its own.
    if not numbers or max(numbers) > LARGEST:
        return
    campaign, *indices = numbers
    for index in indices:
        # By row, not by episode: the scene is large, and only the outcome is shown.
        rows = store.episodes.page(campaign, 1, index - 1 if index else None).items
        if rows and rows[0].index == index:
            address = f"/campaigns/{campaign}/episodes/{index}"
            yield Hit(f"Episode {campaign}/{index}", address, rows[0].outcome.word)
    if not indices:
        try:
            yield _make_campaign_hit(store.campaigns.get(campaign))
        except NotFound:
            return


def _is_label(text: str) -> bool:
    """Return whether a text may be a tag or the version of a planner, whose letters tags have."""
    try:
        msgspec.convert(text, Tag)
    except msgspec.ValidationError:
        return False
    return True


def _make_campaign_hit(campaign: Campaign) -> Hit:
    spec = campaign.spec
    note = f"campaign {campaign.id}, {spec.method} on {spec.planner} in {spec.scenario}"
    return Hit(spec.name, f"/campaigns/{campaign.id}", note, CAMPAIGN_BADGES[campaign.state_word])
