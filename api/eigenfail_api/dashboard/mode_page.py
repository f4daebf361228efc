"""The page of a failure mode: its description, cost, failures and triage.

The triage form works without JavaScript: it leads back to its page.
"""

import re
from collections.abc import Mapping
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from eigenfail.contracts.recording import ANIMATION, list_formats
from eigenfail.errors import Conflict, InvalidValue
from eigenfail.filters import SortOrder, parse_sort
from eigenfail.presentation import figures
from eigenfail.presentation.tables import format_cell
from eigenfail.settings import refuse_hidden
from eigenfail.values import triage
from eigenfail.values.analysis import LONGEST_MODE_NAME, Analysis, Mode
from eigenfail.values.campaign import Campaign
from eigenfail.values.proof import Proof
from eigenfail.values.records import EpisodeRow
from eigenfail.wire.http import read_fields
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_api.access.change_details import record_form
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard import episodes_page
from eigenfail_api.dashboard.analysis_page import ModeCard, make_mode_cards
from eigenfail_api.dashboard.rendering import NamedTile, Tile, Tiles, page
from eigenfail_api.dashboard.scene import describe_first, make_overlay_chart
from eigenfail_api.parameters import AnalysisId, CallerName, ModeNumber, Stored, read_form
from eigenfail_services.campaigns.proofs import read_result, summarise_proof
from eigenfail_services.campaigns.recordings import OverlayBounds, load_mode_recordings
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.store.store import Store

FAILURES_ON_PAGE = 50

FILMS = 6
"""Failures that play side by side."""


def make_mode_view(
    store: Store, analysis: Analysis, mode: Mode, sort: SortOrder, proof: Proof
) -> dict[str, object]:
    """Return what the page of a mode shows, with its failures in an order."""
    campaign = store.campaigns.get(analysis.campaign)
    result, world = read_result(analysis), world_of(campaign.spec.simulator)
    cards = make_mode_cards(result, campaign.id, proof, find_robustness_unit(campaign.spec))
    card, newest = cards[mode.number - 1], store.analyses.find_newest(campaign.id)
    rows = store.episodes.list_mode_failures(analysis.id, mode.number, sort, FAILURES_ON_PAGE)
    others = map(store.campaigns.get, sorted(set(analysis.settings.campaigns) - {campaign.id}))
    # Filters have the modes of the newest analysis of one campaign, and no others.
    is_found_by_filter = newest == analysis.id and {*result.campaigns} <= {campaign.id}
    return {
        "mode": mode,
        "result": result,
        "campaign": campaign,
        "card": card,
        "tiles": list_mode_tiles(card, mode, [campaign, *others], len(result.episodes)),
        "headings": episodes_page.make_headings(
            campaign.spec,
            lambda order: f"/analyses/{analysis.id}/modes/{mode.number}?sort={order}",
            sort,
        ),
        "lines": tuple(map(episodes_page.make_episode_line, rows)),
        "films": list_films(card, rows) if world.has_road else (),
        "every": episodes_page.make_address(campaign.id, f"mode = {mode.number}")
        if is_found_by_filter
        else "",
        "newer": None if newest == analysis.id else newest,
        "has_animation": world.has_road and ANIMATION in list_formats(),
        "triage": store.analyses.get_triage(analysis.id, mode.number),
        "triage_states": tuple(triage.TriageState),
        "longest_ticket": triage.LONGEST_TICKET,
        "longest_note": triage.LONGEST_NOTE,
        "longest_name": LONGEST_MODE_NAME,
    }


def list_mode_tiles(card: ModeCard, mode: Mode, campaigns: list[Campaign], analysed: int) -> Tiles:
    """Return the tiles of a mode's figures, each with its basis."""
    total_usd = sum(find_cost(each).total_usd for each in campaigns)
    found = figures.count_noun(mode.failures, "failure")
    basis = f"{figures.format_usd(total_usd)} USD of its campaigns ÷ {found}"
    skipped = sum(each.counts.failures for each in campaigns) - analysed
    # The cost of all failures is divided by the analysed ones: with the others, the mode could only
    # have more failures.
    more = f"{figures.count_noun(skipped, 'failure')} not analysed: an upper bound"
    share = f"{figures.format_share(card.share)} of those analysed"
    tiles: list[NamedTile] = [("Failures", Tile(mode.failures, (share,)))]
    if card.mode.probability:
        tiles.append(("Probability under p(x)", format_cell(card.mode.probability)))
    cost = Tile(total_usd / mode.failures, (basis, more) if skipped else (basis,), unit="USD")
    tiles += [
        ("Cost per failure of the mode", cost),
        ("Eigenfailure, root mean square", Tile(card.strength, unit="sigma")),
        *card.proof,
    ]
    return tuple(tiles)


def list_films(card: ModeCard, rows: list[EpisodeRow]) -> list[str]:
    """Return the addresses of players: of the medoid, and of failures spread over the rows."""
    others = [
        f"/campaigns/{row.campaign}/episodes/{row.index}/clip"
        for row in rows
        if row.has_scene and (row.campaign, row.index) != (card.medoid_campaign, card.mode.medoid)
    ]
    count = min(FILMS - 1, len(others))
    return [card.clip, *(others[place * len(others) // count] for place in range(count))]


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Sort = Annotated[str | None, Query(max_length=64)]


@router.get("/analyses/{analysis}/modes/{mode}")
def show_mode(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, sort: Sort = None
) -> HTMLResponse:
    """Show a failure mode."""
    seen = store.analyses.get(analysis)
    found = store.analyses.mode(analysis, mode)
    usual = episodes_page.find_worst_order(store.campaigns.get(seen.campaign).spec)
    view = make_mode_view(
        store, seen, found, parse_sort(sort or usual), summarise_proof(store, seen)
    )
    return page("mode.html", view)


MOST_FIELDS = 100
# After a POST the browser opens the page with GET, so that reloading it sends nothing again.
SEE_OTHER = 303
# `int` would also accept underscores and digits of other scripts.
VERSION = re.compile(r"\d{1,15}", re.ASCII)


async def read_triage_form(request: Request) -> dict[str, str]:
    """Return the fields of the form.

    Raises:
        HTTPException: 400, the body is not a form.
        InvalidValue: a text has an invisible character.
    """
    form = await read_form(request, MOST_FIELDS)
    refuse_hidden(form)
    record_form(request.scope, form)
    return form


Form = Annotated[dict[str, str], Depends(read_triage_form)]


def read_change(form: Mapping[str, str]) -> triage.TriageChange:
    """Return the change of a form that shows the whole triage.

    Raises:
        InvalidValue: a value is outside its bounds.
    """
    given = {name: form.get(name) for name in triage.TriageChange.__struct_fields__}
    return triage.check_change(read_fields(given, triage.TriageChange))


def read_version(form: Mapping[str, str]) -> int | None:
    """Return when the triage that a form shows was last changed; None if never. [ms]

    Raises:
        InvalidValue: the text is not a time in milliseconds.
    """
    text = form.get("changed_ms", "")
    if text and not VERSION.fullmatch(text):
        raise InvalidValue(
            "changed_ms", "it is not a time in milliseconds.", "Open the page again."
        )
    return int(text) if text else None


@router.post("/analyses/{analysis}/modes/{mode}/triage")
def triage_mode(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of a failure mode."""
    shown_ms = read_version(form)

    # Two users may have the page open: the later form must not overwrite a change that its user has
    # not seen.
    def refuse_newer(found: triage.Triage) -> None:
        if found.changed_ms != shown_ms:
            by = f", by {found.changed_by}" if found.changed_by else ""
            raise Conflict(
                f"The triage of this mode was changed meanwhile{by}.",
                "Open the page again, and change what it shows now.",
            )

    store.analyses.change_triage(analysis, mode, read_change(form), who, refuse_newer)
    return RedirectResponse(f"/analyses/{analysis}/modes/{mode}#triage", SEE_OTHER)


BOUNDS = OverlayBounds(episodes=100, drawn_poses=500_000, kept_poses=100_000)
"""100,000 poses are about 2 MB of the page, and 100 failures are drawn in the time of a frame."""

OVERLAYS = Depends(ConcurrencyLimit("overlays"), scope="function")


@router.get("/analyses/{analysis}/modes/{mode}/overlay", dependencies=[OVERLAYS])
def show_overlay(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> HTMLResponse:
    """Show the failures of a mode over each other, which the page loads when a user opens it."""
    found, seen = store.analyses.mode(analysis, mode), store.analyses.get(analysis)
    noun, recordings, problem = read_result(seen).cluster_noun, None, ""
    try:
        recordings = load_mode_recordings(store, seen, mode, BOUNDS)
    except Conflict as error:
        problem = f"{error.problem} {error.remedy}".strip()
    return page(
        "overlay.html",
        recordings,
        mode=found,
        noun=noun,
        problem=problem,
        first=describe_first(recordings) if recordings else "",
        scene=make_overlay_chart(recordings, f"overlay-{analysis}-{mode}") if recordings else None,
    )
