"""Where among its scenario's parameters a campaign fails."""

import msgspec

from eigenfail.values import Box, Campaign, Rate, Region
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.summaries import Figure


class BoxLine(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the region.

    Attributes:
        bounds: a line for each parameter that bounds it.
        inside: failure rate there; `percent` of it is for the bar.
    """

    bounds: tuple[str, ...]
    coverage: Figure
    inside: Figure
    percent: float


class RegionView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a region.

    Attributes:
        is_made: whether the region is here; the page asks for it once it stands.
        tiles: what it rests on.
        problem: why there is no region.
        p_value: of chance alone; empty without boxes.
    """

    campaign: int
    campaign_name: str
    is_made: bool
    tiles: tuple[tuple[str, Figure], ...] = ()
    boxes: tuple[BoxLine, ...] = ()
    problem: str = ""
    warnings: tuple[str, ...] = ()
    p_value: str = ""


def region_to_come(campaign: Campaign) -> RegionView:
    """The page while the region is worked out."""
    return RegionView(campaign=campaign.id, campaign_name=campaign.spec.name, is_made=False)


def region_view(campaign: Campaign, found: Region) -> RegionView:
    """The page with the region."""
    return RegionView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_made=True,
        tiles=tiles(found),
        boxes=tuple(map(box_line, found.boxes)),
        problem=found.problem,
        warnings=found.warnings,
        p_value="" if found.p_value is None else formats.number(found.p_value, 2),
    )


def tiles(found: Region) -> tuple[tuple[str, Figure], ...]:
    """What it rests on, and what all boxes have together."""
    episodes = f"of {formats.counted(found.episodes, 'episode')}"
    names = ", ".join(found.parameters)
    told = (
        ("Failures", Figure(formats.integer(found.failures), (episodes,))),
        ("Parameters varied", Figure(formats.integer(len(found.parameters)), (names,))),
        ("Failure rate everywhere", share(found.failure_rate)),
    )
    if not found.boxes:
        return told
    return (
        *told,
        ("Failure rate inside", share(found.precision)),
        ("Failures inside", share(found.coverage)),
    )


def box_line(box: Box) -> BoxLine:
    """One part."""
    return BoxLine(
        bounds=tuple(bound.words for bound in box.bounds),
        coverage=share(box.coverage),
        inside=share(box.precision),
        percent=100.0 * box.precision.value if box.precision else 0.0,
    )


def share(found: Rate | None) -> Figure:
    """A share with its interval and what it is of."""
    if found is None:
        return Figure(formats.NONE, ("none of the half that is counted",))
    counted = f"{formats.integer(found.k)} of {formats.integer(found.n)}"
    return Figure(formats.percent(found.value), (formats.rate_interval(found), counted))
