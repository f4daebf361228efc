"""The page of a failure mode: what it is, what it costs, and the failures that belong to it."""

from typing import Annotated

import msgspec
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.contracts.recording import ANIMATION, list_formats
from eigenfail.filters import SortOrder, parse_sort
from eigenfail.presentation import figures
from eigenfail.values import Analysis, AnalysisResult, Campaign, Mode, Proof
from eigenfail.values.analysis import LONGEST_MODE_NAME
from eigenfail.values.records import EpisodeRow
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_api.dashboard import episodes_page
from eigenfail_api.dashboard.analysis_page import ModeCard, make_mode_cards
from eigenfail_api.dashboard.rendering import Tile, page
from eigenfail_api.dashboard.triage_forms import TriageView, make_triage_view
from eigenfail_api.parameters import AnalysisId, ModeNumber, Stored
from eigenfail_services.campaigns.proofs import read_result, summarise_proof
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.store import Store

FAILURES_ON_PAGE = 50

FILMS = 6
"""Failures that play side by side."""


class ModeView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a failure mode.

    Attributes:
        mode: number, name and failures.
        numbers: the numbers of all modes of the analysis.
        card: what the page of the analysis shows of it.
        is_distinct: whether the modes are more than groups of failures.
        tiles: its figures, each with its basis.
        lines: its failures, the first in their order.
        films: addresses of the players of some failures, the medoid first.
        every: where all its failures can be searched; empty where no filter finds just them.
        newer: the newest analysis of the campaign, whose modes filters and lists have; None if it
            is this one.
        has_animation: whether an animation of its failures can be made here.
        version: version of the planner that its campaign names; empty if none.
        triage: its state, ticket and note.
    """

    mode: Mode
    numbers: tuple[int, ...]
    campaign: int
    campaign_name: str
    card: ModeCard
    is_distinct: bool
    tiles: tuple[tuple[str, Tile], ...]
    headings: tuple[episodes_page.Heading, ...]
    lines: tuple[episodes_page.EpisodeLine, ...]
    films: tuple[str, ...]
    every: str
    newer: int | None
    has_animation: bool
    version: str
    triage: TriageView
    longest_name: int = LONGEST_MODE_NAME


def make_mode_view(
    store: Store, analysis: Analysis, mode: Mode, sort: SortOrder, proof: Proof
) -> ModeView:
    """Return the page of a mode, with its failures in an order."""
    campaign = store.campaigns.get(analysis.campaign)
    result, world = read_result(analysis), world_of(campaign.spec.simulator)
    cards = make_mode_cards(result, campaign.id, proof, find_robustness_unit(campaign.spec))
    card, newest = cards[mode.number - 1], store.analyses.find_newest(campaign.id)
    rows = store.episodes.list_mode_failures(analysis.id, mode.number, sort, FAILURES_ON_PAGE)
    others = map(store.campaigns.get, sorted(set(analysis.settings.campaigns) - {campaign.id}))
    return ModeView(
        mode=mode,
        numbers=tuple(range(1, len(result.modes) + 1)),
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        card=card,
        is_distinct=result.distinct,
        tiles=list_mode_tiles(card, mode, [campaign, *others], len(result.episodes)),
        headings=episodes_page.make_headings(
            campaign.spec,
            lambda order: f"/analyses/{analysis.id}/modes/{mode.number}?sort={order}",
            sort,
        ),
        lines=tuple(map(episodes_page.make_episode_line, rows)),
        films=tuple(list_films(card, rows)) if world.has_road else (),
        every=find_search_address(analysis, result, mode.number) if newest == analysis.id else "",
        newer=None if newest == analysis.id else newest,
        has_animation=world.has_road and ANIMATION in list_formats(),
        version=campaign.spec.version,
        triage=make_triage_view(store.triage.get(analysis.id, mode.number)),
    )


def list_mode_tiles(
    card: ModeCard, mode: Mode, campaigns: list[Campaign], analysed: int
) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of a mode's figures, each with its basis."""
    total_usd = sum(find_cost(each).total_usd for each in campaigns)
    found = figures.count_noun(mode.failures, "failure")
    basis = f"{figures.format_usd(total_usd)} USD of its campaigns ÷ {found}"
    skipped = sum(each.counts.failures for each in campaigns) - analysed
    more = (
        (f"{figures.count_noun(skipped, 'failure')} not analysed: an upper bound",)
        if skipped
        else ()
    )
    probability = (("Probability under p(x)", card.probability),) if card.probability else ()
    return (
        (
            "Failures",
            Tile(figures.format_count(mode.failures), (f"{card.share} of those analysed",)),
        ),
        *probability,
        (
            "Cost per failure of the mode",
            Tile(figures.format_amount(total_usd / mode.failures), (basis, *more)),
        ),
        ("Eigenfailure, root mean square", Tile(f"{card.strength} sigma")),
        *card.proof,
    )


def list_films(card: ModeCard, rows: list[EpisodeRow]) -> list[str]:
    """Return the addresses of players: of the medoid, and of failures spread over the rows."""
    others = [
        f"/campaigns/{row.campaign}/episodes/{row.index}/clip"
        for row in rows
        if row.has_scene and (row.campaign, row.index) != (card.medoid_campaign, card.medoid)
    ]
    count = min(FILMS - 1, len(others))
    return [card.clip, *(others[place * len(others) // count] for place in range(count))]


def find_search_address(analysis: Analysis, result: AnalysisResult, number: int) -> str:
    """Return where the failures of a mode of the newest analysis can be searched.

    Filters are of one campaign: empty if the failures are of several.
    """
    is_of_one = {*result.campaigns} <= {analysis.campaign}
    return episodes_page.make_address(analysis.campaign, f"mode = {number}") if is_of_one else ""


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Sort = Annotated[str | None, Query(max_length=64)]


@router.get("/analyses/{analysis}/modes/{mode}")
def show_mode(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, sort: Sort = None
) -> HTMLResponse:
    """One failure mode."""
    seen = store.analyses.get(analysis)
    found = store.analyses.mode(analysis, mode)
    usual = episodes_page.find_worst_order(store.campaigns.get(seen.campaign).spec)
    view = make_mode_view(
        store, seen, found, parse_sort(sort or usual), summarise_proof(store, seen)
    )
    return page("mode.html", view)
