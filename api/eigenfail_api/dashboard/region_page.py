"""The page of a failing region."""

from anyio.to_thread import run_sync
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation import figures
from eigenfail.presentation.tables import OWN_EPISODES
from eigenfail.values import Rate, Region
from eigenfail_api.dashboard.rendering import Tile, page
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.analyses import REGIONS
from eigenfail_services.campaigns.region import find_region_in_process


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
    return page("region.html", store.campaigns.get(campaign), found=None)


@router.get("/campaigns/{campaign}/region/boxes")
async def show_boxes(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """The failing region of a campaign: its page asks for it once it stands."""
    found = await REGIONS.do(find_region_in_process, store, (campaign,))
    seen = await run_sync(store.campaigns.get, campaign)
    return page(
        "region.html", seen, found=found, shown_tiles=make_tiles(found), share_tile=make_share_tile
    )
