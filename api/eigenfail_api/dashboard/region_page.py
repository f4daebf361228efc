"""The page of a failing region."""

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation import figures
from eigenfail.presentation.tables import OWN_EPISODES
from eigenfail.values import Box, Campaign, Rate, Region
from eigenfail_api.dashboard.rendering import Tile, page
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.analyses import REGIONS
from eigenfail_services.comparison.region import find_region_in_process


class BoxLine(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the region.

    Attributes:
        bounds: a line for each parameter that bounds it.
        inside: failure rate there; `percent` of it is for the bar.
    """

    bounds: tuple[str, ...]
    coverage: Tile
    inside: Tile
    percent: float


class RegionView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a region.

    Attributes:
        is_made: whether the region is here; the page asks for it once it stands.
        tiles: what it rests on.
        problem: why there is no region.
        p_value: p-value of the boxes under chance alone; empty without boxes.
    """

    campaign: int
    campaign_name: str
    is_made: bool
    tiles: tuple[tuple[str, Tile], ...] = ()
    boxes: tuple[BoxLine, ...] = ()
    problem: str = ""
    warnings: tuple[str, ...] = ()
    p_value: str = ""


def make_pending_region_view(campaign: Campaign) -> RegionView:
    """Return the page while the region is computed."""
    return RegionView(campaign=campaign.id, campaign_name=campaign.spec.name, is_made=False)


def make_region_view(campaign: Campaign, found: Region) -> RegionView:
    """Return the page with the region."""
    return RegionView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_made=True,
        tiles=make_tiles(found),
        boxes=tuple(map(make_box_line, found.boxes)),
        problem=found.problem,
        warnings=found.warnings,
        p_value="" if found.p_value is None else figures.format_number(found.p_value, 2),
    )


def make_tiles(found: Region) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of the region's basis and of the sums over its boxes."""
    episodes = f"of {figures.count_noun(found.episodes, 'episode')}"
    names = ", ".join(found.parameters)
    shown = (
        ("Failures", Tile(figures.format_count(found.failures), (episodes,))),
        ("Parameters varied", Tile(figures.format_count(len(found.parameters)), (names,))),
        ("Failure rate everywhere", make_share_tile(found.failure_rate)),
    )
    if not found.boxes:
        return shown
    return (
        *shown,
        ("Failure rate inside", make_share_tile(found.precision)),
        ("Failures inside", make_share_tile(found.coverage)),
    )


def make_box_line(box: Box) -> BoxLine:
    """Return the line of a box."""
    return BoxLine(
        bounds=tuple(bound.words for bound in box.bounds),
        coverage=make_share_tile(box.coverage),
        inside=make_share_tile(box.precision),
        percent=100.0 * box.precision.share if box.precision else 0.0,
    )


def make_share_tile(found: Rate | None) -> Tile:
    """Return the tile of a share with its interval and its basis."""
    if found is None:
        return Tile(figures.UNKNOWN, ("no episodes in the counted half",))
    counted = f"{figures.format_count(found.k)} of {figures.format_count(found.n)}"
    bounds = (
        OWN_EPISODES if found.interval is None else figures.format_percent_interval(found.interval)
    )
    return Tile(figures.format_share(found.value), (bounds, counted))


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/campaigns/{campaign}/region")
def show_region(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """The page on which the failing region of a campaign appears."""
    return page("region.html", make_pending_region_view(store.campaigns.get(campaign)))


@router.get("/campaigns/{campaign}/region/boxes")
async def show_boxes(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """The failing region of a campaign: its page asks for it once it stands."""
    found = await REGIONS.do(find_region_in_process, store, (campaign,))
    seen = await run_sync(store.campaigns.get, campaign)
    return page("region.html", make_region_view(seen, found))
